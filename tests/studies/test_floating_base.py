"""A person on plates by the command line: the pelvis as joints from the world, and as a measured pose."""

import json

import numpy as np
import pytest
import walker
from scipy.spatial.transform import Rotation

import ident
from experiments import identify

RAIL = """
[wrenches.plate]
frame = "world"
on = "pelvis"
force = ["fx", "fy", "fz"]
point = ["px", "py", 0.0]
free_moment = ["", "", "free"]
[wrenches.rail]
frame = "plate"
on = "arm"
position = [0.3, -0.2, 1.0]
rpy_deg = [0, 0, 90]
force = ["rx", "ry", "rz"]
torque = ["ra", "rb", "rc"]
"""
POSE = '[base]\nposition = ["x", "y", "z"]\nquaternion = ["qw", "qx", "qy", "qz"]\n'
PLACE = np.array([[0, -1, 0, 0.3], [1, 0, 0, -0.2], [0, 0, 1, 1.0], [0, 0, 0, 1]])


def log(folder, *, posed, scale=1.0):
    """Model, log and mapping: a plate under the pelvis and a rail; the plate's readings may be scaled."""
    (time, q, dq, ddq), (total, places) = walker.motion(), walker.truth(walker.SMALL)
    rng, share = np.random.default_rng(0), 0.2 + 0.1 * np.sin(3 * time)
    plate = scale * (1 - share)[:, None] * total
    point, free = walker.centre_of_pressure(plate)
    rail = walker.in_frame(PLACE, share[:, None] * total)
    columns = dict(zip(("fx", "fy", "fz", "px", "py", "free"), (*plate[:, :3].T, *point.T, free), strict=True))
    columns |= dict(zip(("rx", "ry", "rz", "ra", "rb", "rc"), rail.T, strict=True))
    columns = {name: x + 0.1 * rng.normal(size=len(x)) * (name[0] != "p") for name, x in columns.items()}
    joints = walker.mechanism(walker.SMALL).tree.joints
    states = {}
    for k, joint in enumerate(joints):
        states |= {f"q_{joint}": q[:, k], f"dq_{joint}": dq[:, k], f"ddq_{joint}": ddq[:, k]}
    if posed:
        states = {name: x for name, x in states.items() if name == "q_shoulder"}
        states |= dict(zip("xyz", places["pelvis"][:, :3, 3].T, strict=True))
        turns = Rotation.from_matrix(places["pelvis"][:, :3, :3]).as_quat(scalar_first=True)
        states |= dict(zip(("qw", "qx", "qy", "qz"), turns.T, strict=True))
    np.savez(folder / "log.npz", time=time, **states, **columns)
    (folder / "columns.toml").write_text(RAIL + POSE * posed, encoding="utf-8")
    (folder / "person.xml").write_text(walker.SMALL, encoding="utf-8")
    return [str(folder / "person.xml"), str(folder / "log.npz"), "--columns", str(folder / "columns.toml")]


def truth():
    person = walker.mechanism(walker.SMALL)
    parameters = ident.find_base_parameters(person)
    return dict(zip(parameters.names, parameters.regroup(person.known), strict=True))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("posed", [False, True])
def test_contacts_alone_identify_a_floating_base(tmp_path, posed):
    options = ["--base", "pelvis", "--cutoff", "12"] if posed else []
    files = log(tmp_path, posed=posed)
    assert identify.main([*files, *options, "--estimator", "ordinary", "--name", "out", "--out", str(tmp_path)]) == 0
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text(encoding="utf-8"))
    own, expected = dict(zip(estimate["columns"], estimate["values"], strict=True)), truth()
    # A pose is differentiated; joints' accelerations are the log's.
    near = 0.03 if posed else 0.003
    for name, value in expected.items():
        assert abs(own[name] - value) < near * max(map(abs, expected.values())), name
