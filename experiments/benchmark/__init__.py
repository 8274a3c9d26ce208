"""Benchmarks of speed, accuracy and memory against other ways to do the same."""
