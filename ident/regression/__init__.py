"""Least squares on measured or filtered states: ordinary, weighted and robust."""
