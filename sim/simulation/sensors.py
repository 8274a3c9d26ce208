"""Sensors of a scene: their channels, units and noise."""

from dataclasses import dataclass

import mujoco
import numpy as np

from ident.errors import ModelError
from ident.geometry.se3 import coAd, inverse, pose
from ident.tolerances import HUGE
from sim.models.notes import body_name, joint_name, name_of

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
