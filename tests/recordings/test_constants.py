"""Positions that are known to be constant are numbers in the mapping; a base at a constant pose is a base at rest."""

from dataclasses import replace

import numpy as np
from recorded_faults import JOINTS, PENDULUM, faulty
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
from experiments.studies.user_files import prepare
from ident.estimation.preparation import prepared
from ident.recordings.log import read_log

TILTED = [0.6, 0.0, 0.8, 0.0]
R = Rotation.from_quat(TILTED, scalar_first=True).as_matrix()
LOG = faulty(0)
COLUMNS = {"time": LOG.time} | {f"{joint}_position": LOG[f"{joint}_position"] for joint in JOINTS}


def with_base(position, quaternion, **others):
    return {"base": {"position": position, "quaternion": quaternion, **others}}


def test_constants_have_the_times_of_any_file(tmp_path):
    for name, columns in (("a.csv", COLUMNS), ("b.csv", {"time": LOG.time, "z": LOG.time})):
        write_csv(tmp_path / name, columns)
    mapping = {"joints": {JOINTS[0]: {"position": 0.25}}} | with_base([1, 2, 3], TILTED)
    log = read_log(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}", PENDULUM, mapping)
    assert (log[f"{JOINTS[0]}_position"] == 0.25).all()
    np.testing.assert_allclose(log.base[[0, -1], :3, 3], [[1, 2, 3]] * 2)


def resting(quaternion, **others):
    """A recording of the pendulum, as if on a base at a constant pose."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), [1, 2, 3]
    return replace(others.pop("log", LOG), base=np.tile(T, (len(LOG.time), 1, 1)), **others)


def test_a_base_at_a_constant_pose_is_one_at_rest():
    turned = replace(PENDULUM, gravity=R @ PENDULUM.gravity)
    estimates = [ident.identify(PENDULUM, LOG, estimator="weighted")]
    estimates.append(ident.identify(turned, resting(TILTED), estimator="weighted"))
    # Poses that move ever so little make a base that moves, with more parameters.
    moving = resting(TILTED).base.copy()
    moving[5, 0, 3] += 1e-9
    other = prepared(turned, replace(resting(TILTED), base=moving), filters=False)
    assert estimates[1].names == estimates[0].names and other.equations.parameters.rank > len(estimates[0])
    np.testing.assert_allclose(estimates[1].psi, estimates[0].psi, rtol=1e-9, atol=1e-12)
    assert "The base rests: its recorded pose is constant." in estimates[1].prepared.notes


FLOATING = """<mujoco><worldbody><body name="base"><freejoint name="root"/>
<inertial pos="0 0 0.05" mass="5" diaginertia=".1 .1 .1"/>
<body name="arm" pos="0 0 .1"><joint name="turn" axis="0 1 0"/>
<inertial pos="0 0.01 .2" mass="2" diaginertia=".02 .02 .004"/></body></body></worldbody></mujoco>"""


def test_a_free_joint_may_have_a_constant_position(tmp_path):
    t = LOG.time
    (tmp_path / "float.xml").write_text(FLOATING)
    columns = {"time": t, "turn_position": np.sin(t), "turn_torque": np.cos(2 * t)}
    write_csv(tmp_path / "log.csv", columns)
    free = "".join(f'[joints."root:{axis}"]\nposition = {k}.5\n' for k, axis in enumerate("xyz"))
    (tmp_path / "c.toml").write_text(free + "[joints.root]\nposition = [1, 0, 0, 0]\n")
    ready = prepare(tmp_path / "float.xml", tmp_path / "log.csv", columns=tmp_path / "c.toml", filters=False)
    assert ready.equations.channels == ("turn",)
    np.testing.assert_array_equal(
        ready.recording.of_joints(("root:x", "root:y", "root:z"), "position")[7], [0.5, 1.5, 2.5]
    )
