"""Settings that must precede numpy's first import, and fixtures."""

import os

# One thread is faster on the tests' small matrices, and does not compete with whatever else the machine does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest


@pytest.fixture
def undrawn(monkeypatch):
    """Empty files in place of figures, whose drawing takes most of a study's time."""
    from fuzz.cases import not_drawn

    from experiments.output import figures

    monkeypatch.setattr(figures, "save", not_drawn)
