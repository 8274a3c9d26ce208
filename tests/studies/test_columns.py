"""From a laboratory's file, of any format, to parameters in two commands; and one sentence for bad input."""

import re
import tomllib
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from commands import entries_of, refusal
from guesses import odd_logs
from guesses.odd_logs import arm, laboratory, motors
from pages import PENDULUM
from written_formats import DEG, write_bag, write_c3d, write_csv, write_lerobot, write_mat, write_mot, write_parquet

import ident
import scenes
import sim
from experiments import columns, identify
from experiments.cli import options
from experiments.studies.person_recordings import Laboratory, recorded
from sim.motion.excitation import DOUBLE_PENDULUM

MODEL = str(PENDULUM)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("log", [laboratory, pytest.param(motors, marks=pytest.mark.slow)])
def test_two_commands_lead_from_a_file_to_its_parameters(tmp_path, capsys, log):
    path, _ = odd_logs.write(tmp_path, log)
    assert columns.main([MODEL, str(path), "--base", "base"]) == 0
    output = capsys.readouterr().out
    *_, command = output.strip().splitlines()
    assert command == (f"multicontact identify {MODEL} {path} --columns {path.with_suffix('.toml')} --base base")
    assert identify.main([*command.split()[2:], "--out", str(tmp_path), "--name", "out"]) == 0
    estimate = entries_of(tmp_path / "out" / "estimate.json")
    sensors = ident.Sensors(log is laboratory, log is motors)
    truth = ident.find_base_parameters(arm(), sensors=sensors).regroup(arm().known)
    values, std = (np.array(estimate[key])[: len(truth)] for key in ("values", "std_setup"))
    # Gains of motors agree with the model within a few per cent.
    assert np.abs((values - truth) / np.hypot(std, 0.03 * np.abs(truth) * (log is motors))).max() < 4


def test_what_is_there_is_replaced_by_force_alone_and_other_logs_need_the_same_columns(tmp_path, capsys):
    path, _ = odd_logs.write(tmp_path, laboratory)
    arguments, mapping = [MODEL, str(path), "--base", "base"], path.with_suffix(".toml")
    assert columns.main(arguments) == 0
    first = mapping.read_bytes()
    mapping.write_text("# mine")
    message = refusal(columns.main, arguments, capsys)
    assert re.fullmatch(r"python -m experiments\.columns: error: '.*' is there already; --force .*\n", message)
    assert mapping.read_text() == "# mine"
    assert columns.main([*arguments, "--force"]) == 0 and mapping.read_bytes() == first
    another = tmp_path / "another.csv"
    another.write_text(path.read_text().replace("Joint 2 angle", "Joint 2 winkel"))
    message = refusal(columns.main, [MODEL, str(path), str(another), "--base", "base"], capsys)
    assert "another.csv: one mapping serves logs of the same columns, and here is no Joint 2 angle" in message


def test_plates_under_a_person_rest_in_the_world(tmp_path, capsys):
    """Angles with the poses of the base beside forces of two plates, without the plates' places."""
    motion = recorded("squats", 1.0, 0, Laboratory(rate=50.0, rail=False))
    log, model = tmp_path / "angles.csv", tmp_path / "person.xml"
    replace(motion, sensors={}, setup={}).save(log)
    model.write_text(scenes.load("humanoid").to_xml(), encoding="utf-8")
    arguments = [str(model), str(log), "--base", "pelvis"]
    message = refusal(identify.main, [*arguments, "--out", str(tmp_path)], capsys)
    assert "Nothing holds the base, so that a wrench on a body or a joint torque is needed, and none" in message
    assert "columns that are not used are left_force.x, left_force.y, left_force.z" in message
    assert columns.main(arguments) == 0
    assert not re.search("Open:|not used", capsys.readouterr().out)
    wrenches = tomllib.loads((tmp_path / "angles.toml").read_text(encoding="utf-8"))["wrenches"]
    assert {name: (each["frame"], each["on"]) for name, each in wrenches.items()} == {
        side: ("world", f"{side}_foot") for side in ("left", "right")
    }


