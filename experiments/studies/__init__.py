"""The computations of the commands."""
