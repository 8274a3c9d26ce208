"""Data of the studies: what they are given, and what they return, for reports to read."""
