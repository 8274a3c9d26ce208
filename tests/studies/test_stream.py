import json

import numpy as np
import pytest
from commands import refusal
from fits import fitted

import scenes
from experiments.stream import main
from experiments.studies import stream_progress
from ident.geometry.se3 import inverse
from ident.parameters.base_parameters import find_base_parameters
from ident.recordings.recording import Recording
from ident.recordings.wrench import transform_wrench
from ident.regression.ordinary import huber_white
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
    return [*files, "--no-offsets", "--base", "base", "--piece", "90", "--out", str(out), *more]


@pytest.fixture(scope="module")
def results(folder, tmp_path_factory):
    """Results of an uninterrupted run."""
    out = tmp_path_factory.mktemp("results")
    assert main(arguments(folder, out)) == 0
    return out


def estimate(out):
    return json.loads((out / "estimate.json").read_text())


def psi(out):
    """Base parameters, the first of the coefficients."""
    written = estimate(out)
    return np.array(written["values"])[: len(written["regrouping"])]


def test_files_are_identified_in_pieces(folder, results):
    whole = fitted(TREE, [Recording.load(folder / name) for name in ("a.csv", "b.npz")], gravity=GRAVITY)
    written = estimate(results)
    assert (written["samples"], tuple(written["columns"])) == (800, whole.names)
    for key in ("values", "residual_norms", "singular_values"):
        np.testing.assert_allclose(written[key], getattr(whole, key), rtol=1e-9, atol=1e-12)
    pieces = [Recording.load(folder / name) for name in ("a.csv", "b.npz")]
    np.testing.assert_allclose(written["std"], huber_white(whole, pieces, steady=True).std, rtol=1e-9)
    truth = find_base_parameters(TREE, gravity=GRAVITY).regroup(parameters_from_model(MODEL, "base"))
    assert (abs(np.array(written["values"]) - truth) < 0.3).all()
    tex = (results / "base_parameters.tex").read_text(encoding="utf-8")
    assert r"\emph{link2}" in tex and r"\emph{link1}" in tex
    assert "m2rz2 + 0.425 m3" in (results / "base_parameters.csv").read_text()


@pytest.mark.usefixtures("here")
def test_an_interrupted_run_goes_on(folder, results, tmp_path, monkeypatch, capsys):
    original = stream_progress.Progress.and_piece

    def interrupted(progress, part):
        if progress.done == 6:
            raise KeyboardInterrupt
        return original(progress, part)

    monkeypatch.setattr(stream_progress.Progress, "and_piece", interrupted)
    out = tmp_path / "parts"
    assert main(arguments(folder, out, "--workers", "2")) == 130
    assert "The 6 pieces done are in" in capsys.readouterr().err
    monkeypatch.undo()
    for _ in range(2):
        assert main(arguments(folder, out, "--resume")) == 0
        assert "800 samples" in capsys.readouterr().out
        assert estimate(out) == estimate(results)
    assert "is of another run: base, model_as_read differ" in refusal(
        main, [*arguments(folder, out, "--resume"), "--base", "link1"], capsys
    )


@pytest.mark.usefixtures("here")
def test_bad_input_is_named(folder, tmp_path, capsys):
    lines = (folder / "a.csv").read_text().splitlines()
    broken = tmp_path / "broken.csv"
    cells = lines[300].split(",")
    broken.write_text("\n".join([*lines[:300], ",".join(["x", *cells[1:]]), *lines[301:]]) + "\n")
    model, good, out = str(folder / "model.xml"), str(folder / "a.csv"), ["--out", str(tmp_path / "out")]
    given = [model, good, str(broken), "--base", "base", "--piece", "100", *out]
    message = refusal(main, given, capsys)
    assert "broken.csv: row 301, column 'time' needs a number, got 'x'" in message
    assert (tmp_path / "out" / stream_progress.FILE).is_file() and not (tmp_path / "out" / "estimate.json").exists()
    assert "There is no file" in refusal(main, [model, "nowhere.csv", *out], capsys)
    assert "has to be another one" in refusal(main, [model, good, "--held-out", good, *out], capsys)
    assert "no body named 'hip'" in refusal(main, [model, good, "--base", "hip", *out], capsys)
    missing = refusal(main, [model, good, "--base", "base", "--resume", "--out", str(tmp_path / "new")], capsys)
    assert "--resume needs what an earlier run left in" in missing


