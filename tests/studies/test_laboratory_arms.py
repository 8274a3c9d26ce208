"""Arms in laboratories' logs, from files to answers by the commands: torques, currents, a coupled wrist."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rigs
import wrist
from recorded_faults import faulty, shortened

import scenes
import sim
from experiments import identify
from ident.judgement.fit_findings import FAR_APART

pytestmark = pytest.mark.slow

JOINTS = wrist.JOINTS
PENDULUM = str(Path(scenes.__file__).parent / "double_pendulum.xml")
FRICTION = ["--drive", "viscous", "coulomb"]


def identified(folder, *options, logs=("run.csv",)):
    """Result of `identify` for a folder's logs, with the model that has a hand."""
    (folder / "arm.xml").write_text(wrist.model(tool=rigs.HAND), encoding="utf-8")
    files = [str(folder / name) for name in ("arm.xml", *logs)]
    where = ["--columns", str(folder / "columns.toml"), "--out", str(folder), "--name", "out"]
    assert identify.main([*files, *where, *options]) == 0
    return json.loads((folder / "out" / "estimate.json").read_text(encoding="utf-8"))


def relative_rms(estimate):
    return np.array([each["relative_rms"] for each in estimate["held_out"].values()])


def found(estimate, *, doubt):
    """Values of the doubts or remarks by their codes."""
    return {each["code"]: each["values"] for each in estimate["findings"] if each["doubt"] == doubt}


@pytest.mark.usefixtures("undrawn")
def test_link_torques_with_late_samples_and_a_hand_that_was_not_there(tmp_path):
    rng = np.random.default_rng(4)
    t, q, dq, torque = rigs.moved(12.0, 60.0)
    stamps, there = rigs.late_clock(t, rng)
    torque = torque + rigs.friction(dq) + rng.normal(size=7) * 0.2 + 0.05 * rng.normal(size=q.shape)
    q = (q + 1e-4 * rng.normal(size=q.shape))[there]
    torque = rigs.with_runs_missing(torque[there], rng)
    columns = {"t_ms": 1e3 * stamps[there]} | {f"enc{k}": x for k, x in enumerate(np.degrees(q).T, start=1)}
    rigs.write_log(tmp_path / "run.csv", columns | {f"link{k}": x for k, x in enumerate(torque.T, start=1)})
    mapping = ['time = { column = "t_ms", unit = "ms" }']
    for k, joint in enumerate(JOINTS, start=1):
        mapping.append(f'[joints.{joint}]\nposition = {{ column = "enc{k}", unit = "deg" }}\ntorque = "link{k}"')
    (tmp_path / "columns.toml").write_text("\n".join(mapping), encoding="utf-8")

    estimate = identified(tmp_path, "--gaps", *FRICTION)
    assert found(estimate, doubt=False)["body_not_carried"]["body"] == "tool" and "friction_not_fitted" not in found(
        estimate, doubt=True
    )
    arm = sim.mechanism(str(tmp_path / "arm.xml"))
    assert (relative_rms(estimate) <= 1.1 * rigs.by_hand(arm, [(stamps[there], q, torque)])).all()
    assert estimate["halves"]["rms_z"] <= 1.3


