"""An arm of three joints with friction, rotors and a spring: models, and logs by MuJoCo's inverse dynamics."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
from mechanisms import by_joint, sines
from random_models import inverse_dynamics
from scipy.linalg import expm

import ident
import sim
from ident.setup import PRIORS

JOINTS = ("turn", "lift", "bend")
TRUE = {
    "armature": (0.20, 0.15, 0.05),
    "damping": (0.8, 0.6, 0.3),
    "frictionloss": (0.9, 0.7, 0.4),
    "stiffness": (0.0, 8.0, 0.0),
    "springref": (0.0, 0.4, 0.0),
}
"""Drives of the joints, by MJCF's attributes."""


KP, KV = (60.0, 80.0, 30.0), (4.0, 5.0, 2.0)  # Stiffness and damping of the joints' servos.
ACTUATORS = "<actuator>{}</actuator>".format(
    "".join(f'<position joint="{j}" kp="{kp}" kv="{kv}"/>' for j, kp, kv in zip(JOINTS, KP, KV, strict=True))
)


def text(*, more="", **drives):
    """MJCF of the arm, with drives by attribute, or those of `TRUE` where none are given, and more elements."""
    own = TRUE | drives
    attributes = [" ".join(f'{key}="{own[key][k]}"' for key in own) for k in range(3)]
    return f"""<mujoco><compiler angle="radian"/><worldbody><body name="column"><joint name="turn" axis="0 0 1"
      {attributes[0]}/><inertial mass="4" pos="0 0.02 0.1" diaginertia="0.03 0.03 0.02"/>
      <body name="upper" pos="0 0 0.3"><joint name="lift" axis="0 1 0" {attributes[1]}/>
      <inertial mass="3" pos="0.2 0 0.01" diaginertia="0.01 0.05 0.05"/>
      <body name="fore" pos="0.4 0 0"><joint name="bend" axis="0 1 0" {attributes[2]}/>
      <inertial mass="1.5" pos="0.15 0.01 0" diaginertia="0.003 0.02 0.02"/></body></body></body></worldbody>
      {more}</mujoco>"""


def of_one_joint(inertia, servo, commands, step):
    """Angles (N,) of a joint whose servo holds each command (N,) for a step, s, exactly."""
    after = expm(step * np.array([[0.0, 1.0], [-servo.kp / inertia, -servo.kv / inertia]]))
    state, angles = np.array([commands[0], 0.0]), []
    for command in commands:
        angles.append(state[0])
        state = [command, 0] + after @ (state - [command, 0])
    return np.array(angles)


NONE = dict.fromkeys(TRUE, (0.0, 0.0, 0.0))  # Drives of a model that states none.
EXACT = dict.fromkeys(PRIORS, 0.0)  # A set-up as stated.


@cache
def mechanism(**drives):
    return sim.mechanism(mujoco.MjSpec.from_string(text(**drives)))


def motion(rng, seconds=12.0, rate=100.0, size=1.0):
    """Times, and angles, velocities and accelerations of sums of sinusoids of a size (N, 3)."""
    t = np.arange(round(seconds * rate)) / rate
    pulsation = 2 * np.pi * 0.15 * np.arange(1, 6)
    amplitude, phase = size * rng.uniform(0.08, 0.3, (3, 5)), rng.uniform(0, 2 * np.pi, (3, 5))
    return t, *sines(t, amplitude, pulsation, phase)


def torques(q, dq, ddq, **drives):
    """Torques of the arm by MuJoCo, without Coulomb friction, and with other drives by attribute (N, 3)."""
    # MuJoCo's own friction is another law at low velocity.
    model = mujoco.MjModel.from_xml_string(text(**drives | {"frictionloss": (0, 0, 0)}))
    return inverse_dynamics(model, q, dq, ddq)[0]


@cache
def log(seconds=12.0, rate=100.0, seed=0, noise=1.0, size=1.0, pace=1.0):
    """Angles and torques of the true arm under sums of sinusoids of a size and a pace, with white noise."""
    rng = np.random.default_rng(seed)
    t, *states = motion(rng, seconds * pace, rate / pace, size)
    q, dq, ddq = (pace**k * x for k, x in enumerate(states))
    torque = torques(q, dq, ddq) + np.array(TRUE["frictionloss"]) * np.tanh(dq / 0.003)
    torque += noise * 0.02 * rng.normal(size=q.shape)
    q = q + noise * 1e-4 * rng.normal(size=q.shape)
    channels = by_joint(JOINTS, position=q, torque=torque)
    return ident.Recording(t / pace, channels)


@cache
def commanded(seconds=12.0, rate=100, lag=0, seed=0, noise=1.0, step=1e-3):
    """Angles and commands of the arm under its servos, simulated; commands act `lag` samples later than logged."""
    model = mujoco.MjModel.from_xml_string(text(more=ACTUATORS))
    model.opt.timestep, per = step, round(1 / (rate * step))
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    count = round(seconds * rate)
    t = np.arange(count + lag) / rate
    pulsation = 2 * np.pi * 0.25 * np.arange(1, 6)
    amplitude, phase = rng.uniform(0.08, 0.25, (3, 5)), rng.uniform(0, 2 * np.pi, (3, 5))
    u, *_ = sines(t, amplitude, pulsation, phase)
    u = u[lag:], u[: len(u) - lag]
    data.qpos[:], positions = u[1][0], []
    for logged, acting in zip(*u, strict=True):
        positions.append((logged, data.qpos.copy()))
        data.ctrl[:] = acting
        mujoco.mj_step(model, data, per)
    commands, q = (np.array(x) for x in zip(*positions, strict=True))
    q += noise * 1e-4 * rng.normal(size=q.shape)
    return np.arange(count) / rate, by_joint(JOINTS, position=q, command=commands)


@cache
def quick():
    return ident.identify(mechanism(), log(6.0, 50.0), estimator="weighted", cutoff=8.0)


@cache
def jointly():
    """Trajectory estimate of the same, its last torque known within 20 %, with the rest of the set-up as stated."""
    exact = {kind: 0.0 for kind in PRIORS if kind != "scale"}
    return ident.identify(mechanism(), replace(log(4.0, 50.0), scales={"bend": 0.2}), setup=exact, known=True)
