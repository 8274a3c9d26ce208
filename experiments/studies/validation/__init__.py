"""Validation on public recordings of real systems: their registry, their files, and what they show."""
