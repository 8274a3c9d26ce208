"""The studies a user runs: `python -m experiments.NAME`."""
