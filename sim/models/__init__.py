"""MJCF, URDF and OpenSim files read as mechanisms, and written back with other inertias."""
