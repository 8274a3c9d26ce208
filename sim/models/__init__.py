"""MJCF and URDF files read as mechanisms, and written back with other inertias."""
