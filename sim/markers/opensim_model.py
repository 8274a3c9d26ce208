"""OpenSim's bodies, coordinates and markers as a MuJoCo specification, for kinematics only, without inertias."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from ident.mechanism.body import BASE, Body
from ident.mechanism.follower import Follower
from sim.models.opensim.mechanism import mechanism_from_opensim

NOTHING = 1e-3
"""Mass in kg and moment in kg m² of every body, as MuJoCo needs some."""


def opensim_spec(
    path: str | Path, fix: Mapping[str, Sequence[float]]
) -> tuple[mujoco.MjSpec, dict[str, Follower], str]:
    """The bodies of an OpenSim file, with its markers as sites.

    Args:
        path: The file.
        fix: Coordinates that do not move, each with its value, or empty for its default.

    Returns:
        The specification, not yet compiled; functions of followers, by the joints' names; and the axis of the ground
        that points up, `x`, `y` or `z`.

    Raises:
        ModelError: Something in the file cannot be read; the message names it.
    """
    arm = mechanism_from_opensim(path, fix=fix)
    spec, followers = mujoco.MjSpec(), dict[str, Follower]()
    spec.compiler.degree = False
    bodies: list[mujoco.MjsBody] = []
    for body in arm.tree.bodies:
        parent = spec.worldbody if body.parent == BASE else bodies[body.parent]
        bodies.append(_added(parent, body, arm.ranges.get(body.joint)))
        if body.follows:
            followers[f"{body.name}:follows"] = body.follows
    places = dict(zip(arm.tree.names, bodies, strict=True))
    for name, (carrier, pose) in arm.sites.items():
        places[carrier].add_site(name=name, pos=pose[:3, 3])
    return spec, followers, "xyz"[int(np.abs(arm.gravity).argmax())] if arm.gravity.any() else "y"


def _added(parent: mujoco.MjsBody, body: Body, limits: tuple[float, float] | None) -> mujoco.MjsBody:
    """Adds a body with its joint to another one, and returns it."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(body.home[:3, :3]).ravel())
    out = parent.add_body(name=body.name, pos=body.home[:3, 3], quat=quat)
    out.explicitinertial = True
    out.mass, out.inertia = NOTHING, np.full(3, NOTHING)
    if not body.moves:
        return out
    linear, angular = body.twist[:3], body.twist[3:]
    joint = out.add_joint(name=body.joint or f"{body.name}:follows")
    if body.turns:
        joint.type, joint.axis, joint.pos = mujoco.mjtJoint.mjJNT_HINGE, angular, np.cross(angular, linear)
    else:
        joint.type, joint.axis = mujoco.mjtJoint.mjJNT_SLIDE, linear
    if limits is not None:
        joint.range, joint.limited = limits, mujoco.mjtLimited.mjLIMITED_TRUE
    return out
