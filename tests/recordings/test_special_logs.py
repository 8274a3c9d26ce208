"""Logs of ball joints, of constant positions, without times, and of poses at rest."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import wrist
from commands import sentence_of
from malformed_logs import LEG, PLAIN, Q, read
from mechanisms import random_tree
from recorded_faults import JOINTS, PENDULUM, faulty
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
from experiments.columns import main
from experiments.guesses.belief import toml_text
from experiments.guesses.guess import believed
from experiments.guesses.log_contents import log_contents
from ident.errors import InputError, LogError
from ident.estimation.preparation import prepared
from ident.mechanism.body import Body, ball_twist
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.structure import Sensors, sampled_structure, structure_matrix
from ident.recordings.log import read_log
from sim.models.model_mechanism import mechanism

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
    assert expected in sentence_of(read, tmp_path, cells, mapping, MECHANISM)


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


def test_columns_takes_a_rate_and_writes_it(tmp_path, capsys):
    path = write_csv(tmp_path / "log.csv", UNTIMED)
    belief = believed(LEG, [path], rate=100.0)
    (tmp_path / "c.toml").write_text(toml_text(belief), encoding="utf-8")
    np.testing.assert_allclose(read_log(path, LEG, tmp_path / "c.toml").measured["hip_position"], Q[:, 1])
    assert log_contents(write_csv(tmp_path / "timed.csv", PLAIN), rate=7.0).rate == pytest.approx(100)
    with pytest.raises(LogError, match="a log needs one, or --rate HZ"):
        log_contents(write_csv(tmp_path / "log.csv", {"a": np.cos(np.arange(50)), "b": np.sin(np.arange(50))}))
    with pytest.raises(SystemExit):
        main(["model.xml", "log.csv", "--rate", "-3"])
    assert "needs a number of samples per second, in Hz, got '-3'" in capsys.readouterr().err


WRENCH = {"body": "tool", "force": ["fx", "fy", "fz"], "torque": ["mx", "my", "mz"], "position": [0, 0, 0.01]}
WRENCH["quaternion"] = [float(x) for x in wrist.FACING.split()]
MAPPING = {"poses": True, "wrenches": {"wrist": WRENCH}}
OFFSETS = np.array([3, -2, 5, 0.1, -0.2, 0.05])


@cache
def arm():
    import mujoco

    return mechanism(mujoco.MjSpec.from_string(wrist.model()))


def pose_columns(poses, seed=0, noise=1.0):
    """Random poses of the arm, and what its wrist sensor reads of the tool's weight."""
    rng, tree = np.random.default_rng(seed), arm().tree
    q = rng.uniform(-1.5, 1.5, (poses, 7))
    R = tree.poses(q)[:, tree.names.index("tool"), :3, :3] @ sensor()[:3, :3]
    weight = wrist.TOOL["mass"] * arm().gravity @ R
    # What acts on the tool at the sensor carries its weight.
    centre = np.linalg.solve(sensor(), [*wrist.TOOL["com"], 1])[:3]
    wrench = -np.hstack([weight, np.cross(centre, weight)]) + OFFSETS
    wrench += noise * np.repeat([0.02, 0.001], 3) * rng.normal(size=wrench.shape)
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    return dict(zip((f"joint{k}_position" for k in range(1, 8)), q.T, strict=True)) | dict(
        zip(names, wrench.T, strict=True)
    )


def sensor():
    body, pose = arm().site("wrist")
    assert body == "tool"
    return pose


@pytest.mark.parametrize(("poses", "times"), [(10, None), (10, "minutes"), (17, "backwards")])
def test_ten_poses_give_mass_and_centre(poses, times):
    distances = []
    for seed in range(2):
        log = pose_columns(poses, seed)
        log |= {} if times is None else {"time": np.arange(poses) * (60.0 if times == "minutes" else -1.0)}
        recording = read_log(log, arm(), MAPPING)
        payload = ident.identify_payload(arm(), recording, body="tool", sensor="wrist")
        body = payload.in_frame()
        truth = np.array([wrist.TOOL["mass"], *wrist.TOOL["com"]])
        distances.append((body.values[:4] - truth) / body.std_setup[:4])
        assert body.identifiable.tolist() == 4 * [True] + 6 * [False]
        assert abs(body.values[0] / truth[0] - 1) < 0.05 and payload.verdict().usable
        assert payload.sensor_parameters[0].name == "offset(Fx)"
        assert np.isclose(payload.model[0], truth[0])
    assert (np.abs(distances) < 2.5).mean() > 0.85


def test_the_structure_of_poses_is_that_of_sampled_ones():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        any_arm = Mechanism(random_tree(rng, bodies=4), 5 * rng.normal(size=3))
        for wrench, torques, moving in ((1, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)):
            rows = rng.normal(size=(2, 6)) if wrench and seed % 2 else None
            sensors = Sensors(bool(wrench), bool(torques), bool(moving), rows, still=True)
            every = [structure_matrix(any_arm, sensors), sampled_structure(any_arm, sensors)]
            every = [x / max(np.abs(x).max(initial=0), 1e-300) for x in every]
            ranks = {np.linalg.matrix_rank(x, tol=1e-9) if x.size else 0 for x in (*every, np.vstack(every))}
            assert len(ranks) == 1


def test_a_hint_where_a_log_looks_like_poses(tmp_path):
    mapping = {"wrenches": MAPPING["wrenches"]}
    hint = r" If each row is a pose at rest, say poses = true in the columns file\."
    log = pose_columns(17)
    with pytest.raises(LogError, match=rf"needs a column of times.*{hint}"):
        read_log(log, arm(), mapping)
    with pytest.raises(LogError, match=rf"steps of 60 s, which suggests .*{hint}$"):
        read_log({"time": 60.0 * np.arange(17), **log}, arm(), mapping)
    odd = {"time": {"column": "t", "unit": "s"}, **mapping}
    with pytest.raises(LogError, match=rf"has a gap of 600 s.*{hint}$"):
        read_log({"t": np.cumsum([60] * 16 + [600]), **log}, arm(), odd)
    slow = read_log({"t": 60.0 * np.arange(17), **log}, arm(), odd)
    with pytest.raises(InputError, match=rf"^A motion with a sample every 60 s shows no payload\.{hint}$"):
        ident.identify_payload(arm(), slow, body="tool", sensor="wrist")
    torques = {f"joint{k}_torque": np.cos(k + np.arange(17)) for k in range(1, 8)}
    few = read_log({"t": 60.0 * np.arange(17), **log, **torques}, arm(), {"time": odd["time"]})
    with pytest.raises(InputError, match=rf"^17 samples, .* are too few for .*{hint}$"):
        ident.identify(arm(), few)
    with pytest.raises(LogError, match="poses needs true, if each row is a pose at rest, or false; got 3"):
        read_log(log, arm(), {**MAPPING, "poses": 3})
    with pytest.raises(LogError, match="at least 10 samples, it has 9"):
        read_log(pose_columns(9), arm(), MAPPING)
    poses = read_log(pose_columns(12), arm(), MAPPING)
    assert ident.identify_payload(arm(), poses, body="tool", sensor="wrist", offsets=False).estimate.base.rank == 4
    with pytest.raises(InputError, match="poses at rest and logs of motions"):
        ident.identify_payload(arm(), [poses, wrist.log(seconds=8.0)], body="tool", sensor="wrist")
