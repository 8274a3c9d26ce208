"""What a robot carries beyond a wrist sensor: mass, centre of mass and inertia, and what the sensor adds."""
