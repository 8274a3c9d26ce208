"""A seven-joint arm with a tool on a wrist sensor: readings of MuJoCo's sensor, and logs with faults."""

from functools import cache

import mujoco
import numpy as np
from mechanisms import by_joint, sines
from random_models import inverse_dynamics

from ident import Recording, Sensor

JOINTS = tuple(f"joint{k}" for k in range(1, 8))
TOOL = {"mass": 0.1, "com": (0.012, -0.008, 0.05), "inertia": (1.1e-4, 9e-5, 6e-5, 1e-5, -8e-6, 4e-6)}
"""Mass, centre of mass, and inertia about it: xx, yy, zz, xy, xz, yz."""

FACING = "0.9238795 0 0 0.3826834"  # Quaternion of the sensor in the tool's frame: 45° about z.
_LINKS = (
    ("0 0 0.333", "1 0 0 0"),
    ("0 0 0", "1 -1 0 0"),
    ("0 -0.316 0", "1 1 0 0"),
    ("0.0825 0 0", "1 1 0 0"),
    ("-0.0825 0.384 0", "1 -1 0 0"),
    ("0 0 0", "1 1 0 0"),
    ("0.088 0 0", "1 1 0 0"),
)


def model(*, tool=TOOL, beyond="", stated=True):
    text = lambda x: " ".join(map(str, x))  # noqa: E731
    inertial = f'<inertial mass="{tool["mass"]}" pos="{text(tool["com"])}" fullinertia="{text(tool["inertia"])}"/>'
    bodies = (
        f'<body name="tool" pos="0 0 0.107">{inertial if stated else ""}'
        f'<site name="wrist" pos="0 0 0.01" quat="{FACING}"/>{beyond}</body>'
    )
    for k, (pos, quat) in reversed(list(enumerate(_LINKS, start=1))):
        bodies = (
            f'<body name="link{k}" pos="{pos}" quat="{quat}"><joint name="joint{k}" axis="0 0 1"/>'
            f'<inertial mass="{4 - k / 2}" pos="0 0.02 -0.05" diaginertia="0.02 0.02 0.01"/>{bodies}</body>'
        )
    return (
        f'<mujoco model="arm"><worldbody>{bodies}</worldbody><sensor><force name="wrist_force" site="wrist"/>'
        '<torque name="wrist_torque" site="wrist"/></sensor></mujoco>'
    )


@cache
def motion(seconds=20.0, rate=100.0, seed=0, size=1.0):
    """Times, and positions, velocities and accelerations of a smooth motion (N, 7) that turns the wrist well."""
    t = np.arange(round(seconds * rate)) / rate
    return t, *along(t, seed, size)


def along(t, seed=0, size=1.0):
    rng = np.random.default_rng(seed)
    amplitude, phase = size * rng.uniform(0.1, 0.35, (7, 5)), rng.uniform(0, 2 * np.pi, (7, 5))
    q, dq, ddq = sines(t, amplitude, 2 * np.pi * 0.1 * np.arange(1, 6), phase)
    return q + np.array([0, 0.3, 0, -1.5, 0, 1.8, 0]), dq, ddq


@cache
def read(text, seconds=20.0, rate=100.0, size=1.0):
    """Noise-free readings of MuJoCo's sensor (N, 6)."""
    arm = mujoco.MjModel.from_xml_string(text)
    return inverse_dynamics(arm, *motion(seconds, rate, size=size)[1:])[1]


def log(seed=0, *, text=None, seconds=20.0, rate=100.0, size=1.0, sign=1, **faults):
    """Angles (0.3 mrad of noise) and the sensor (0.1 N, 5 mN m) with offsets, a `delay` in samples and `gains`."""
    rng, (t, q, *_) = np.random.default_rng(seed), motion(seconds, rate, size=size)
    wrench = sign * read(text or model(), seconds, rate, size) * np.array(faults.get("gains", np.ones(6)))
    wrench = wrench + [3, -2, 5, 0.1, -0.2, 0.05] + rng.normal(size=wrench.shape) * np.repeat([0.1, 0.005], 3)
    q = q + 3e-4 * rng.normal(size=q.shape)
    late = faults.get("delay", 0)
    t, q, wrench = t[late:], q[late:], wrench[: len(wrench) - late]
    felt = {"wrist_force": wrench[:, :3], "wrist_torque": wrench[:, 3:]}
    return Recording(t, by_joint(JOINTS, position=q) | felt, sensors=sensors())


def sensors(applied_to_link=True):
    arm = mujoco.MjModel.from_xml_string(model())
    pose = np.eye(4)
    pose[:3, 3] = arm.site("wrist").pos
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, arm.site("wrist").quat)
    pose[:3, :3] = R.reshape(3, 3)
    return {"wrist": Sensor("tool", pose, applied_to_link)}
