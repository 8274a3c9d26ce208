"""Thresholds that several rooms share, each with its reason."""

HUGE = 1e8
"""No position, velocity, acceleration, force or torque in SI units is larger."""
