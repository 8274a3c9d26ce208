"""Trees, parameters and motions from compiled MuJoCo models; the only place that converts MuJoCo's conventions."""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np

import scenes
from ident.annotations import typed
from ident.arguments import check_type, checked_coordinates
from ident.errors import ModelError
from ident.geometry import se3
from ident.geometry.inertia import parameters_from_com
from ident.mechanism.body import BASE, Body, ball_twist, free_joint
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from sim.models.couplings import check_couplings
from sim.models.inertials import compiled_as_stated, note_inertias
from sim.models.notes import body_id, body_name, joint_name, refusals
from sim.models.opensim_model import is_opensim
from sim.models.urdf import model_from_urdf
from sim.models.xml_files import SUFFIX as XACRO
from sim.models.xml_files import parsed

Source: TypeAlias = mujoco.MjModel | mujoco.MjSpec | str | Path
"""A compiled model, a specification, or the path of an MJCF or URDF file."""

BEYOND = ("load_cell", *(f"load_cell_{contact}" for contact in scenes.CONTACTS))
"""Bodies at which a mechanism ends, as the load of a force sensor is not part of it."""

_FREE, _BALL, _SLIDE = (int(getattr(mujoco.mjtJoint, f"mjJNT_{kind}")) for kind in ("FREE", "BALL", "SLIDE"))


def compiled(source: Source, packages: Sequence[str | Path] = ()) -> mujoco.MjModel:
    """The compiled model of any source.

    Inertias of a URDF file or a specification stay unchanged, even those that MuJoCo's compiler refuses.

    Args:
        source: The model.
        packages: Folders of ROS packages that are also searched for the meshes of a URDF file.

    Warns:
        ModelNote: An inertia is impossible for a rigid body, a moving body has none, or meshes are left out.

    Raises:
        ModelError: The file does not exist, or MuJoCo cannot read or compile it.
        InputError: The source is none.
    """
    if isinstance(source, mujoco.MjModel):
        return source
    check_type("source", source, mujoco.MjSpec | str | Path, "the path of a model, an MjSpec or an MjModel")
    model = _compiled_file(Path(source), packages) if isinstance(source, str | Path) else compiled_as_stated(source)
    note_inertias(model)
    return model


def _compiled_file(path: Path, packages: Sequence[str | Path]) -> mujoco.MjModel:
    root = parsed(path)
    if is_opensim(path):
        raise ModelError(f"{path}: MuJoCo reads no OpenSim files; this needs a model in MJCF or URDF.")
    if path.suffix.lower() not in (".xml", ".urdf", XACRO):
        raise ModelError(f"A model file ends in .xml, .urdf or {XACRO}, got '{path}'.")
    if root.tag == "robot":
        return compiled_as_stated(model_from_urdf(path, packages), path)
    with refusals(path):
        return mujoco.MjModel.from_xml_path(str(path))


@typed("source", "fix")
def tree_from_model(
    source: Source,
    base: str | None = None,
    beyond: Sequence[str] = BEYOND,
    *,
    ignore: Collection[str] = (),
    fix: Mapping[str, float | Sequence[float]] | Sequence[str] | None = None,
) -> Tree:
    """Kinematic tree of a body and all its descendants.

    Args:
        source: The model.
        base: Name of the body whose frame is {0}; it comes first in the tree, welded to {0}. Joints that move it are
            not part of the tree: a moving base needs its `base_motion`. Without a name, {0} is the world's frame and
            all bodies are in the tree.
        beyond: Names of bodies that, with all their descendants, are not part of the mechanism.
        ignore: Names of equality constraints and tendons to leave out of the equations.
        fix: Names of the tree's joints that do not move, with their coordinates, rad, m or a quaternion; names
            alone or empty sequences for those of the reference configuration.

    Returns:
        Bodies in MuJoCo's order, which puts parents first; the joints' coordinates and velocities are MuJoCo's own. Of
        several joints on one body, all but the last have massless links.

    Warns:
        ModelNote: Tendons or flexes that are not ignored act between bodies of the tree, which changes its joint
            torques, but neither the base wrench nor contact wrenches. Equality constraints are in `mechanism` alone.

    Raises:
        ModelError: The base or a joint to fix does not exist, or equality constraints or tendons that are not ignored
            reach outside the tree.
        InputError: A joint to fix has another number of coordinates.
    """
    model = compiled(source)
    members = mechanism_bodies(model, base, beyond)
    fix = checked_coordinates("fix", () if fix is None else fix)
    check_couplings(model, base, members, ignore, fix)
    tree = _tree(model, members, base)
    if fix:
        rest = rest_coordinates(model, base, beyond)
        tree = tree.fixed({joint: q if len(q) else rest.get(joint, ()) for joint, q in fix.items()})
    return tree


