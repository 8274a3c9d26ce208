"""Damaged models, logs, mappings and options: each has to be refused in a sentence or accepted."""
