"""Motions of a mechanism: excitations, and their design."""
