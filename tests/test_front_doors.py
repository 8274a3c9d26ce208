"""What `import sim` offers, and what it does not yet import."""

import subprocess
import sys

import pytest

import sim


@pytest.mark.parametrize("name", sim.__all__)
def test_every_public_name_is_there_and_described(name):
    assert getattr(sim, name).__name__ == name
    assert f"\n    {name}" in sim.__doc__ and name in dir(sim)


def test_names_that_are_not_public_are_refused():
    with pytest.raises(AttributeError, match="module 'sim' has no attribute 'robot'"):
        _ = sim.robot


def test_mujoco_is_imported_when_it_is_needed():
    code = "import sim, sys; assert 'mujoco' not in sys.modules; sim.mechanism; assert 'mujoco' in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
