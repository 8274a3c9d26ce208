"""Arms with drivers' joint names, with motions and their torques by MuJoCo's inverse dynamics."""

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
import wrist

import sim
from ident.mechanism.mechanism import Mechanism

UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
"""Joints of Universal Robots from the base on; ROS often sorts them alphabetically."""

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")

UR_LINKS = (
    ("0 0 0.09", "0 0 1", 3.7, "0 -0.02 0.01"),
    ("0 0.14 0", "0 1 0", 8.4, "0 0 0.28"),
    ("0 -0.12 0.42", "0 1 0", 2.3, "0 0.01 0.25"),
    ("0 0 0.39", "0 1 0", 1.2, "0.01 0.09 0.02"),
    ("0 0.09 0", "0 0 1", 1.2, "0.03 0.01 0.05"),
    ("0 0 0.09", "0 1 0", 0.6, "0.04 0.05 0.03"),
)
"""Position, axis, mass and centre of mass of each link."""


@dataclass(frozen=True, eq=False)
class Robot:
    """An arm and its recording: times (N,), states and torques (N, n), and the ground's wrench on the base (N, 6)."""

    mechanism: Mechanism
    joints: tuple[str, ...]
    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    tau: np.ndarray
    base: np.ndarray


@cache
def ur():
    """A robot like Universal Robots' 5."""
    links = [
        f'<body name="link{k}" pos="{place}"><joint name="{joint}" axis="{axis}"/><inertial mass="{mass}" pos="{com}" '
        'diaginertia="0.02 0.02 0.01"/>'
        for k, ((place, axis, mass, com), joint) in enumerate(zip(UR_LINKS, UR, strict=True), start=1)
    ]
    return _recorded("".join(links) + "</body>" * len(links), UR)


@cache
def seven(pattern="panda_joint{}", fingers=False):
    """A robot like Franka's or KUKA's with seven joints, perhaps with two fingers."""
    names = [pattern.format(k) for k in range(1, 8)]
    fingered = "".join(
        f'<body name="finger{k}"><joint name="{name}" type="slide" axis="0 {y} 0"/>'
        '<inertial mass="0.05" pos="0 0 0.03" diaginertia="1e-5 1e-5 1e-5"/></body>'
        for k, (name, y) in enumerate(zip(FINGERS, (1, -1), strict=True))
    )
    text = wrist.model(beyond=fingered if fingers else "")
    for k in range(7, 0, -1):
        text = text.replace(f'"joint{k}"', f'"{names[k - 1]}"')
    return _recorded(text.split("<worldbody>")[1].split("</worldbody>")[0], tuple(names))


def _recorded(bodies, joints):
    """A motion of six seconds, with its torques and base wrench."""
    spec = mujoco.MjSpec.from_string(f'<mujoco><worldbody><body name="base">{bodies}</body></worldbody></mujoco>')
    model = spec.compile()
    data, n = mujoco.MjData(model), len(joints)
    time, q, dq, ddq = wrist.motion(6.0)
    order = np.random.default_rng(3)
    tau, ground = np.empty((len(time), n)), np.empty((len(time), 6))
    for k in range(len(time)):
        data.qpos[:n], data.qvel[:n], data.qacc[:n] = q[k, :n], dq[k, :n], ddq[k, :n]
        mujoco.mj_inverse(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        tau[k] = data.qfrc_inverse[:n]
        # Of the base's body: torque and force about the centre of mass of all, moved to the world's origin.
        moment, force = data.cfrc_int[1, :3], data.cfrc_int[1, 3:]
        ground[k] = np.append(force, moment + np.cross(data.subtree_com[model.body_rootid[1]], force))
    friction = np.array([3.0, 3, 2, 1, 0.5, 0.3, 0.1])[:n] * np.tanh(dq[:, :n] / 0.05) * 0.2
    tau = tau + friction + 0.02 * np.ptp(tau, axis=0) * order.normal(size=tau.shape)
    ground = ground + 0.01 * np.ptp(ground, axis=0) * order.normal(size=ground.shape)
    q = q[:, :n] + 1e-5 * order.normal(size=(len(time), n))
    mechanism = sim.mechanism(spec, base="base")
    return Robot(mechanism, joints, time, q, dq[:, :n] + 1e-3 * order.normal(size=q.shape), tau, ground)
