"""A full disk: one sentence, earlier results intact, nothing half-written, and a later run succeeds."""

import sys
from contextlib import contextmanager

import numpy as np
import pytest
from commands import refusal
from jinja2 import DictLoader, Environment
from pages import PENDULUM

import sim
from experiments import excite
from experiments.document.writer import _Compiled
from experiments.runs.workers import Checkpoint
from ident import Recording

resource = pytest.importorskip("resource", reason="this system has no limits on files")
WRITTEN = r"could not be written .* and is as it was; make room or write elsewhere, and run again\."


@contextmanager
def limited(size):
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    # A module that is imported meanwhile must not be cached incompletely.
    before, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        sys.dont_write_bytecode = before


def contents(folder):
    return {str(path.relative_to(folder)): path.is_file() and path.read_bytes() for path in folder.rglob("*")}


def save_recording(path):
    Recording(np.arange(500.0), {"a": np.random.default_rng(0).normal(size=(500, 3))}).save(path)


def save_trials(path):
    Checkpoint("trials", path, {"seed": 0}).collect([dict.fromkeys(range(20), str([0.5] * 52))], [""] * 20)


def save_model(path):
    sim.write_model(path, sim.mechanism(PENDULUM, "base"), sim.mechanism(PENDULUM, "base").known)


@pytest.mark.parametrize(
    ("write", "name"),
    [(save_recording, "r.csv"), (save_recording, "r.npz"), (save_trials, "trials.npz"), (save_model, "m.xml")],
)
def test_a_file_that_does_not_fit_leaves_the_old_one(tmp_path, write, name):
    path = tmp_path / name
    path.write_text("earlier")
    with limited(1000), pytest.raises(OSError, match=rf"^'{path}' {WRITTEN}"):
        write(path)
    assert contents(tmp_path) == {name: b"earlier"}
    write(path)
    assert path.stat().st_size > 1000


@pytest.mark.usefixtures("undrawn")
def test_a_command_ends_in_a_sentence_and_goes_through_once_there_is_room(tmp_path, capsys):
    out = tmp_path / "new" / "results"
    options = ["double_pendulum", "--starts", "1", "--iterations", "1", "--formats", "png", "--out", str(out)]
    with limited(4000):
        error = refusal(excite.main, options, capsys)
    assert f"error: '{out}' could not be written (" in error and contents(tmp_path) == {}
    assert excite.main(options) == 0
    before = contents(tmp_path)
    with limited(4000):
        refusal(excite.main, options, capsys)
    assert contents(tmp_path) == before


def test_a_compiled_template_that_was_cut_off_is_compiled_again(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    loader = DictLoader({"a": "{{ 1 + 1 }}"})
    for cut in (60, 0, None):
        kept = _Compiled(str(tmp_path), "%s.jinja")
        assert Environment(bytecode_cache=kept, loader=loader, autoescape=True).get_template("a").render() == "2"
        (path,) = tmp_path.glob("*.jinja")
        whole = path.read_bytes()
        path.write_bytes(whole[:cut])