@pytest.mark.usefixtures("here")
def test_contacts_are_added_or_left_out_by_name(tmp_path, capsys):
    spec = scenes.load("double_pendulum", contact="pad")
    spec.compile()
    (tmp_path / "model.xml").write_text(spec.to_xml())
    simulate(spec, DOUBLE_PENDULUM, samples=943).save(tmp_path / "pad.npz")
    given = [str(tmp_path / "model.xml"), str(tmp_path / "pad.npz"), "--base", "base", "--out", str(tmp_path / "out")]
    message = refusal(main, given, capsys)
    assert "pad.npz: the recording holds the wrench 'contact' besides the ground's: say --contact contact" in message
    assert main([*given, "--contact", "contact"]) == 0
    truth = find_base_parameters(TREE, gravity=GRAVITY).regroup(parameters_from_model(MODEL, "base"))
    np.testing.assert_allclose(psi(tmp_path / "out"), truth, atol=0.1)
    assert main([*given, "--without", "contact"]) == 0
    assert abs(psi(tmp_path / "out") - truth).max() > 1


COLUMNS = """
time = { column = "clock", unit = "ms" }
[joints.joint1]
position = { column = "angle", unit = "deg" }
[wrenches.ground]
force = ["ground_force.x", "ground_force.y", "ground_force.z"]
torque = ["ground_torque.x", "ground_torque.y", "ground_torque.z"]
applied_to_link = false
position = [0.1, 0, 0]
[wrenches.tip]
body = "link2"
force = ["contact_force.x", "contact_force.y", "contact_force.z"]
torque = ["contact_torque.x", "contact_torque.y", "contact_torque.z"]
position = [0, 0, 0.4]
applied_to_link = false
"""


@pytest.mark.usefixtures("here")
def test_a_mapping_of_columns_gives_what_the_channels_give(tmp_path, capsys):
    spec = scenes.load("double_pendulum", contact="pad")
    spec.compile()
    (tmp_path / "model.xml").write_text(spec.to_xml())
    recording = simulate(spec, DOUBLE_PENDULUM, samples=300)
    recording.save(tmp_path / "pad.npz")
    measured = dict(recording.measured)
    plate = np.eye(4)
    plate[0, 3] = 0.1
    there = -transform_wrench(inverse(plate), recording.wrench("ground").values)
    measured |= {"clock": 1000 * recording.time, "angle": np.rad2deg(measured.pop("joint1_position"))}
    measured |= {"ground_force": there[:, :3], "ground_torque": there[:, 3:]}
    Recording(recording.time, measured).save(tmp_path / "log.csv")
    given = [str(tmp_path / "model.xml"), "--base", "base", "--piece", "70", "--out", str(tmp_path / "out")]
    assert main([*given, str(tmp_path / "pad.npz"), "--contact", "contact"]) == 0
    expected = psi(tmp_path / "out")
    (tmp_path / "columns.toml").write_text(COLUMNS)
    given = [*given, str(tmp_path / "log.csv"), "--columns", str(tmp_path / "columns.toml")]
    assert main(given) == 0
    np.testing.assert_allclose(psi(tmp_path / "out"), expected, atol=1e-9)
    columns = COLUMNS.replace('force = ["ground_force.x"', 'force = [""')
    (tmp_path / "columns.toml").write_text(columns)
    assert "log.csv: the ground's wrench needs all six components here, but Fx of it is" in refusal(main, given, capsys)
    assert "columns differ" in refusal(main, [*given, "--resume"], capsys)
    assert "besides the one at the base, got 'ground'" in refusal(main, [*given, "--contact", "ground"], capsys)


@pytest.mark.parametrize(
    "damage",
    [
        {"identity": "[]"},
        {"done": -3},
        {"names": np.array(["m1", "m2"])},
        {"grams": np.full((6, 14, 14), np.nan)},
        {"more": 1},
    ],
    ids=str,
)
def test_a_damaged_file_is_not_resumed(folder, results, tmp_path, capsys, damage):
    with np.load(results / stream_progress.FILE) as data:
        fields = dict(data) | damage
    np.savez(tmp_path / stream_progress.FILE, **fields)
    assert "--resume needs what an earlier run left in" in refusal(
        main, arguments(folder, tmp_path, "--resume"), capsys
    )
