"""Drives of joints as models state them, and the torques that they add, against MuJoCo's inverse dynamics."""
