"""Settings that must precede numpy's first import, and fixtures."""

import gc
import os

# One thread is faster on the tests' small matrices, and does not compete with other processes of the machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

# Recorded equations are millions of small objects; at the usual rate, garbage collection among them takes a fifth of
# the time.
gc.set_threshold(1_000_000)

PEOPLE = ("document/test_pages_in_browser.py", "studies/test_human.py", "studies/test_mechanism.py")
"""Files that share simulated people (`persons`), which take longest."""

STUDIES = ("tests/test_paper.py", "docs/test_readme.py", "studies/test_misaligned.py", "studies/test_multicontact.py")
"""Files that share the package's studies (`shared_studies`)."""

FIRST = (
    *PEOPLE,
    *(f"studies/test_{name}.py" for name in ("identify", "misaligned", "trajectory_identification", "multicontact")),
    *("tests/test_against_mujoco.py", "mechanism/test_closure.py", "docs/test_pages.py", "tests/test_tracked.py"),
    *(f"studies/test_{name}.py" for name in ("monte_carlo", "excite", "batch")),
    *("guesses/test_driver_logs.py", "guesses/test_laboratory_names.py", "tests/test_lone_body.py"),
)
"""The slowest files, which start first so that none is left alone at the end."""


def pytest_collection_modifyitems(items):
    places = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: places.get("/".join(item.path.parts[-2:]), len(FIRST)))


def pytest_collection_finish():
    """Exempts all imported objects from garbage collection."""
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Keeps the tests of a file with one worker, as they share costly fixtures; likewise those of some files."""
    from xdist.scheduler import LoadFileScheduling

    class Together(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return next((group[0] for group in (PEOPLE, STUDIES) if file.endswith(group)), file)

    return Together(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.fixture
def rng():
    """Random numbers that do not depend on the tests before."""
    return np.random.default_rng(1)


@pytest.fixture
def undrawn(monkeypatch):
    """Leaves figures in files and pages empty, as drawing takes most of a study's time."""
    from stand_ins import leave_undrawn

    leave_undrawn(monkeypatch)


@pytest.fixture
def no_trajectory(monkeypatch):
    """Replaces trajectory estimates by the truth, as they take most of a study's time."""
    from stand_ins import use_truth

    use_truth(monkeypatch)


@pytest.fixture
def here(monkeypatch):
    """Runs commands in this process only, as starting others takes seconds."""
    from stand_ins import Here

    from experiments.runs import workers

    monkeypatch.setattr(workers, "Processes", Here)
