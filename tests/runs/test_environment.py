import os

import pytest

from experiments.cli import options, running
from experiments.runs.environment import THREADS, environment, one_thread_each

NAMES = (*THREADS, "MUJOCO_GL")


@pytest.fixture
def variables_of(monkeypatch):
    """Variables of a command's libraries, with a user's variables and options."""

    def variables(arguments=(), **own):
        for name in NAMES:
            monkeypatch.delenv(name, raising=False)
        for name, value in own.items():
            monkeypatch.setenv(name, value)
        during = {}
        parser = options.plain_parser("any", None)
        assert running.run(lambda _: during.update(os.environ), lambda: parser, arguments) == 0
        assert {name: os.environ[name] for name in NAMES if name in os.environ} == own
        return {name: during[name] for name in NAMES if name in during}

    return variables


def test_commands_take_one_thread_and_look_for_no_screen(variables_of):
    assert variables_of() == {**dict.fromkeys(THREADS, "1"), "MUJOCO_GL": "disable"}


@pytest.mark.parametrize(
    ("stated", "one"),
    [({}, False), ({"OMP_NUM_THREADS": "1"}, True), ({"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "4"}, False)],
)
def test_linear_algebra_may_have_threads_of_its_own(monkeypatch, stated, one):
    for name in THREADS:
        monkeypatch.delenv(name, raising=False)
    with environment(stated):
        assert one_thread_each() == one


def test_what_the_user_says_goes_before(variables_of):
    assert variables_of(OMP_NUM_THREADS="8") == {"OMP_NUM_THREADS": "8", "MUJOCO_GL": "disable"}
    assert variables_of(MUJOCO_GL="egl") == {**dict.fromkeys(THREADS, "1"), "MUJOCO_GL": "egl"}


def test_variables_are_as_before_whatever_happens(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with pytest.raises(KeyError), environment({"OMP_NUM_THREADS": "1", "MUJOCO_GL": "egl"}):
        raise KeyError
    assert os.environ["OMP_NUM_THREADS"] == "8" and "MUJOCO_GL" not in os.environ
