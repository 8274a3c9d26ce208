"""From samples to base parameters and their standard deviations."""
