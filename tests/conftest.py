"""Settings that must precede numpy's first import, and fixtures."""

import gc
import os

# One thread is faster on the tests' small matrices, and does not compete with whatever else the machine does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

# Recorded equations are millions of small objects; to look for garbage among them as often as usual takes a fifth of
# the time.
gc.set_threshold(1_000_000)

PEOPLE = ("output/test_pages_in_browser.py", "studies/test_human.py", "studies/test_mechanism.py")
"""Files that need the same people (`persons`), who take longest to simulate."""

FIRST = (
    *PEOPLE,
    *(f"studies/test_{name}.py" for name in ("monte_carlo", "joint_identification", "identify", "gait", "misaligned")),
    "tests/test_against_mujoco.py",
    *(f"studies/test_{name}.py" for name in ("multicontact", "chair", "laboratory_arms")),
)
"""Files that take longest begin first: none is left alone at the end."""


def pytest_collection_modifyitems(items):
    """Puts the tests of these files first."""
    places = {name: k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: places.get("/".join(item.path.parts[-2:]), len(FIRST)))


def pytest_collection_finish():
    """What was imported stays to the end: garbage is not looked for in it each time."""
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """A file's tests share what is costly to make, so they stay with one worker, as do those of some files."""
    from xdist.scheduler import LoadFileScheduling

    class Together(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return PEOPLE[0] if file.endswith(PEOPLE) else file

    return Together(config, log) if config.getvalue("dist") == "loadfile" else None


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
