"""Splines, rows of residuals over their windows, and banded normal equations with a border."""
