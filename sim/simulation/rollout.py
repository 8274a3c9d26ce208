"""Simulation of many motions of one scene in MuJoCo's thread pool, with readings at chosen instants."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import rollout

from ident.errors import ModelError
from sim.models.notes import without_log

STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
"""State of a rollout: time, qpos, qvel, and the states of actuators and plugins, in this order."""

COMMAND = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)
"""Commands during a step, in this order: controls (nu,), positions (3 nmocap,) and quaternions (4 nmocap,) of mocap
bodies."""


@dataclass(frozen=True, eq=False)
class Readings:
    """States and sensors at M instants of B motions; all values of an instant are from one forward pass at its state.

    Attributes:
        qpos: Positions (B, M, nq); NaN after MuJoCo has stopped because of divergence or lack of memory.
        qacc: Accelerations (B, M, nv).
        sensordata: Readings of MuJoCo's sensors (B, M, nsensordata), except user sensors.
    """

    qpos: np.ndarray
    qacc: np.ndarray
    sensordata: np.ndarray


@without_log()
def play(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    qvel: np.ndarray,
    commands: np.ndarray,
    instants: np.ndarray,
    *,
    threads: int = 1,
) -> Readings:
    """Simulates B motions; the readings depend neither on the other motions nor on the number of threads.

    Args:
        model: Compiled scene.
        qpos: Positions at the start (B, nq).
        qvel: Velocities at the start (B, nv).
        commands: Rows of `COMMAND`, the k-th one acting from step k to step k + 1 (B, T, ·).
        instants: Numbers of steps after which readings are taken, increasing, from 1 to T - 1 (M,).
        threads: Number of threads.
    """
    data = [mujoco.MjData(model) for _ in range(threads)]
    initial = np.empty((len(qpos), mujoco.mj_stateSize(model, STATE)))
    mujoco.mj_getState(model, data[0], initial[0], STATE)
    initial[:] = initial[0]
    initial[:, 1 : 1 + model.nq + model.nv] = np.concatenate([qpos, qvel], axis=1)
    states, _ = rollout(_bare(model), data, initial, commands[:, : instants[-1]], control_spec=COMMAND)
    states = states[:, instants - 1]
    qacc, sensordata, time = _at_states(model, data, states, commands[:, instants])
    # After MuJoCo has stopped it repeats a state, reset if the motion diverged, so that its time falls behind.
    lost = abs(time - instants * model.opt.timestep) > model.opt.timestep / 2
    return Readings(np.where(lost[..., None], np.nan, states[..., 1 : 1 + model.nq]), qacc, sensordata)


def _at_states(
    model: mujoco.MjModel, data: list[mujoco.MjData], states: np.ndarray, commands: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Accelerations (B, M, nv), sensordata (B, M, nsensordata) and times (B, M), from one explicit step at each state.

    A step's sensordata are those of the state before it, and after an explicit step the velocity is `v + h q̈` with the
    acceleration there. The scene's own integrator may be another.
    """
    explicit = copy.copy(model)
    explicit.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    explicit.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    initial, command = states.reshape(-1, states.shape[-1]), commands.reshape(-1, 1, commands.shape[-1])
    after, sensordata = (
        x.reshape(*states.shape[:2], -1) for x in rollout(explicit, data, initial, command, control_spec=COMMAND)
    )
    h, velocities = model.opt.timestep, slice(1 + model.nq, 1 + model.nq + model.nv)
    return (after - states)[..., velocities] / h, sensordata, after[..., 0] - h


def _bare(model: mujoco.MjModel) -> mujoco.MjModel:
    """The scene without sensors, and without collision detection if no geoms can collide."""
    bare = copy.copy(model)
    bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    collide = (model.geom_contype[:, None] & model.geom_conaffinity).any()
    if not (collide or model.npair or model.nflex):
        bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return bare


def steps_per_sample(model: mujoco.MjModel, rate: float) -> int:
    """Number of steps of a scene between two samples.

    Args:
        model: Compiled scene.
        rate: Samples per second.

    Raises:
        ModelError: The rate is not positive, or the timestep does not divide the time between samples.
    """
    if not rate > 0:
        raise ModelError(f"A scene needs a positive rate of samples in Hz, got {rate:g}.")
    h = model.opt.timestep
    steps = round(1 / (rate * h)) if h > 0 else 0
    if steps < 1 or abs(steps * rate * h - 1) > 1e-9:
        raise ModelError(f"The scene's timestep of {h} s must divide {1 / rate} s.")
    return steps
