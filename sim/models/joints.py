"""The hinge and slide joints of a mechanism: names, ranges, and a way to lock the others."""

from dataclasses import dataclass

import mujoco
import numpy as np

from sim.models.mujoco_model import BEYOND, gravity_of, mechanism_bodies
from sim.models.names import body_id, body_name, joint_name

_ONE_DOF = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True)
class Joint:
    """A hinge or slide joint.

    Attributes:
        name: Its name, made up from its id where the model gives none.
        id: Its id in the model.
        unit: `rad` or `m`.
        rest: Position in the reference configuration, rad or m.
        range: Limits of the position, rad or m, None where the model sets none.
    """

    name: str
    id: int
    unit: str
    rest: float
    range: tuple[float, float] | None


def joints_of(model: mujoco.MjModel, base: str | None) -> tuple[Joint, ...]:
    """The hinge and slide joints of a mechanism, in the order of its tree.

    Args:
        model: Compiled model.
        base: Name of the body whose frame is {0}, as for `tree_from_model`; the joints that move it are left out.

    Raises:
        ModelError: The base does not exist.
    """
    members = [b for b in mechanism_bodies(model, base, BEYOND) if base is None or body_name(model, b) != base]
    ids = [j for j in range(model.njnt) if model.jnt_bodyid[j] in members and model.jnt_type[j] in _ONE_DOF]
    return tuple(_joint(model, j) for j in ids)


def _joint(model: mujoco.MjModel, j: int) -> Joint:
    low, high = model.jnt_range[j].tolist()
    return Joint(
        name=joint_name(model, j),
        id=j,
        unit="m" if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE else "rad",
        rest=float(model.qpos0[model.jnt_qposadr[j]]),
        range=(low, high) if model.jnt_limited[j] else None,
    )


def gravity_at_rest(model: mujoco.MjModel, base: str | None) -> np.ndarray:
    """Acceleration of gravity in the axes of a base that stands still in the reference configuration, m/s² (3,)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    b = 0 if base is None else body_id(model, base)
    return data.xmat[b].reshape(3, 3).T @ gravity_of(model)
