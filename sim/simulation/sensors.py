"""The sensors that a scene declares: their channels, units and noise."""

from dataclasses import dataclass

import mujoco

from ident.errors import ModelError
from sim.models.names import name_of

QUATERNION = "quaternion"
"""Unit of a channel that is an orientation, w, x, y, z."""

ONE_DOF = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
"""Joints with a single coordinate that is the integral of their velocity."""

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
class Sensor:
    """A sensor as the MJCF declares it.

    Attributes:
        name: Its name, the channel's in a recording.
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
        """Whether a reading is one number."""
        return self.part.stop - self.part.start == 1


def sensors(model: mujoco.MjModel) -> list[Sensor]:
    """The sensors that a model declares.

    Raises:
        ModelError: A user sensor is not attached to a hinge or slide joint.
    """
    return [_sensor(model, i) for i in range(model.nsensor)]


def _sensor(model: mujoco.MjModel, i: int) -> Sensor:
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
    return Sensor(name, unit, slice(start, start + model.sensor_dim[i]), float(model.sensor_noise[i]), dof)
