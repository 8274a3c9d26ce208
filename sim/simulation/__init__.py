"""Scenes stepped by MuJoCo, and what their sensors read."""
