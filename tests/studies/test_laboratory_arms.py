"""Arms as laboratories log them, from their files to answers by the commands: torques, currents, a coupled wrist."""

import json

import numpy as np
import pytest
import rigs
import wrist

import sim
from experiments import identify

JOINTS = wrist.JOINTS
FRICTION = ["--drive", "viscous", "coulomb"]


def identified(folder, *options, logs=("run.csv",)):
    """What `identify` finds in a folder's logs with the model that has a hand."""
    (folder / "arm.xml").write_text(wrist.model(tool=rigs.HAND), encoding="utf-8")
    files = [str(folder / name) for name in ("arm.xml", *logs)]
    where = ["--columns", str(folder / "columns.toml"), "--out", str(folder), "--name", "out"]
    assert identify.main([*files, *where, *options]) == 0
    return json.loads((folder / "out" / "estimate.json").read_text(encoding="utf-8"))


def relative_rms(found):
    return np.array([each["relative_rms"] for each in found["held_out"].values()])


def doubts(found):
    return " ".join(each["text"] for each in found["findings"] if each["doubt"])


@pytest.mark.usefixtures("undrawn")
def test_link_torques_with_late_samples_and_a_hand_that_was_not_there(tmp_path):
    rng = np.random.default_rng(4)
    t, q, dq, torque = rigs.moved(tuple(rigs.NO_HAND.items()), 12.0, 60.0)
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

    found = identified(tmp_path, "--gaps", *FRICTION)
    assert "look as if 'tool' was not carried" in doubts(found) and "--drive" not in doubts(found)
    arm = sim.mechanism(str(tmp_path / "arm.xml"))
    assert (relative_rms(found) <= 1.1 * rigs.by_hand(arm, [(stamps[there], q, torque)])).all()
    assert found["halves"]["rms_z"] <= 1.3
