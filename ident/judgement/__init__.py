"""Findings on a model, a recording, a set-up and a fit, and the verdict on an estimate."""
