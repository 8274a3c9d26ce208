"""Settings that must precede numpy's first import, and fixtures."""

import gc
import os

# One thread is faster on the tests' small matrices, and does not compete with whatever else the machine does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

# Recorded equations are millions of small objects; to look for garbage among them as often as usual takes a fifth of
# the time.
gc.set_threshold(100_000)


@pytest.fixture
def undrawn(monkeypatch):
    """Nothing in files in place of figures, and in pages, whose drawing takes most of a study's time."""
    from fuzz.undrawn import leave_undrawn

    leave_undrawn(monkeypatch)


@pytest.fixture
def no_joint(monkeypatch):
    """The truth in place of joint estimates, which take most of a study's time."""
    from truth import told

    told(monkeypatch)


@pytest.fixture
def here(monkeypatch):
    """Commands do all work in this process, where a test is not about others, which take seconds to start."""
    from fuzz.here import Here

    from experiments.runs import workers

    monkeypatch.setattr(workers, "Processes", Here)
