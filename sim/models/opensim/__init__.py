"""OpenSim's models read as mechanisms, and written back with other inertias; nothing here needs MuJoCo."""
