"""How a mechanism moves: excitations, and their design."""
