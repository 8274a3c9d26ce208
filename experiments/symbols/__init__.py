"""Mechanisms in symbols: equations and code."""
