"""Estimators: functions that take a `Problem` and return an `Estimate`."""
