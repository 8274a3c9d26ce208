"""Identification of a robot's payload beyond a wrist sensor: mass, centre of mass, inertia and sensor errors."""
