"""Many motions of one scene, stepped in MuJoCo's own thread pool and read at chosen instants."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import rollout

from ident.errors import ModelError

STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)
"""What a rollout starts from and returns: time, qpos, qvel, and what actuators and plugins remember, in this order."""

COMMAND = int(mujoco.mjtState.mjSTATE_CTRL | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)
"""What acts during a step, in this order: controls (nu,), positions (3 nmocap,) and quaternions (4 nmocap,) of mocap
bodies."""


@dataclass(frozen=True, eq=False)
class Readings:
    """A scene at M instants of B motions. What belongs to one instant comes from one forward pass at its state.

    Attributes:
        qpos: Positions (B, M, nq); NaN from where MuJoCo gave up, be it by divergence or by want of memory.
        qacc: Accelerations (B, M, nv).
        sensordata: What MuJoCo's sensors read (B, M, nsensordata); user sensors are not among them.
    """

    qpos: np.ndarray
    qacc: np.ndarray
    sensordata: np.ndarray


def play(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    qvel: np.ndarray,
    commands: np.ndarray,
    instants: np.ndarray,
    *,
    threads: int = 1,
) -> Readings:
    """Readings of B motions, the same whatever is played beside them and in however many threads.

    Args:
        model: Compiled scene.
        qpos: Positions at the start (B, nq).
        qvel: Velocities at the start (B, nv).
        commands: Rows of `COMMAND`, the k-th one acting from step k to step k + 1 (B, T, ·).
        instants: Numbers of steps after which to read, increasing, from 1 to T - 1 (M,).
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
    # MuJoCo repeats a state from where it gives up, reset if the motion diverged: its clock falls behind.
    lost = abs(time - instants * model.opt.timestep) > model.opt.timestep / 2
    return Readings(np.where(lost[..., None], np.nan, states[..., 1 : 1 + model.nq]), qacc, sensordata)


def _at_states(
    model: mujoco.MjModel, data: list[mujoco.MjData], states: np.ndarray, commands: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Accelerations (B, M, nv), sensordata (B, M, nsensordata) and times (B, M), each from one step of its own.

    A step's sensordata are of the state before it, and an explicit step's rate of velocity is the acceleration there,
    `v + h q̈`; the scene's own integrator may be another.
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
    """The scene without what its motion does not need: sensors, and the search for contacts where none can be."""
    bare = copy.copy(model)
    bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    collide = (model.geom_contype[:, None] & model.geom_conaffinity).any()
    if not (collide or model.npair or model.nflex):
        bare.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    return bare


def steps_per_sample(model: mujoco.MjModel, rate: float) -> int:
    """Steps of a scene between two samples.

    Args:
        model: Compiled scene.
        rate: Samples per second.

    Raises:
        ModelError: The timestep does not divide the time between samples.
    """
    h = model.opt.timestep
    steps = round(1 / (rate * h)) if h > 0 else 0
    if steps < 1 or abs(steps * rate * h - 1) > 1e-9:
        raise ModelError(f"The scene's timestep of {h} s must divide {1 / rate} s.")
    return steps