def parameters_from_model(source: Source, base: str | None = None, beyond: Sequence[str] = BEYOND) -> np.ndarray:
    """Stacked φ of the bodies of `tree_from_model`, about their body frames (10 b,).

    MuJoCo stores principal moments about the centre of mass, with the principal axes.

    Raises:
        ModelError: The base does not exist, nothing in the tree has a mass, or a body has numbers that are not finite.
    """
    model = compiled(source)
    members = mechanism_bodies(model, base, beyond)
    if not model.body_mass[members].any():
        raise ModelError(f"A mechanism needs mass; {', '.join(body_name(model, b) for b in members)} have none.")
    stacked = np.concatenate([body_parameters(model, b) for b in members])
    if not (finite := np.isfinite(stacked.reshape(-1, 10)).all(axis=1)).all():
        name = body_name(model, members[int(finite.argmin())])
        raise ModelError(
            f"Body '{name}' needs a finite mass, centre of mass and inertia, the model has NaN or infinity."
        )
    return stacked


def body_parameters(model: mujoco.MjModel, b: int) -> np.ndarray:
    """φ of one body about its body frame (10,)."""
    R = _rotation(model.body_iquat[b])
    return parameters_from_com(model.body_mass[b], model.body_ipos[b], R @ np.diag(model.body_inertia[b]) @ R.T)


@typed("source")
def state_columns(
    source: Source, base: str | None = None, beyond: Sequence[str] = BEYOND
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the tree's states, including those of its fixed joints, in MuJoCo's states.

    Returns:
        Indices into qpos (n_q,), and into qvel and qacc (n,).
    """
    model = compiled(source)
    members = [b for b in mechanism_bodies(model, base, beyond) if base is None or body_name(model, b) != base]
    dofs = np.flatnonzero(np.isin(model.dof_bodyid, members))
    joints = np.flatnonzero(np.isin(model.jnt_bodyid, members))
    sizes = {_FREE: 7, _BALL: 4}
    qpos = [model.jnt_qposadr[j] + np.arange(sizes.get(int(model.jnt_type[j]), 1)) for j in joints]
    return np.concatenate([np.zeros(0, int), *qpos]), dofs


def rest_coordinates(source: Source, base: str | None = None, beyond: Sequence[str] = BEYOND) -> dict[str, np.ndarray]:
    """Coordinates of the tree's joints in the reference configuration, by their names, each (1,) or (4,)."""
    model = compiled(source)
    tree = _tree(model, mechanism_bodies(model, base, beyond), base)
    coordinates = tree.body_coordinates(model.qpos0[state_columns(model, base, beyond)[0]])
    return {tree.bodies[i].joint: coordinates[i] for i in tree.moving}


@typed("source")
def base_motion(source: Source, base: str, qpos: np.ndarray, qvel: np.ndarray, qacc: np.ndarray) -> BaseMotion:
    """Motion of a moving base, from MuJoCo's states.

    Args:
        source: The model.
        base: Name of the body whose frame is {0}.
        qpos: Positions (N, nq); `qvel` and `qacc` velocities and accelerations (N, nv).

    Returns:
        N samples, in the world's frame.
    """
    model = compiled(source)
    b = body_id(model, base)
    data = mujoco.MjData(model)
    T, V, dV = np.tile(np.eye(4), (len(qpos), 1, 1)), np.empty((len(qpos), 6)), np.empty((len(qpos), 6))
    gravity, turning_first = gravity_of(model), np.empty(6)
    for k, (q, dq, ddq) in enumerate(zip(qpos, qvel, qacc, strict=True)):
        data.qpos, data.qvel, data.qacc = q, dq, ddq
        for stage in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel, mujoco.mj_rnePostConstraint):
            stage(model, data)
        T[k, :3, :3], T[k, :3, 3] = data.xmat[b].reshape(3, 3), data.xpos[b]
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, b, turning_first, 1)
        V[k] = np.roll(turning_first, 3)
        mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_XBODY, b, turning_first, 1)
        dV[k] = np.roll(turning_first, 3)
        # MuJoCo's acceleration is that of a point, as an accelerometer reads it, including gravity.
        dV[k, :3] += T[k, :3, :3].T @ gravity - np.cross(V[k, 3:], V[k, :3])
    return BaseMotion(T, V, dV)


def gravity_of(model: mujoco.MjModel) -> np.ndarray:
    """Acceleration of gravity in the world's axes, zero if the model switches it off, m/s² (3,)."""
    off = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return np.zeros(3) if off else model.opt.gravity.copy()


