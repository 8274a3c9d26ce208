"""Valid files of commands other than `identify`, to be damaged."""

import json
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import wrist
from written_formats import write_c3d, write_trc

import scenes

RESULTS = ("first", "second")
"""Folders of results to compare."""

RESULT_FILES = ("estimate.json", "provenance.json")

MARKERS = ("trc", "trc", *(["c3d"] if find_spec("ezc3d") else []))
"""Suffixes of files of markers."""

NAMES = ("m1", "m2rz2", "Ixx2")

WRIST = """[wrenches.wrist]
body = "tool"
force = ["wrist_force.x", "wrist_force.y", "wrist_force.z"]
torque = ["wrist_torque.x", "wrist_torque.y", "wrist_torque.z"]
position = [0, 0, 0.01]
rpy_deg = [0, 0, 45]
applied_to_link = true
"""


def write_other_files(folder: Path) -> None:
    """Writes results to compare, markers, and an arm with a payload."""
    for k, name in enumerate(RESULTS):
        (folder / name).mkdir()
        for file, content in zip(RESULT_FILES, _result(k), strict=True):
            (folder / name / file).write_text(json.dumps(content), encoding="utf-8")
    _write_markers(folder)
    (folder / "wrist.xml").write_text(wrist.model(), encoding="utf-8")
    (folder / "wrist.toml").write_text(WRIST, encoding="utf-8")
    recording = wrist.log(seconds=3.0)
    for ending in ("csv", "npz"):
        recording.save(folder / f"wrist.{ending}")


def _result(k: int) -> tuple[dict, dict]:
    """Files that `identify` writes."""
    estimate = {
        "verdict": "Usable",
        "columns": [*NAMES, "offset(Fx)"],
        "values": [1.0 + k / 10, 2.0, 3.0, 7.0],
        "covariance": np.diag([0.01, 0.04, 0.09, 1]).tolist(),
        "std_setup": [0.2, 0.4, 0.6, 2.0],
        "regrouping": dict(zip(NAMES, ("m1 + m2", "m2rz2", "Ixx2"), strict=True)),
        "held_out": {"Fx": {"ratio": 0.25}},
        "setup": [{"name": "delay", "text": "late"}],
        "bodies": {"base": {"m": 1.0}, "link1": {"m": 2.0}},
    }
    recording = {"model": {"file": "m.xml", "sha256": "0"}, "logs": [{"file": f"{k}.csv", "sha256": str(k)}]}
    options = {"estimator": "trajectory", "fix": [], "gaps": bool(k)}
    return estimate, {"options": options, "recording": recording, "versions": {"multicontact": "1"}, "git_commit": None}


def _write_markers(folder: Path) -> None:
    """Writes a double pendulum with markers, and a trial of it."""
    spec = scenes.load("double_pendulum")
    for body in ("base", "link1", "link2"):
        for k, at in enumerate(((0.1, 0, 0.1), (0, 0.1, 0.2), (-0.1, 0, 0.3))):
            spec.body(body).add_site(name=f"{body}_{k}", pos=at)
    model = spec.compile()
    (folder / "marked.xml").write_text(spec.to_xml(), encoding="utf-8")
    data, time = mujoco.MjData(model), np.arange(40) / 100
    labels = [model.site(k).name for k in range(model.nsite) if model.site(k).name[-2:] in ("_0", "_1", "_2")]
    places = {label: np.empty((len(time), 3)) for label in labels}
    for i, t in enumerate(time):
        data.qpos[:] = 0.3 * np.sin(3 * t + np.arange(model.nq))
        mujoco.mj_kinematics(model, data)
        for label, place in places.items():
            place[i] = data.site(label).xpos
    write_trc(folder / "marked.trc", time, places)
    if "c3d" in MARKERS:
        write_c3d(folder / "marked.c3d", 100.0, places)
