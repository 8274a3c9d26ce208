"""Small faults put into the code one at a time: each has to make a test fail."""