def gravity_in_base(source: Source, base: str | None = None) -> np.ndarray:
    """Acceleration of gravity in the axes of a base at rest, or in the world's for a moving base, m/s² (3,)."""
    model = compiled(source)
    return gravity_of(model) @ base_pose(model, base)[:3, :3]


def base_pose(source: Source, base: str | None = None) -> np.ndarray:
    """Pose of a base at rest in the world; the identity for a moving base, whose poses are in the world (4, 4)."""
    model, T = compiled(source), np.eye(4)
    b = 0 if base is None else body_id(model, base)
    while b != 0:
        if model.body_jntnum[b]:
            return np.eye(4)
        T = placed_pose(model.body_pos[b], model.body_quat[b]) @ T
        b = model.body_parentid[b]
    return T


def place_of_site(model: mujoco.MjModel, s: int, members: Sequence[int]) -> tuple[str, np.ndarray] | None:
    """Name of the mechanism's body that a site is fixed to, and its pose in that body's frame; None without one."""
    carrier = carrier_of(model, int(model.site_bodyid[s]), members)
    if carrier is None or carrier[0] == 0:
        return None
    return body_name(model, carrier[0]), carrier[1] @ placed_pose(model.site_pos[s], model.site_quat[s])


def carrier_of(model: mujoco.MjModel, b: int, members: Sequence[int]) -> tuple[int, np.ndarray] | None:
    """The mechanism's body, or 0 for the world, that a body is fixed to, and its pose there; None if it moves."""
    pose = np.eye(4)
    while b not in members:
        if b == 0:
            return b, pose
        if model.body_jntnum[b] or model.body_mocapid[b] >= 0:
            return None
        pose = placed_pose(model.body_pos[b], model.body_quat[b]) @ pose
        b = int(model.body_parentid[b])
    return b, pose


def mechanism_bodies(model: mujoco.MjModel, base: str | None, beyond: Sequence[str] = BEYOND) -> list[int]:
    """Ids of the bodies of a mechanism, without mocap bodies, on which no forces act.

    Args:
        model: Compiled model.
        base: Name of the base body, first in the list; without a name all bodies, but not the world.
        beyond: Names of bodies that, with all their descendants, are not part of the mechanism.
    """
    members = [0] if base is None else [body_id(model, base)]
    for b in range(members[0] + 1, model.nbody):
        outside = model.body_mocapid[b] >= 0 or body_name(model, b) in beyond
        if model.body_parentid[b] in members and not outside:
            members.append(b)
    members = members[1:] if base is None else members
    if not members:
        raise ModelError("The model has no body besides the world.")
    return members


def _tree(model: mujoco.MjModel, members: Sequence[int], base: str | None) -> Tree:
    bodies: list[Body] = []
    place = {0: BASE}
    for b in members:
        if base is not None and b == members[0]:
            bodies.append(Body(base, BASE, np.eye(4), np.zeros(6)))
        else:
            bodies += _links(model, b, place[int(model.body_parentid[b])], len(bodies))
        place[b] = len(bodies) - 1
    return Tree(tuple(bodies))


def _links(model: mujoco.MjModel, b: int, parent: int, index: int) -> list[Body]:
    """A body, preceded by massless links for all its joints but the last; `index` is that of the first in the tree."""
    name, home = body_name(model, b), placed_pose(model.body_pos[b], model.body_quat[b])
    joints = range(model.body_jntadr[b], model.body_jntadr[b] + model.body_jntnum[b])
    if not joints:
        return [Body(name, parent, home, np.zeros(6))]
    links: list[Body] = []
    for k, j in enumerate(joints):
        joint = joint_name(model, j)
        if model.jnt_type[j] == _FREE:
            return list(free_joint(joint, name, parent, index))
        twist, reference = _joint(model, j)
        last = k == len(joints) - 1
        links.append(Body(name if last else f"{name}:{joint}", parent, home @ reference, twist, joint, not last))
        parent, home = index + k, np.eye(4)
    return links


def _joint(model: mujoco.MjModel, j: int) -> tuple[np.ndarray, np.ndarray]:
    """Twist of a joint in the body frame, and the pose at coordinate zero in that of the reference configuration."""
    if model.jnt_type[j] == _BALL:
        return ball_twist(model.jnt_pos[j]), np.eye(4)
    axis = model.jnt_axis[j]
    slide = model.jnt_type[j] == _SLIDE
    twist = np.concatenate([axis, np.zeros(3)] if slide else [np.cross(model.jnt_pos[j], axis), axis])
    return twist, se3.exp(twist, -model.qpos0[model.jnt_qposadr[j]])


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quaternion)
    return out.reshape(3, 3)


def placed_pose(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Pose of a position and a quaternion `w, x, y, z` (4, 4)."""
    return se3.pose(_rotation(quaternion), position)
