"""A recording in any format is read as the same: its columns are guessed, and mapped."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from commands import refusal
from written_formats import DEG, write_bag, write_c3d, write_csv, write_lerobot, write_mat, write_mot, write_parquet

import ident
import scenes
import sim
from experiments import columns as columns_command
from experiments import identify
from experiments.cli import options
from sim.motion.excitation import DOUBLE_PENDULUM

pytestmark = pytest.mark.extras

MODEL = Path(scenes.__file__).parent / "double_pendulum.xml"
JOINTS = ("joint1", "joint2")
PACKAGES = {"parquet": "pyarrow", "c3d": "ezc3d", "bag": "rosbags", "mcap": "rosbags"}


@pytest.fixture(scope="module")
def recording():
    return sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=250)


def columns(recording, unit=1.0):
    angles = {f"{joint}_position": unit * recording[f"{joint}_position"] for joint in JOINTS}
    names = [f"ground_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
    wrench = dict(zip(names, recording.wrench("ground").values.T, strict=True))
    return {"time": recording.time, **angles, **wrench}


def write(path, recording):
    """Writes the recording's angles and wrench in the format of the suffix."""
    kind, wrench = path.name.split(".", 1)[1], recording.wrench("ground").values
    if kind in PACKAGES and find_spec(PACKAGES[kind]) is None:
        pytest.skip(f"{PACKAGES[kind]} is in an extra")
    if kind == "c3d":
        angles = {joint: recording[f"{joint}_position"][:, None] * [1, 0, 0] for joint in JOINTS}
        write_c3d(path, recording.rate, angles, wrench, JOINTS)
    elif kind in ("bag", "mcap"):
        states = {joint: [(x, 0, 0) for x in recording[f"{joint}_position"]] for joint in JOINTS}
        topics = {"/joint_states": (recording.time, states), "/ground": (recording.time, wrench)}
        write_bag(path if kind == "bag" else path.with_name("folder_mcap"), topics)
        if kind == "mcap":
            path.write_bytes(next(path.with_name("folder_mcap").glob("*.mcap")).read_bytes())
    elif kind == "mot":
        write_mot(path, columns(recording, DEG))
    elif kind == "mat":
        scalars = {name: x for name, x in columns(recording).items() if "." not in name}
        write_mat(path, scalars, ground_force=wrench[:, :3], ground_torque=wrench[:, 3:])
    else:
        {"csv": write_csv, "csv.gz": write_csv, "parquet": write_parquet}[kind](path, columns(recording))


@pytest.mark.parametrize("kind", ["csv.gz", "mot", "mat", "parquet", "c3d", "bag", "mcap"])
def test_columns_of_every_format_are_guessed(tmp_path, recording, kind):
    path = tmp_path / f"log.{kind}"
    write(path, recording)
    assert columns_command.main([str(MODEL), str(path), "--base", "base", "--out", str(tmp_path / "guessed.toml")]) == 0
    arm = sim.mechanism(MODEL, base="base")
    log = ident.read_log(path, arm, tmp_path / "guessed.toml", gaps=True)
    close = {"rtol": 1e-5, "atol": 1e-4} if kind == "c3d" else {"rtol": 1e-9, "atol": 1e-9}
    for name in (*(f"{joint}_position" for joint in JOINTS), "ground_force", "ground_torque"):
        np.testing.assert_allclose(log[name], recording[name][: len(log.time)], **close)


def test_an_episode_of_a_dataset_is_named_by_its_number(tmp_path, capsys, recording):
    pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
    q = DEG * recording.of_joints(JOINTS, "position")
    features = {"observation.state": q, "action": q + 0.1}
    features |= {f"observation.ground_{kind}": recording[f"ground_{kind}"] for kind in ("force", "torque")}
    names = {key: {"motors": [f"{joint}.pos" for joint in JOINTS]} for key in ("observation.state", "action")}
    names |= {f"observation.ground_{kind}": list("xyz") for kind in ("force", "torque")}
    write_lerobot(tmp_path / "dataset", {0: {name: x[:100] for name, x in features.items()}, 1: features}, 3, names)
    error = refusal(identify.main, [str(MODEL), str(tmp_path / "dataset"), "--out", str(tmp_path)], capsys)
    assert "an episode of the dataset is chosen as dataset#0; the dataset has episodes 0 to 1." in error
    model, path, mapping = str(MODEL), tmp_path / "dataset#1", str(tmp_path / "c.toml")
    assert columns_command.main([model, str(path), "--base", "base", "--out", mapping]) == 0
    assert f"{model} '{path}' --columns {mapping} --base base" in capsys.readouterr().out
    args = identify.parser().parse_args([model, str(path), "--columns", mapping, "--out", str(tmp_path)])
    assert options.folder(args) == tmp_path / "double_pendulum-dataset-1"
    assert [each["file"] for each in options.file_entry(path)["files"]] == ["info.json", "file-000.parquet"]
    log = ident.read_log(path, sim.mechanism(MODEL, base="base"), mapping)
    read, written = (x.of_joints(JOINTS, "position") for x in (log, recording))
    np.testing.assert_allclose(read, written, rtol=1e-5, atol=1e-5)
