"""Recordings of the paper's pendulum with laboratory errors: angles and a ground wrench, with small set-up errors."""

from dataclasses import replace
from functools import cache

import numpy as np
from mechanisms import by_joint
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from sim.motion.excitation import DOUBLE_PENDULUM

PENDULUM = sim.mechanism(scenes.load("double_pendulum"), base="base")
JOINTS = PENDULUM.tree.joints
TRUTH = ident.find_base_parameters(PENDULUM).regroup(PENDULUM.known)


def angles_and_wrench(time, q, wrench, **faults):
    wrench = {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]}
    return ident.Recording(time, by_joint(JOINTS, position=q) | wrench, **faults)


def leaning(spans, force, body="link2", point=(0, 0, 0.1), **faults):
    """A body leans in some spans (s) on what pushes it with a force in the base's axes at a point of its frame (m)."""
    recording = faulty(**faults)
    t, q = recording.time, recording.of_joints(JOINTS, "position")
    share = sum(np.clip(np.minimum(t - first, last - t) / 0.06, 0, 1) for first, last in spans)
    pose = PENDULUM.tree.poses(q)[:, PENDULUM.tree.names.index(body)]
    at = pose[:, :3, 3] + pose[:, :3, :3] @ np.array(point)
    carried = share[:, None] * np.hstack([np.broadcast_to(force, at.shape), np.cross(at, force)])
    return angles_and_wrench(t, q, wrench_of(recording) - carried)


@cache
def faulty(seed=0, *, delay=0.0, fast=0.0, origin=(0, 0, 0), turn=(0, 0, 0), gains=(1,) * 6, zero=(0, 0), gravity=0.0):
    """943 samples at 100 Hz with noise; delay in s, origin in m; turn, zero and tilt of gravity about x in degrees."""
    recording = sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, seed=seed)
    true, t = recording.noise_free, recording.time
    wrench = wrench_of(true)
    noise = wrench_of(recording) - wrench
    if gravity:
        tilted = Rotation.from_euler("x", gravity, degrees=True).apply(PENDULUM.gravity)
        wrench = ident.base_wrench_regressor(PENDULUM.tree, *true.joint_states(JOINTS), gravity=tilted) @ PENDULUM.known
    when = t[0] + (t - t[0]) * (1 - fast) - delay
    wrench = np.stack([np.interp(when, t, x) for x in wrench.T], axis=1)
    moment = wrench[:, 3:] - np.cross(origin, wrench[:, :3])
    R = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    wrench = np.hstack([wrench[:, :3] @ R, moment @ R]) * gains + noise
    q = recording.of_joints(JOINTS, "position") + np.radians(zero)
    known = slice(round(100 * delay), None)  # Before the first sample there are no data that could be delayed.
    return angles_and_wrench(t[known], q[known], wrench[known])


@cache
def estimated(seed=0, **faults):
    return ident.identify(PENDULUM, faulty(seed, **faults))


def wrench_of(recording):
    return np.hstack([recording["ground_force"], recording["ground_torque"]])


def shortened(recording, samples):
    channels = {name: x[:samples] for name, x in recording.measured.items()}
    return replace(recording, time=recording.time[:samples], measured=channels)


def with_torques(seed=0, *, pull=0.0, wrench=True):
    """Joint torques, with the base wrench or without, while a cable of some stiffness (N/m) pulls the last link."""
    recording = sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, seed=seed)
    states = recording.noise_free.joint_states(JOINTS)
    torques = ident.joint_torque_regressor(PENDULUM.tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    poses = PENDULUM.tree.poses(states[0])[:, [PENDULUM.tree.names.index(name) for name in ("link1", "link2")]]
    at = poses[:, 1, :3, 3] + poses[:, 1, :3, :3] @ [0, 0, 0.3]
    force = pull * ([0.3, 0.2, 1.5] - at)
    # Both joints turn about x.
    torques -= np.cross(at[:, None] - poses[:, :, :3, 3], force[:, None])[:, :, 0]
    torques += 0.05 * np.random.default_rng(seed).normal(size=torques.shape)
    carried = wrench_of(recording) - np.hstack([force, np.cross(at, force)])
    whole = angles_and_wrench(recording.time, recording.of_joints(JOINTS, "position"), carried)
    kept = {name: x for name, x in whole.measured.items() if wrench or not name.startswith("ground")}
    return ident.Recording(recording.time, kept | by_joint(JOINTS, torque=torques))
