import json
import shutil

import numpy as np
import pytest
from commands import refusal

import scenes
from experiments import stream
from ident.estimation.estimate import identify
from ident.parameters.base_parameters import find_base_parameters
from ident.recordings.recording import Recording
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, tree_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

MODEL = scenes.load("double_pendulum").compile()
TREE, GRAVITY = tree_from_model(MODEL, "base"), gravity_in_base(MODEL, "base")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("recordings")
    spec = scenes.load("double_pendulum")
    spec.compile()
    (out / "model.xml").write_text(spec.to_xml())
    for seed, name in ((0, "a.csv"), (1, "b.npz")):
        simulate(spec, DOUBLE_PENDULUM, samples=400, seed=seed).save(out / name)
    return out


def arguments(folder, out, *more):
    files = [str(folder / name) for name in ("model.xml", "a.csv", "b.npz")]
    return [*files, "--base", "base", "--piece", "90", "--out", str(out), *more]


@pytest.fixture(scope="module")
def results(folder, tmp_path_factory):
    """What a run leaves that nothing interrupts."""
    out = tmp_path_factory.mktemp("results")
    assert stream.main(arguments(folder, out)) == 0
    return out


def estimate(out):
    found = json.loads((out / "estimate.json").read_text())
    found.pop("provenance")
    return found


def test_files_are_identified_in_pieces(folder, results):
    whole = identify(TREE, [Recording.load(folder / name) for name in ("a.csv", "b.npz")], gravity=GRAVITY)
    found = estimate(results)
    assert (found["samples"], tuple(found["names"])) == (800, whole.names)
    for key in ("psi", "std", "residual_norms", "singular_values"):
        np.testing.assert_allclose(found[key], getattr(whole, key), rtol=1e-9, atol=1e-12)
    truth = find_base_parameters(TREE, gravity=GRAVITY).regroup(parameters_from_model(MODEL, "base"))
    assert (abs(np.array(found["psi"]) - truth) < 0.3).all()
    assert "m2rz2 + 0.425 m3" in (results / "base_parameters.csv").read_text()


def test_an_interrupted_run_goes_on(folder, results, tmp_path, monkeypatch, capsys):
    original = stream.Progress.and_piece

    def interrupted(progress, part):
        if progress.done == 6:
            raise KeyboardInterrupt
        return original(progress, part)

    monkeypatch.setattr(stream.Progress, "and_piece", interrupted)
    out = tmp_path / "parts"
    assert stream.main(arguments(folder, out, "--workers", "2")) == 130
    assert "The 6 pieces done are in" in capsys.readouterr().err
    monkeypatch.undo()
    for _ in range(2):
        assert stream.main(arguments(folder, out, "--resume")) == 0
        assert "800 samples" in capsys.readouterr().out
        assert estimate(out) == estimate(results)
    assert "is of another run: base differ" in refusal(
        stream.main, [*arguments(folder, out, "--resume"), "--base", "link1"], capsys
    )


@pytest.mark.usefixtures("here")
def test_bad_input_is_named(folder, tmp_path, capsys):
    lines = (folder / "a.csv").read_text().splitlines()
    broken = tmp_path / "broken.csv"
    cells = lines[300].split(",")
    broken.write_text("\n".join([*lines[:300], ",".join(["x", *cells[1:]]), *lines[301:]]) + "\n")
    model, good, out = str(folder / "model.xml"), str(folder / "a.csv"), ["--out", str(tmp_path / "out")]
    given = [model, good, str(broken), "--base", "base", "--piece", "100", *out]
    message = refusal(stream.main, given, capsys)
    assert "broken.csv: row 301, column 'time' needs a number, got 'x'" in message
    assert (tmp_path / "out" / stream.FILE).is_file() and not (tmp_path / "out" / "estimate.json").exists()
    assert "There is no file" in refusal(stream.main, [model, "nowhere.csv", *out], capsys)
    assert "no body named 'hip'" in refusal(stream.main, [model, good, "--base", "hip", *out], capsys)
    missing = refusal(stream.main, [model, good, "--base", "base", "--resume", "--out", str(tmp_path / "new")], capsys)
    assert "--resume needs what an earlier run left in" in missing


@pytest.mark.usefixtures("here")
def test_contacts_are_added_or_left_out_by_name(tmp_path, capsys):
    spec = scenes.load("double_pendulum", contact="pad")
    spec.compile()
    (tmp_path / "model.xml").write_text(spec.to_xml())
    simulate(spec, DOUBLE_PENDULUM, samples=943).save(tmp_path / "pad.npz")
    given = [str(tmp_path / "model.xml"), str(tmp_path / "pad.npz"), "--base", "base", "--out", str(tmp_path / "out")]
    message = refusal(stream.main, given, capsys)
    assert "pad.npz: the recording holds the wrench 'contact' besides the ground's: say --contact contact" in message
    assert stream.main([*given, "--contact", "contact"]) == 0
    truth = find_base_parameters(TREE, gravity=GRAVITY).regroup(parameters_from_model(MODEL, "base"))
    np.testing.assert_allclose(estimate(tmp_path / "out")["psi"], truth, atol=0.1)
    assert stream.main([*given, "--without", "contact"]) == 0
    assert abs(np.array(estimate(tmp_path / "out")["psi"]) - truth).max() > 1


@pytest.mark.parametrize(
    "damage",
    [
        {"identity": "3"},
        {"identity": "[]"},
        {"done": -3},
        {"names": np.array(["m1", "m2"])},
        {"grams": np.array("text")},
        {"grams": np.full((6, 14, 14), np.nan)},
        {"more": 1},
    ],
    ids=str,
)
def test_a_damaged_file_is_not_resumed(folder, results, tmp_path, capsys, damage):
    with np.load(results / stream.FILE) as data:
        fields = dict(data) | damage
    np.savez(tmp_path / stream.FILE, **fields)
    assert "--resume needs what an earlier run left in" in refusal(
        stream.main, arguments(folder, tmp_path, "--resume"), capsys
    )


@pytest.mark.usefixtures("here")
def test_a_changed_recording_is_not_resumed(folder, tmp_path, capsys):
    copies = tmp_path / "copies"
    shutil.copytree(folder, copies)
    assert stream.main(arguments(copies, tmp_path / "out")) == 0
    text = (copies / "a.csv").read_text()
    (copies / "a.csv").write_text(text[:-3] + ("1" if text[-3] != "1" else "2") + text[-2:])
    message = refusal(stream.main, arguments(copies, tmp_path / "out", "--resume"), capsys)
    assert "is of another run: recordings differ" in message
