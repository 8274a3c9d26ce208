"""A full disk: one sentence, earlier results intact, nothing half-written, and a later run succeeds.

The system itself rejects the writes: files have a size limit, or a file is a link to a full device.
"""

import json
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from commands import refusal
from matplotlib.figure import Figure

import scenes
import sim
from experiments import excite, mechanism
from experiments.data import paper
from experiments.document import figures, result_folder, tabular
from experiments.document.document import Document
from experiments.document.writer import Output, write_parts
from experiments.runs.checkpoint import Checkpoint
from ident.recordings.recording import Recording

resource = pytest.importorskip("resource", reason="this system has no limits on files")
FULL = Path("/dev/full")
PENDULUM = Path(scenes.__file__).parent / "double_pendulum.xml"
WRITTEN = r"could not be written .* and is as it was; make room or write elsewhere, and run again\."


@contextmanager
def limited(size):
    """Limits the size of files in bytes."""
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
    Checkpoint("trials", path, {"seed": 0}).collect([[str([0.5] * 52)] * 20], 21, done=["[1]"])


def save_model(path):
    pendulum = sim.mechanism(PENDULUM, "base")
    sim.write_model(path, pendulum, pendulum.known)


@pytest.mark.parametrize(
    ("write", "name"),
    [(save_recording, "r.csv"), (save_recording, "r.npz"), (save_trials, "trials.npz"), (save_model, "m.xml")],
)
def test_a_file_that_does_not_fit_leaves_the_old_one(tmp_path, write, name, size=1000):
    (tmp_path / name).write_text("earlier")
    with limited(size), pytest.raises(OSError, match=rf"^'{tmp_path / name}' {WRITTEN}"):
        write(tmp_path / name)
    assert contents(tmp_path) == {name: b"earlier"}
    write(tmp_path / name)
    assert len(contents(tmp_path)[name]) > size


def write_table(folder):
    table = tabular.Table("t", *tabular.columns(x=np.arange(1000.0)))
    write_parts(Document(tables={"file": table}), Output(folder, ()))


def write_json(folder):
    result_folder.write_json(folder / "file.json", {"x": list(range(1000))})


def write_figure(extension):
    def write(folder):
        figure = Figure()
        figure.subplots().plot(np.random.default_rng(0).normal(size=1000))
        figures.save(figure, folder, "file", [extension])

    return write


WRITERS = {"csv": write_table, "json": write_json, **{format: write_figure(format) for format in paper.FORMATS}}


def into_results(write, out):
    with result_folder.results_folder(out, stale=["*"]) as folder:
        (folder / "first").write_text("fits")
        write(folder)


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_result_that_does_not_fit_leaves_the_earlier_ones(tmp_path, suffix):
    (tmp_path / "earlier").write_text("whole")
    with limited(1000), pytest.raises(OSError, match=rf"^'{tmp_path}' {WRITTEN}"):
        into_results(WRITERS[suffix], tmp_path)
    assert contents(tmp_path) == {"earlier": b"whole"}


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_disk_without_room_leaves_the_earlier_results(tmp_path, suffix="csv"):
    (tmp_path / "earlier").write_text("whole")

    def write(folder):
        (folder / f"file.{suffix}").symlink_to(FULL)
        WRITERS[suffix](folder)

    with pytest.raises(OSError, match=rf"^'{tmp_path}' {WRITTEN}"):
        into_results(write, tmp_path)
    assert contents(tmp_path) == {"earlier": b"whole"}


COMMANDS = {
    "mechanism": (mechanism, []),
    "excite": (excite, ["double_pendulum", "--starts", "1", "--iterations", "1"]),
}


@pytest.mark.usefixtures("no_trajectory")
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_end_in_a_sentence_and_go_through_once_there_is_room(tmp_path, capsys, request, name):
    if name != "mechanism":
        request.getfixturevalue("undrawn")
    study, options = COMMANDS[name]
    out = tmp_path / "new" / name
    options = [*options, "--formats", "png", "--out", str(out)]
    with limited(4000):
        error = refusal(study.main, options, capsys)
    assert f"error: '{out}' could not be written (" in error
    assert contents(tmp_path) == {}
    assert study.main(options) == 0
    before = contents(tmp_path)
    with limited(4000):
        refusal(study.main, options, capsys)
    assert contents(tmp_path) == before


def test_trials_that_no_longer_fit_keep_those_that_did(tmp_path, monkeypatch):
    outcomes = [json.dumps(each) for each in np.random.default_rng(0).normal(size=(20, 26)).tolist()]
    monkeypatch.setattr("experiments.runs.checkpoint.SAVE_EVERY", 0.0)
    trials = Checkpoint("trials", tmp_path / "trials.npz", {"seed": 0})
    with limited(5000), pytest.raises(OSError, match=rf"^'{trials.file}' {WRITTEN}"):
        trials.collect(([x] for x in outcomes), len(outcomes))
    assert list(tmp_path.iterdir()) == [trials.file]
    done = trials.done()
    assert 0 < len(done) < len(outcomes)
    resumed = trials.collect(([x] for x in outcomes[len(done) :]), len(outcomes), done)
    assert resumed == trials.done() == outcomes
