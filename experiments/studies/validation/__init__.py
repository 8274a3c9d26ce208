"""Validation on public recordings: their registry, their files, and what they show."""
