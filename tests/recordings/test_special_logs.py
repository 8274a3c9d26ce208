"""Logs of ball joints, of constant positions, without times, and of poses at rest."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import wrist
from commands import refusal, sentence_of
from malformed_logs import LEG, PLAIN, Q
from mechanisms import random_tree
from recorded_faults import JOINTS, PENDULUM, faulty
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
from experiments.columns import main
from experiments.guesses.belief import write_mapping
from experiments.guesses.guess import believed
from experiments.guesses.log_contents import log_contents
from ident import Body, LogError, Mechanism, Sensors, Tree, read_log
from ident.estimation.preparation import prepared
from ident.mechanism.body import ball_twist
from ident.parameters.structure import sampled_structure, structure
from sim import mechanism

N = 40
RNG, T = np.random.default_rng(0), np.arange(N) / 100
TURNS = Rotation.from_rotvec(np.stack([np.sin(3 * T), np.cos(2 * T), 5 * T], axis=1))
NECK = TURNS.as_quat(scalar_first=True) * RNG.choice([-1, 1], size=(N, 1))
RATES, TORQUES = RNG.normal(size=(2, N, 3))
HEAD = Body("head", -1, np.eye(4), ball_twist(np.zeros(3)), "neck")
ARM = Body("arm", 0, np.eye(4), np.eye(6)[4], "elbow")
MECHANISM = Mechanism(Tree((HEAD, ARM)), np.array([0, 0, -9.81]))
LOG, TILTED = faulty(0), Rotation.from_quat([0.6, 0.0, 0.8, 0.0], scalar_first=True)
POSE = np.vstack([np.column_stack([TILTED.as_matrix(), [1, 2, 3]]), [0, 0, 0, 1]])
WRIST = {"body": "tool", "force": ["fx", "fy", "fz"], "torque": ["mx", "my", "mz"], "position": [0, 0, 0.01]}
WRIST["quaternion"] = [float(x) for x in wrist.FACING.split()]
WRENCHES = {"wrenches": {"wrist": WRIST}}
MAPPING = {"poses": True, **WRENCHES}
ROBOT = mechanism(mujoco.MjSpec.from_string(wrist.model()))


def columns(position="neck_position", velocity="neck_velocity", torque="neck_torque"):
    out = {"time": T, "q_elbow": np.sin(T), "dq_elbow": np.cos(T)}
    for name, x in ((position, NECK), (velocity, RATES), (torque, TORQUES)):
        out |= {f"{name}.{c}": component for c, component in zip("wxyz"[4 - x.shape[1] :], x.T, strict=True)}
    return out


@pytest.mark.parametrize("names", [(), ("q_neck", "dq_neck", "tau_neck"), ("neck",)])
def test_balls_are_found_by_name(names):
    log = read_log(columns(*names), MECHANISM)
    orientation = Rotation.from_quat(log["neck_position"], scalar_first=True)
    np.testing.assert_allclose((orientation.inv() * TURNS).magnitude(), 0, atol=1e-7)
    assert ((log["neck_position"][1:] * log["neck_position"][:-1]).sum(axis=1) > 0).all()
    np.testing.assert_allclose(log["neck_velocity"], RATES)
    np.testing.assert_allclose(log.torques(MECHANISM.tree.joints), np.column_stack([TORQUES, np.full(N, np.nan)]))
    assert log.of_joints(MECHANISM.tree.joints, "position").shape == (N, 5) and not log.unused and not log.notes


def test_what_is_no_quaternion_is_refused():
    whole = columns()
    lacking = {name: x for name, x in whole.items() if name != "neck_position.z"}
    for cells, mapping, expected in (
        (lacking, None, "'neck' needs columns of its positions, named neck_position, q_neck,"),
        (whole | {"neck_position.x": 3 + T}, None, "sample 1, joints.neck.position needs a norm of 1, got"),
        (whole | {"x": T}, {"joints": {"neck": {"position": "x"}}}, "joints.neck.position needs a list of 4 columns"),
    ):
        assert expected in sentence_of(read_log, cells, MECHANISM, mapping)


def test_constants_have_the_times_of_any_file(tmp_path):
    times, angles = {"time": LOG.time}, {f"{joint}_position": LOG[f"{joint}_position"] for joint in JOINTS}
    files = write_csv(tmp_path / "a.csv", times | angles), write_csv(tmp_path / "b.csv", times | {"z": LOG.time})
    base = {"position": [1, 2, 3], "quaternion": [0.6, 0.0, 0.8, 0.0]}
    mapping = {"joints": {JOINTS[0]: {"position": 0.25}}, "base": base}
    log = read_log("+".join(map(str, files)), PENDULUM, mapping)
    assert (log[f"{JOINTS[0]}_position"] == 0.25).all()
    np.testing.assert_allclose(log.base[[0, -1]], [POSE, POSE], atol=1e-12)


def test_a_base_at_a_constant_pose_is_one_at_rest():
    """Poses that move ever so little make a base that moves, with more parameters."""
    turned = replace(PENDULUM, gravity=TILTED.apply(PENDULUM.gravity))
    resting = replace(LOG, base=np.tile(POSE, (len(LOG.time), 1, 1)))
    expected = ident.identify(PENDULUM, LOG, estimator="weighted")
    estimate = ident.identify(turned, resting, estimator="weighted")
    np.testing.assert_allclose(estimate.psi, expected.psi, rtol=1e-9, atol=1e-12)
    assert "The base rests: its recorded pose is constant." in estimate.prepared.notes
    moving = resting.base.copy()
    moving[5, 0, 3] += 1e-9
    other = prepared(turned, replace(resting, base=moving), filters=False)
    assert other.equations.parameters.rank > len(expected)


def test_columns_takes_a_rate_and_writes_it(tmp_path, capsys):
    path = write_csv(tmp_path / "log.csv", {name: x for name, x in PLAIN.items() if name != "time"})
    write_mapping(tmp_path / "c.toml", believed(LEG, [path], rate=100.0))
    np.testing.assert_allclose(read_log(path, LEG, tmp_path / "c.toml").measured["hip_position"], Q[:, 1])
    assert log_contents(write_csv(tmp_path / "timed.csv", PLAIN), rate=7.0).rate == pytest.approx(100)
    with pytest.raises(LogError, match="a log needs one, or --rate HZ"):
        log_contents(write_csv(tmp_path / "log.csv", {"a": np.cos(np.arange(50)), "b": np.sin(np.arange(50))}))
    message = refusal(main, ["model.xml", "log.csv", "--rate", "-3"], capsys)
    assert "needs a number of samples per second, in Hz, got '-3'" in message


def pose_columns(poses, seed=0):
    """Random poses of the arm, and what its wrist sensor reads of the tool's weight."""
    rng, (body, sensor) = np.random.default_rng(seed), ROBOT.site("wrist")
    q = rng.uniform(-1.5, 1.5, (poses, 7))
    R = ROBOT.tree.poses(q)[:, ROBOT.tree.names.index(body), :3, :3] @ sensor[:3, :3]
    weight = wrist.TOOL["mass"] * ROBOT.gravity @ R
    # What acts on the tool at the sensor carries its weight.
    centre = np.linalg.solve(sensor, [*wrist.TOOL["com"], 1])[:3]
    wrench = -np.hstack([weight, np.cross(centre, weight)]) + [3, -2, 5, 0.1, -0.2, 0.05]
    wrench += np.repeat([0.02, 0.001], 3) * rng.normal(size=wrench.shape)
    own = {name: wrench[:, k] for k, name in enumerate((*WRIST["force"], *WRIST["torque"]))}
    return own | {f"joint{k + 1}_position": q[:, k] for k in range(7)}


