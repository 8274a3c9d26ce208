"""Simulation of scenes by MuJoCo, and readings of their sensors."""
