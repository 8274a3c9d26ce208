"""Mechanisms read from compiled MuJoCo models: the only place where MuJoCo's conventions are converted to ours."""

from collections.abc import Sequence

import mujoco
import numpy as np

from ident import se3
from ident.inertia import parameters_from_com
from ident.tree import BASE, Body, Tree

BEYOND = ("load_cell",)
"""Bodies at which a mechanism ends: what a force sensor carries lies beyond it."""


def tree_from_model(model: mujoco.MjModel, base: str = "base", beyond: Sequence[str] = BEYOND) -> Tree:
    """The kinematic tree of a body that is fixed to the world and everything on it.

    Args:
        model: Compiled model.
        base: Name of the body whose frame is {0}. It comes first in the tree, welded to {0}.
        beyond: Names of bodies that, with all they carry, are not part of the mechanism.

    Returns:
        Bodies in MuJoCo's order, which puts parents first; the joint coordinates are MuJoCo's own.

    Raises:
        ValueError: The base does not exist or moves, or a body has a joint that the tree cannot hold.
    """
    members = _members(model, base, beyond)
    bodies = []
    for b in members:
        pose = np.eye(4) if b == members[0] else _pose(model.body_pos[b], model.body_quat[b])
        twist, reference, joint = _joint(model, b)
        parent = BASE if b == members[0] else members.index(model.body_parentid[b])
        bodies.append(Body(_body_name(model, b), parent, pose @ se3.exp(twist, -reference), twist, joint))
    return Tree(tuple(bodies))


def parameters_from_model(model: mujoco.MjModel, base: str = "base", beyond: Sequence[str] = BEYOND) -> np.ndarray:
    """Stacked φ of the bodies of `tree_from_model`, about their body frames (10 b,).

    MuJoCo stores principal moments about the centre of mass in the axes of an inertial frame of their own.
    """
    phi = []
    for b in _members(model, base, beyond):
        R = _rotation(model.body_iquat[b])
        inertia = R @ np.diag(model.body_inertia[b]) @ R.T
        phi.append(parameters_from_com(model.body_mass[b], model.body_ipos[b], inertia))
    return np.concatenate(phi)


def gravity_in_base(model: mujoco.MjModel, base: str = "base") -> np.ndarray:
    """Acceleration of gravity in the axes of a base that is fixed to the world, m/s² (3,)."""
    return _rotation(model.body_quat[_members(model, base, ())[0]]).T @ model.opt.gravity


def site_on_tree(
    model: mujoco.MjModel, site: str, base: str = "base", beyond: Sequence[str] = BEYOND
) -> tuple[str, np.ndarray]:
    """Where a sensor's site sits on the mechanism.

    Args:
        model: Compiled model.
        site: Name of the site, on a body of the mechanism or on one welded beyond its end.
        base: Name of the base body.
        beyond: Names of bodies at which the mechanism ends.

    Returns:
        Name of the mechanism's body that carries it, and the site's pose in that body's frame (4, 4).

    Raises:
        ValueError: The site does not exist, or is not fixed to a body of the mechanism.
    """
    s = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site)
    if s < 0:
        names = ", ".join(model.site(k).name for k in range(model.nsite))
        raise ValueError(f"The model has no site named '{site}'; its sites are {names}.")
    members = _members(model, base, beyond)
    b, pose = model.site_bodyid[s], _pose(model.site_pos[s], model.site_quat[s])
    while b not in members:
        if b == 0 or model.body_jntnum[b]:
            raise ValueError(f"Site '{site}' is not fixed to a body of the mechanism on '{base}'.")
        pose = _pose(model.body_pos[b], model.body_quat[b]) @ pose
        b = model.body_parentid[b]
    return _body_name(model, b), pose


def _members(model: mujoco.MjModel, base: str, beyond: Sequence[str]) -> list[int]:
    """Ids of the base and of all bodies on it, up to where the mechanism ends."""
    root = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, str(base))
    if root <= 0:
        names = ", ".join(_body_name(model, b) for b in range(1, model.nbody))
        raise ValueError(f"The model has no body named '{base}'; its bodies are {names}.")
    if model.body_parentid[root] != 0 or model.body_jntnum[root] != 0:
        raise ValueError(f"The base body '{base}' must be fixed to the world, without joints.")
    members = [root]
    for b in range(root + 1, model.nbody):
        if model.body_parentid[b] in members and _body_name(model, b) not in beyond:
            members.append(b)
    return members


def _joint(model: mujoco.MjModel, b: int) -> tuple[np.ndarray, float, str]:
    """Twist in the body frame, coordinate at the model's reference configuration, and name of a body's joint."""
    if model.body_jntnum[b] == 0:
        return np.zeros(6), 0.0, ""
    j = model.body_jntadr[b]
    kind = model.jnt_type[j]
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, j) or f"joint{j}"
    hinge = kind == mujoco.mjtJoint.mjJNT_HINGE
    if model.body_jntnum[b] > 1 or not (hinge or kind == mujoco.mjtJoint.mjJNT_SLIDE):
        raise ValueError(
            f"Body '{_body_name(model, b)}' needs at most one joint, hinge or slide; it has {model.body_jntnum[b]}, "
            f"the first, '{name}', of type {mujoco.mjtJoint(kind).name.removeprefix('mjJNT_').lower()}."
        )
    axis = model.jnt_axis[j]
    twist = np.concatenate([np.cross(model.jnt_pos[j], axis), axis] if hinge else [axis, np.zeros(3)])
    return twist, float(model.qpos0[model.jnt_qposadr[j]]), name


def _body_name(model: mujoco.MjModel, b: int) -> str:
    return mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, b) or f"body{b}"


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def _pose(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = _rotation(quaternion), position
    return T