@pytest.mark.usefixtures("undrawn")
def test_motor_currents_with_gains_in_several_files(tmp_path):
    rng, gains = np.random.default_rng(5), np.array([4.2, 5.1, -3.3, 4.0, 2.6, 1.9, -1.2])
    mapping, logs = [], []
    for number in (1, 2):
        t, q, dq, torque = rigs.moved(16.0, 40.0, seed=number)
        current = (torque + rigs.friction(dq)) / gains + 0.02 * rng.normal(size=q.shape)
        q = q + 1e-4 * rng.normal(size=q.shape)
        columns = {"time": t} | {f"q_{joint}": x for joint, x in zip(JOINTS, q.T, strict=True)}
        rigs.write_log(tmp_path / f"run{number}.csv", columns | {f"i{k}": x for k, x in enumerate(current.T, start=1)})
        logs.append((t, q, current * gains))
    for k, (joint, gain) in enumerate(zip(JOINTS, gains, strict=True), start=1):
        mapping.append(f'[joints.{joint}]\ntorque = {{ column = "i{k}", gain = {gain}, unit = "A" }}')
    (tmp_path / "columns.toml").write_text("\n".join(mapping), encoding="utf-8")

    estimate = identified(tmp_path, *FRICTION, logs=("run1.csv", "run2.csv"))
    assert found(estimate, doubt=False)["body_not_carried"]["body"] == "tool"
    assert (relative_rms(estimate) <= 1.1 * rigs.by_hand(sim.mechanism(str(tmp_path / "arm.xml")), logs)).all()
    assert estimate["halves"]["rms_z"] <= 1.3
    assert (tmp_path / "out" / "model.xml").is_file()


@pytest.mark.usefixtures("undrawn")
def test_a_coupled_wrist_that_stands_at_last(tmp_path):
    """Motors 5 and 6 move joints 5 and 6 together, and the friction is the motors'."""
    six = JOINTS[:6]
    matrix = np.diag([100.0, -100.0, 80.0, 80.0, 50.0, -50.0])
    matrix[4, 5] = matrix[5, 4] = 50.0
    t, q, torque = rigs.coupled(matrix, 14.0, 60.0, stands=3.0)
    columns = {"t": t} | {f"m{k}": x for k, x in enumerate(np.degrees(q).T, start=1)}
    rigs.write_log(tmp_path / "run.csv", columns | {f"i{k}": x for k, x in enumerate((torque / 0.05).T, start=1)})
    motors = {
        "joints": json.dumps(six),
        "matrix": json.dumps(matrix.tolist()),
        "position": ", ".join(f'{{ column = "m{k}", unit = "deg" }}' for k in range(1, 7)).join("[]"),
        "torque": ", ".join(f'{{ column = "i{k}", gain = 0.05, unit = "A" }}' for k in range(1, 7)).join("[]"),
    }
    mapping = "[motors.arm]\n" + "\n".join(f"{key} = {value}" for key, value in motors.items())
    (tmp_path / "columns.toml").write_text(mapping, encoding="utf-8")
    estimate = identified(tmp_path, "--fix", "joint7", "0", *FRICTION)
    assert list(estimate["held_out"]) == list(six)
    assert (relative_rms(estimate)[4:] <= 0.25).all()


@pytest.mark.usefixtures("undrawn")
def test_the_trial_that_disagrees_is_named_and_all_are_fitted_as_one(tmp_path):
    """Six trials of a two-joint arm, one of them with everything a fifth heavier."""
    trials = [tmp_path / f"trial{number}.csv" for number in range(1, 7)]
    for seed, path in enumerate(trials):
        log = shortened(faulty(seed), 250)
        heavier = (1.2 if seed == 3 else 1.0) * log["ground_force"]
        replace(log, measured={**log.measured, "ground_force": heavier}).save(path)
    keys = ("delay", "clock", "origin", "gain", "rotation_deg", "gravity_deg", "zero_deg", "axis_deg")
    (tmp_path / "exact.toml").write_text("[setup]\n" + "".join(f"{key} = 0\n" for key in keys), encoding="utf-8")
    options = ["--columns", str(tmp_path / "exact.toml"), "--base", "base", "--out", str(tmp_path), "--name", "out"]
    assert identify.main([PENDULUM, *map(str, trials), *options]) == 0
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text(encoding="utf-8"))
    apart = np.array(estimate["logs"]["rms_z"])
    assert len(apart) == 6 and apart.argmax() == 3 and apart[3] > FAR_APART
    # The wrong log is found by comparison with the others.
    assert np.delete(apart, 3).max() < 0.5 * apart[3]
    assert 4 in found(estimate, doubt=True)["logs_disagree"]["logs"]
