"""A leg from an OpenSim file with a knee that slides as it bends: from model and log to verdict and updated file."""

import numpy as np
import opensim_walker
import pytest
from commands import refusal
from mechanisms import sines
from opensim_files import Joint, coordinate, document, quietly_read
from opensim_walker import PHI, knee
from written_formats import write_csv

from experiments import identify
from ident.model.regressor import base_wrench_regressor

SEGMENTS = """[segments]
femur = "thigh"
tibia = { segment = "shank", proximal = [0, 0, 0], distal = [0, -0.4, 0] }
"""


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A model file of a leg on the ground that is 20 % off, a log of angles and the ground's wrench, and the true φ."""
    folder, true = tmp_path_factory.mktemp("leg"), {name: PHI[name] for name in ("femur", "tibia")}
    hip = Joint("PinJoint", "hip", "ground", "femur", [coordinate("hip")], at=(np.array([0, 1.0, 0]), np.zeros(3)))
    path, phi = folder / "leg.osim", np.concatenate([*true.values()])
    path.write_text(document([hip, knee()], {name: 1.2 * x for name, x in true.items()}), encoding="utf-8")
    arm, t, rng = quietly_read(path), np.arange(0, 5, 0.01), np.random.default_rng(0)
    size, hertz = np.array([[0.4, 0.2], [0.5, 0.3]]), np.array([[0.5, 1.1], [0.9, 0.4]])
    q, dq, ddq = sines(t, size, 2 * np.pi * hertz, np.array([[0.0, 2.0], [1.0, 0.5]]))
    q -= [0, 0.9]
    wrench = base_wrench_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity) @ phi
    noisy = wrench + rng.normal(size=wrench.shape) * np.repeat([0.5, 0.2], 3)
    cells = np.column_stack([q + 0.002 * rng.normal(size=q.shape), noisy]).T
    names = "hip", "knee", *(f"ground_{kind}{axis}" for kind in "ft" for axis in "xyz")
    return path, write_csv(folder / "swing.csv", {"time": t} | dict(zip(names, cells, strict=True))), phi


@pytest.mark.usefixtures("undrawn")
def test_a_leg_is_identified_and_written_back(swing, tmp_path, capsys):
    path, log, phi = swing
    columns = tmp_path / "columns.toml"
    columns.write_text(SEGMENTS)
    person = ["--prior", "deleva", "--mass", "70", "--height", "1.7", "--sex", "male"]
    given = [str(path), str(log), "--columns", str(columns), "--out", str(tmp_path), "--name", "leg", "--verbose"]
    assert identify.main([*given, *person]) == 0
    output = capsys.readouterr().out
    assert "Usable" in output
    assert "The model's femur, tibia are taken from the table 'deleva', of a male person of 70 kg and 1.7 m." in output
    arm, updated = quietly_read(path), quietly_read(tmp_path / "leg" / "model.osim")
    assert updated.tree == arm.tree
    # The motion does not separate a mass of the shin from a first moment of the thigh, but determines every wrench.
    q, dq, ddq = np.random.default_rng(5).uniform(-1, 0, size=(3, 100, 2)) * np.array([[[1]], [[3]], [[10]]])
    Y = base_wrench_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity)
    error, size = (np.sqrt(np.mean(x**2, axis=0)) for x in (Y @ (updated.prior - phi), Y @ phi))
    assert max(error[[0, 1, 5]] / size[[0, 1, 5]]) < 0.05
    stated = np.sqrt(np.mean((Y @ (arm.prior - phi)) ** 2, axis=0))
    assert min(stated[[0, 1, 5]] / error[[0, 1, 5]]) > 3


def test_a_segment_of_no_table_is_refused(swing, tmp_path, capsys):
    path, log, _ = swing
    (tmp_path / "columns.toml").write_text(SEGMENTS.replace('"thigh"', '"thighs"'))
    given = [str(path), str(log), "--columns", str(tmp_path / "columns.toml"), "--out", str(tmp_path), "--prior"]
    person = ["dumas", "--mass", "70", "--height", "1.7", "--sex", "male"]
    assert "got femur = 'thighs'" in refusal(identify.main, [*given, *person], capsys)


PLATE = """[base]
held = false
[wrenches.plate]
frame = "world"
on = "tibia"
force = ["gone", "ground_force_1_vy", "ground_force_1_vz"]
point = ["ground_force_1_px", "ground_force_1_py", "ground_force_1_pz"]
free_moment = ["ground_force_1_mx", "ground_force_1_my", "ground_force_1_mz"]
"""


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_what_is_wrong_is_said_of_the_files_that_were_given(tmp_path, capsys):
    """Angles are fitted to markers first, and missing ones are reported."""
    opensim_walker.trial(tmp_path, opensim_walker.leg(tmp_path))
    plates, markers = tmp_path / "columns.toml", tmp_path / "walk.trc"
    plates.write_text(PLATE, encoding="utf-8")
    given = [str(tmp_path / "leg.osim"), f"{markers}+{tmp_path / 'walk.mot'}", "--out", str(tmp_path / "out")]
    message = refusal(identify.main, [*given, "--columns", str(plates)], capsys)
    assert f"{given[1]}: " in message and "'gone'" in message and "/tmp" not in message.replace(str(tmp_path), "")
    markers.write_text(markers.read_text(encoding="utf-8").replace("tibia", "other"), encoding="utf-8")
    message = refusal(identify.main, [*given, "--columns", str(plates)], capsys)
    assert "the markers do not determine knee; leave what they do not tell of out by --fix knee." in message