@pytest.mark.parametrize(("poses", "step"), [(10, None), (17, -1.0)])
def test_ten_poses_give_mass_and_centre_without_times_or_with_any(poses, step):
    truth, distances = np.array([wrist.TOOL["mass"], *wrist.TOOL["com"]]), []
    for seed in range(2):
        log = pose_columns(poses, seed) | ({} if step is None else {"time": step * np.arange(poses)})
        payload = ident.identify_payload(ROBOT, read_log(log, ROBOT, MAPPING), body="tool", sensor="wrist")
        body = payload.in_frame()
        distances.append((body.values[:4] - truth) / body.std_setup[:4])
        assert body.identifiable.tolist() == 4 * [True] + 6 * [False]
        assert abs(body.values[0] / truth[0] - 1) < 0.05 and payload.verdict().usable
        assert payload.sensor_parameters[0].name == "offset(Fx)" and np.isclose(payload.model[0], truth[0])
    assert (np.abs(distances) < 2.5).mean() > 0.85


def test_the_structure_of_poses_is_that_of_sampled_ones():
    for seed in range(2):
        rng = np.random.default_rng(seed)
        any_arm = Mechanism(random_tree(rng, bodies=4), 5 * rng.normal(size=3))
        for wrench, torques, moving in ((1, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)):
            rows = rng.normal(size=(2, 6)) if wrench and seed % 2 else None
            sensors = Sensors(bool(wrench), bool(torques), bool(moving), rows, still=True)
            own, sampled = structure(any_arm, sensors).matrix, sampled_structure(any_arm, sensors)
            every = [x / max(np.abs(x).max(initial=0), 1e-300) for x in (own, sampled)]
            assert len({np.linalg.matrix_rank(x, tol=1e-9) if x.size else 0 for x in (*every, np.vstack(every))}) == 1


def test_a_hint_where_a_log_looks_like_poses():
    hint = " If each row is a pose at rest, say poses = true in the columns file."
    log, minutes = pose_columns(17), 60.0 * np.arange(17)
    clock, payload = {"time": {"column": "t", "unit": "s"}}, {"body": "tool", "sensor": "wrist"}
    torques = {f"joint{k}_torque": np.cos(k + np.arange(17)) for k in range(1, 8)}
    slow = read_log({"t": minutes, **log}, ROBOT, clock | WRENCHES)
    few = read_log({"t": minutes, **log, **torques}, ROBOT, clock)
    gap = {"t": minutes + 540 * (minutes > 900), **log}
    for sentence, words in (
        (sentence_of(read_log, log, ROBOT, WRENCHES), "needs a column of times"),
        (sentence_of(read_log, {"time": minutes, **log}, ROBOT, WRENCHES), "steps of 60 s, which suggests "),
        (sentence_of(read_log, gap, ROBOT, clock | WRENCHES), "has a gap of "),
        (sentence_of(ident.identify_payload, ROBOT, slow, **payload), "a sample every 60 s shows no payload."),
        (sentence_of(ident.identify, ROBOT, few), "are too few for "),
    ):
        assert words in sentence and hint in sentence
    with pytest.raises(LogError, match="poses needs true, if each row is a pose at rest, or false; got 3"):
        read_log(log, ROBOT, WRENCHES | {"poses": 3})
    poses = read_log(pose_columns(12), ROBOT, MAPPING)
    assert ident.identify_payload(ROBOT, poses, **payload, offsets=False).estimate.base.rank == 4
    with pytest.raises(ident.InputError, match="poses at rest and logs of motions"):
        ident.identify_payload(ROBOT, [poses, wrist.log(seconds=8.0)], **payload)