@pytest.mark.parametrize("huge", ["9e29", "-1e100"])
def test_numbers_that_no_sensor_reads_do_not_overflow(tmp_path, huge):
    folder, log = Path(MODEL).parent, tmp_path / "arm.csv"
    rows = (folder / "arm.csv").read_text(encoding="utf-8").splitlines()[:200]
    rows[100] = rows[100].replace(rows[100].split(",")[1], huge)
    log.write_text("\n".join(rows), encoding="utf-8")
    assert columns.main([str(folder / "arm.xml"), str(log), "--base", "base"]) == 0


JOINTS = ("joint1", "joint2")
PACKAGES = {"parquet": "pyarrow", "c3d": "ezc3d", "bag": "rosbags", "mcap": "rosbags"}


@pytest.fixture(scope="module")
def recording():
    return sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=250)


def columns_of(recording, unit=1.0):
    angles = {f"{joint}_position": unit * recording[f"{joint}_position"] for joint in JOINTS}
    names = [f"ground_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
    wrench = dict(zip(names, recording.wrench("ground").values.T, strict=True))
    return {"time": recording.time, **angles, **wrench}


def write(path, recording):
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
        write_mot(path, columns_of(recording, DEG))
    elif kind == "mat":
        scalars = {name: x for name, x in columns_of(recording).items() if "." not in name}
        write_mat(path, scalars, ground_force=wrench[:, :3], ground_torque=wrench[:, 3:])
    else:
        {"csv": write_csv, "csv.gz": write_csv, "parquet": write_parquet}[kind](path, columns_of(recording))


@pytest.mark.extras
@pytest.mark.parametrize("kind", ["csv.gz", "mot", "mat", "parquet", "c3d", "bag", "mcap"])
def test_columns_of_every_format_are_guessed(tmp_path, recording, kind):
    path = tmp_path / f"log.{kind}"
    write(path, recording)
    assert columns.main([MODEL, str(path), "--base", "base", "--out", str(tmp_path / "guessed.toml")]) == 0
    arm = sim.mechanism(MODEL, base="base")
    log = ident.read_log(path, arm, tmp_path / "guessed.toml", gaps=True)
    close = {"rtol": 1e-5, "atol": 1e-4} if kind == "c3d" else {"rtol": 1e-9, "atol": 1e-9}
    for name in (*(f"{joint}_position" for joint in JOINTS), "ground_force", "ground_torque"):
        np.testing.assert_allclose(log[name], recording[name][: len(log.time)], **close)


@pytest.mark.extras
def test_an_episode_of_a_dataset_is_named_by_its_number(tmp_path, capsys, recording):
    pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
    q = DEG * recording.of_joints(JOINTS, "position")
    features = {"observation.state": q, "action": q + 0.1}
    features |= {f"observation.ground_{kind}": recording[f"ground_{kind}"] for kind in ("force", "torque")}
    names = {key: {"motors": [f"{joint}.pos" for joint in JOINTS]} for key in ("observation.state", "action")}
    names |= {f"observation.ground_{kind}": list("xyz") for kind in ("force", "torque")}
    write_lerobot(tmp_path / "dataset", {0: {name: x[:100] for name, x in features.items()}, 1: features}, 3, names)
    error = refusal(identify.main, [MODEL, str(tmp_path / "dataset"), "--out", str(tmp_path)], capsys)
    assert "an episode of the dataset is chosen as dataset#0; the dataset has episodes 0 to 1." in error
    model, path, mapping = MODEL, tmp_path / "dataset#1", str(tmp_path / "c.toml")
    assert columns.main([model, str(path), "--base", "base", "--out", mapping]) == 0
    assert f"{model} '{path}' --columns {mapping} --base base" in capsys.readouterr().out
    args = identify.parser().parse_args([model, str(path), "--columns", mapping, "--out", str(tmp_path)])
    assert options.folder(args) == tmp_path / "double_pendulum-dataset-1"
    assert [each["file"] for each in options.file_entry(path)["files"]] == ["info.json", "file-000.parquet"]
    log = ident.read_log(path, sim.mechanism(MODEL, base="base"), mapping)
    read, written = (x.of_joints(JOINTS, "position") for x in (log, recording))
    np.testing.assert_allclose(read, written, rtol=1e-5, atol=1e-5)
