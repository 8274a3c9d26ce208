"""Readings of a scene: its sensors with units and noise, and many motions simulated in MuJoCo's thread pool."""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import rollout

from ident.errors import ModelError
from ident.geometry.se3 import coAd, inverse, pose
from ident.tolerances import HUGE
from sim.models.notes import body_name, joint_name, name_of, without_log

QUATERNION = "quaternion"
"""Unit of a channel that is an orientation, w, x, y, z."""

ONE_DOF = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
"""Types of joints with a single coordinate that is the integral of their velocity."""

_JOINT_UNITS = {
    mujoco.mjtSensor.mjSENS_JOINTPOS: "",
    mujoco.mjtSensor.mjSENS_JOINTVEL: "/s",
    mujoco.mjtSensor.mjSENS_USER: "/s²",
}

_SENSOR_UNITS = {
    mujoco.mjtSensor.mjSENS_TOUCH: "N",
    mujoco.mjtSensor.mjSENS_FORCE: "N",
    mujoco.mjtSensor.mjSENS_TORQUE: "N m",
    mujoco.mjtSensor.mjSENS_FRAMEPOS: "m",
    mujoco.mjtSensor.mjSENS_FRAMEQUAT: QUATERNION,
}


@dataclass(frozen=True)
class DeclaredSensor:
    """A sensor that the MJCF declares.

    Attributes:
        name: Its name, which is that of its channel in a recording.
        unit: Unit of its readings, empty if unknown.
        part: Its place in `sensordata`.
        noise: Declared standard deviation; for an orientation, of each component of a rotation vector in rad.
        dof: Degree of freedom whose acceleration a user sensor reports, None for sensors that MuJoCo fills itself.
    """

    name: str
    unit: str
    part: slice
    noise: float
    dof: int | None

    @property
    def is_scalar(self) -> bool:
        """True if a reading is one number."""
        return self.part.stop - self.part.start == 1


def sensors(model: mujoco.MjModel) -> list[DeclaredSensor]:
    """The sensors that a model declares.

    Raises:
        ModelError: A user sensor is not attached to a hinge or slide joint.
    """
    return [_sensor(model, i) for i in range(model.nsensor)]


def wrench_whitening(model: mujoco.MjModel, base: str | None, force: float, moment: float) -> np.ndarray:
    """Matrix that whitens the noise of the wrench between a base and its ground, by the noise of the base's sensors.

    Args:
        model: Compiled model.
        base: Name of the body whose frame is {0}; None for the world, which has no sensors.
        force: Standard deviation of the noise of forces if no sensor states one, N; `moment` of moments, N m.

    Returns:
        W with `W C Wᵀ = 1` for the covariance C of `[F; τ]` in the base frame, including the lever arm of a torque
        sensor that is not at its origin (6, 6).
    """
    place = np.zeros(3)
    for i in range(model.nsensor):
        site, noise, kind = model.sensor_objid[i], float(model.sensor_noise[i]), mujoco.mjtSensor(model.sensor_type[i])
        on_site = kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE)
        if not (on_site and 0 < noise < HUGE and body_name(model, model.site_bodyid[site]) == base):
            continue
        if kind == mujoco.mjtSensor.mjSENS_FORCE:
            force = noise
        else:
            moment, place = noise, model.site_pos[site]
    # Each sensor's noise is isotropic, so that its orientation has no effect.
    return coAd(inverse(pose(np.eye(3), place))) / np.repeat([force, moment], 3)[:, None]


def torque_noise(model: mujoco.MjModel) -> dict[str, float]:
    """Standard deviations of the noise of sensors of actuator forces, by the joints' names, N or N m."""
    kind = int(mujoco.mjtSensor.mjSENS_JOINTACTFRC)
    which = [i for i in range(model.nsensor) if model.sensor_type[i] == kind and 0 < model.sensor_noise[i] < HUGE]
    return {joint_name(model, model.sensor_objid[i]): float(model.sensor_noise[i]) for i in which}


def _sensor(model: mujoco.MjModel, i: int) -> DeclaredSensor:
    name = name_of(model, mujoco.mjtObj.mjOBJ_SENSOR, i)
    kind = mujoco.mjtSensor(model.sensor_type[i])
    dof = None
    if kind == mujoco.mjtSensor.mjSENS_USER:
        joint = model.sensor_objid[i] if model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_JOINT else -1
        if joint < 0 or model.jnt_type[joint] not in ONE_DOF or model.sensor_dim[i] != 1:
            raise ModelError(
                f"User sensor '{name}' must report one number of a hinge or slide joint (objtype='joint', dim='1')."
            )
        dof = int(model.jnt_dofadr[model.sensor_objid[i]])
    start = model.sensor_adr[i]
    unit = _SENSOR_UNITS.get(kind, "")
    if kind in _JOINT_UNITS:
        slide = model.jnt_type[model.sensor_objid[i]] == mujoco.mjtJoint.mjJNT_SLIDE
        unit = ("m" if slide else "rad") + _JOINT_UNITS[kind]
    elif kind == mujoco.mjtSensor.mjSENS_JOINTACTFRC:
        unit = "N" if model.jnt_type[model.sensor_objid[i]] == mujoco.mjtJoint.mjJNT_SLIDE else "N m"
    return DeclaredSensor(name, unit, slice(start, start + model.sensor_dim[i]), float(model.sensor_noise[i]), dof)


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
