"""Estimation of base parameters and their standard deviations from samples."""
