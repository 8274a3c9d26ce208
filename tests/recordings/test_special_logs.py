"""Logs of ball joints, of constant positions, and without times."""

from dataclasses import replace

import numpy as np
import pytest
from malformed_logs import LEG, PLAIN, Q, read
from recorded_faults import JOINTS, PENDULUM, faulty
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
from experiments.columns import main
from experiments.guesses.belief import toml_text
from experiments.guesses.guess import believed
from experiments.guesses.log_contents import log_contents
from ident.errors import LogError
from ident.estimation.preparation import prepared
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


def check(log):
    orientation = Rotation.from_quat(log["neck_position"], scalar_first=True)
    np.testing.assert_allclose((orientation.inv() * TURNS).magnitude(), 0, atol=1e-7)
    assert ((log["neck_position"][1:] * log["neck_position"][:-1]).sum(axis=1) > 0).all()
    np.testing.assert_allclose(log["neck_velocity"], RATES)
    np.testing.assert_allclose(log.torques(MECHANISM.tree.joints), np.column_stack([TORQUES, np.full(N, np.nan)]))
    assert log.of_joints(MECHANISM.tree.joints, "position").shape == (N, 5)


@pytest.mark.parametrize("names", [(), ("q_neck", "dq_neck", "tau_neck"), ("neck",)])
def test_balls_are_found_by_name(tmp_path, names):
    log = read(tmp_path, columns(*names), mechanism=MECHANISM)
    check(log)
    assert not log.unused and not log.notes


REFUSED = {
    "no column": ("neck_position.z", None, None, "'neck' needs columns of its positions, named neck_position, q_neck,"),
    "norm": ("neck_position.x", 3 + T, None, "row 2, joints.neck.position needs a norm of 1, got"),
    "one column": ("x", T, '[joints.neck]\nposition = "x"', "joints.neck.position needs a list of 4 columns, got x"),
    "motor": ("x", T, '[motors.m]\njoints = ["neck"]\nmatrix = [[1]]', "motors.m.joints needs a list of joints, of"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_quaternion_is_refused(tmp_path, name):
    column, x, mapping, expected = REFUSED[name]
    cells = {key: value for key, value in columns().items() if key != column} | ({} if x is None else {column: x})
    with pytest.raises(LogError) as error:
        read(tmp_path, cells, mapping, MECHANISM)
    assert expected in str(error.value) and "\n" not in str(error.value)


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


UNTIMED = {name: x for name, x in PLAIN.items() if name != "time"}


def written(path, columns):
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


def test_columns_takes_a_rate_and_writes_it(tmp_path, capsys):
    path = written(tmp_path / "log.csv", UNTIMED)
    belief = believed(LEG, [path], rate=100.0)
    (tmp_path / "c.toml").write_text(toml_text(belief), encoding="utf-8")
    np.testing.assert_allclose(read_log(path, LEG, tmp_path / "c.toml").measured["hip_position"], Q[:, 1])
    assert log_contents(written(tmp_path / "timed.csv", PLAIN), rate=7.0).rate == pytest.approx(100)
    with pytest.raises(LogError, match="a log needs one, or --rate HZ"):
        log_contents(written(tmp_path / "log.csv", {"a": np.cos(np.arange(50)), "b": np.sin(np.arange(50))}))
    with pytest.raises(SystemExit):
        main(["model.xml", "log.csv", "--rate", "-3"])
    assert "needs a number of samples per second, in Hz, got '-3'" in capsys.readouterr().err
