"""Logs of poses at rest: gravity alone acts, whatever their times are."""

from functools import cache

import numpy as np
import pytest
import wrist
from mechanisms import random_tree

import ident
from ident.errors import InputError, LogError
from ident.mechanism.mechanism import Mechanism
from ident.parameters.structure import Sensors, sampled_structure, structure_matrix
from ident.recordings.log import read_log
from sim.models.model_mechanism import mechanism

WRENCH = {"body": "tool", "force": ["fx", "fy", "fz"], "torque": ["mx", "my", "mz"], "position": [0, 0, 0.01]}
WRENCH["quaternion"] = [float(x) for x in wrist.FACING.split()]
MAPPING = {"poses": True, "wrenches": {"wrist": WRENCH}}
OFFSETS = np.array([3, -2, 5, 0.1, -0.2, 0.05])


@cache
def arm():
    import mujoco

    return mechanism(mujoco.MjSpec.from_string(wrist.model()))


def columns(poses, seed=0, noise=1.0):
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
        log = columns(poses, seed)
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


def test_without_noise_nothing_is_wrong():
    payload = ident.identify_payload(
        arm(), read_log(columns(12, noise=1e-6), arm(), MAPPING), body="tool", sensor="wrist", offsets=False
    )
    with pytest.raises(InputError, match="poses at rest and logs of motions"):
        ident.identify_payload(
            arm(), [read_log(columns(12), arm(), MAPPING), wrist.log(seconds=8.0)], body="tool", sensor="wrist"
        )
    assert payload.estimate.base.rank == 4


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
    log = columns(17)
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
        read_log(columns(9), arm(), MAPPING)
