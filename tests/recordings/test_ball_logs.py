"""Logs of ball joints: quaternions by name or mapped, their signs, missing components, and errors."""

import numpy as np
import pytest
from malformed_logs import text
from scipy.spatial.transform import Rotation

from ident.errors import LogError
from ident.mechanism.body import Body, ball_twist
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.log import read_log

N = 40
RNG = np.random.default_rng(0)
T = np.arange(N) / 100
TURNS = Rotation.from_rotvec(np.stack([np.sin(3 * T), np.cos(2 * T), 5 * T], axis=1))
NECK = TURNS.as_quat(scalar_first=True) * RNG.choice([-1, 1], size=(N, 1))
RATES, TORQUES, ELBOW = RNG.normal(size=(N, 3)), RNG.normal(size=(N, 3)), np.sin(T)
HEAD = Body("head", -1, np.eye(4), ball_twist(np.zeros(3)), "neck")
ARM = Body("arm", 0, np.eye(4), np.eye(6)[4], "elbow")
MECHANISM = Mechanism(Tree((HEAD, ARM)), np.array([0, 0, -9.81]))


def columns(position="neck_position", velocity="neck_velocity", torque="neck_torque"):
    out = {"time": T, "q_elbow": ELBOW, "dq_elbow": np.cos(T)}
    out |= {f"{position}.{c}": x for c, x in zip("wxyz", NECK.T, strict=True)}
    out |= {f"{velocity}.{c}": x for c, x in zip("xyz", RATES.T, strict=True)}
    return out | {f"{torque}.{c}": x for c, x in zip("xyz", TORQUES.T, strict=True)}


def read(tmp_path, cells, mapping=None, **options):
    (tmp_path / "log.csv").write_text(text(cells))
    (tmp_path / "c.toml").write_text(mapping or "")
    return read_log(tmp_path / "log.csv", MECHANISM, tmp_path / "c.toml" if mapping else None, **options)


def check(log):
    orientation = Rotation.from_quat(log["neck_position"], scalar_first=True)
    np.testing.assert_allclose((orientation.inv() * TURNS).magnitude(), 0, atol=1e-7)
    assert ((log["neck_position"][1:] * log["neck_position"][:-1]).sum(axis=1) > 0).all()
    np.testing.assert_allclose(log["neck_velocity"], RATES)
    np.testing.assert_allclose(log.torques(MECHANISM.tree.joints), np.column_stack([TORQUES, np.full(N, np.nan)]))
    assert log.of_joints(MECHANISM.tree.joints, "position").shape == (N, 5)


@pytest.mark.parametrize("names", [(), ("q_neck", "dq_neck", "tau_neck"), ("neck",)])
def test_balls_are_found_by_name(tmp_path, names):
    log = read(tmp_path, columns(*names))
    check(log)
    assert not log.unused and not log.notes


REFUSED = {
    "no column": ("neck_position.z", None, None, "'neck' needs columns of its positions, named neck_position, q_neck,"),
    "norm": ("neck_position.x", 3 + T, None, "row 2, joints.neck.position needs a norm of 1, got"),
    "one column": ("x", T, '[joints.neck]\nposition = "x"', "joints.neck.position needs a list of 4 columns, got x"),
    "three": ("x", T, '[joints.neck]\nposition = ["a", "b", "c"]', "joints.neck.position needs a list of 4 columns"),
    "motor": (
        "x",
        T,
        '[motors.m]\njoints = ["neck"]\nmatrix = [[1]]',
        "motors.m.joints needs a list of joints, of elbow",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_quaternion_is_refused(tmp_path, name):
    column, x, mapping, expected = REFUSED[name]
    cells = {key: value for key, value in columns().items() if key != column} | ({} if x is None else {column: x})
    with pytest.raises(LogError) as error:
        read(tmp_path, cells, mapping)
    assert expected in str(error.value) and "\n" not in str(error.value)
