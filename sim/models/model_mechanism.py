"""Mechanisms from models: tree, gravity, masses, sites, joint ranges, drives, loops; and shapes to draw."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ident.annotations import typed
from ident.arguments import checked_coordinates
from ident.errors import ModelError
from ident.geometry.se3 import inverse
from ident.mechanism.body import BASE
from ident.mechanism.loops import Constraints
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from sim.models.couplings import couplings, loops_of
from sim.models.model_drives import drives_of_model
from sim.models.mujoco_model import (
    BEYOND,
    Source,
    base_pose,
    carrier_of,
    compiled,
    gravity_in_base,
    mechanism_bodies,
    parameters_from_model,
    place_of_site,
    placed_pose,
    rest_coordinates,
    tree_from_model,
)
from sim.models.notes import body_name, constrained, joint_name, name_of, note, note_units
from sim.models.opensim_model import is_opensim, mechanism_from_opensim
from sim.models.urdf import transmissions


@dataclass(frozen=True, eq=False)
class Origin:
    """Origin of a mechanism, its `source`.

    Attributes:
        model: The compiled model.
        text: File or specification that can be updated; None for a model that was given compiled.
        base: Name of the body whose frame is {0}, None for the world's.
        beyond: Names of bodies at which the mechanism ends.
        packages: Folders of ROS packages that were searched for a URDF file's meshes.
    """

    model: mujoco.MjModel
    text: mujoco.MjSpec | str | Path | None
    base: str | None
    beyond: tuple[str, ...]
    packages: tuple[Path, ...] = ()


@typed("source", "fix")
def mechanism(
    source: Source,
    base: str | None = None,
    beyond: Sequence[str] = BEYOND,
    *,
    ignore: Collection[str] = (),
    fix: Mapping[str, float | Sequence[float]] | Sequence[str] | None = None,
    packages: Sequence[str | Path] = (),
    drives: bool = True,
    base_rpy_deg: Sequence[float] | None = None,
) -> Mechanism:
    """Mechanism of a body and all its descendants in a model.

    Args:
        source: The model; it is compiled once. OpenSim files, which end in `.osim`, are read without MuJoCo.
        base: Name of the body whose frame is {0}, as for `tree_from_model`; so are all other arguments.
        beyond: Names of bodies that, with all their descendants, are not part of the mechanism.
        ignore: Names of equality constraints and tendons to leave out of the equations.
        fix: Names of the tree's joints that do not move, with their coordinates or alone.
        packages: Folders of ROS packages, for meshes of a URDF file at `package://`; folders next to the file, above it
            and in `ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH` are searched as well.
        drives: False to leave out the drives of the joints.
        base_rpy_deg: Roll, pitch and yaw of the base frame in the world, degrees, for a base at rest that is mounted in
            another way than in the model, as `(180, 0, 0)` upside down; by default as in the model.

    Returns:
        The mechanism, with `Origin` or `OpenSimOrigin` as its source. It has no prior if all bodies are massless.

    Warns:
        ModelNote: As for `tree_from_model`, `drives_of_model`, `mechanism_from_opensim` and `note_units`.

    Raises:
        ModelError: As for `tree_from_model`, a body has numbers that are not finite, or the drive of a joint has
            negative ones.
        InputError: `base_rpy_deg` is malformed.
    """
    if is_opensim(source):
        arm = mechanism_from_opensim(str(source), base, beyond, ignore=ignore, fix=fix)
    else:
        text = None if isinstance(source, mujoco.MjModel) else source
        origin = Origin(compiled(source, packages), text, base, tuple(beyond), tuple(map(Path, packages)))
        arm = _from_mujoco(origin, ignore, checked_coordinates("fix", () if fix is None else fix), drives=drives)
    arm = arm if base_rpy_deg is None else arm.mounted(base_rpy_deg)
    note_units(arm)
    return arm


def _from_mujoco(
    origin: Origin, ignore: Collection[str], fix: Mapping[str, Sequence[float]], *, drives: bool
) -> Mechanism:
    """Mechanism of a model that MuJoCo reads."""
    model, base, beyond = origin.model, origin.base, origin.beyond
    members = mechanism_bodies(model, base, beyond)
    tree = tree_from_model(model, base, beyond, ignore=ignore, fix=fix)
    prior = parameters_from_model(model, base, beyond) if model.body_mass[members].any() else None
    geared = transmissions(origin.text) if drives and isinstance(origin.text, str | Path) else {}
    driven = drives_of_model(model, tree.freedoms, geared) if drives else {}
    gravity, pose = gravity_in_base(model, base), base_pose(model, base)
    arm = Mechanism(tree, gravity, prior, _sites(model, members), _ranges(model, tree), origin, pose, drives=driven)
    posture = rest_coordinates(model, base, beyond) | {joint: np.array(q) for joint, q in fix.items() if q}
    rows = (each.row for each in couplings(model) if each.row and each.name not in ignore)
    inside = tuple(row for row in rows if {*row.bodies} <= {*tree.names})
    held = {body.name: posture[body.still] for body in tree.bodies if body.still}
    arm = constrained(arm, Constraints(inside, posture).fixed(held, tree))
    arm = replace(arm, loops=loops_of(model, arm.tree, [row.name for row in arm.constraints.rows])).rested()
    if arm.loose:
        note(
            f"Constraints and actuators leave {', '.join(arm.loose)} free, which only springs, limits or contacts "
            "hold. Log them, or state by --fix where they rest: all others in their loops follow from driven ones then."
        )
    return arm


def mujoco_origin(arm: Mechanism) -> Origin:
    """Origin of a mechanism that was read by MuJoCo.

    Raises:
        ModelError: It was not.
    """
    if not isinstance(arm.source, Origin):
        raise ModelError(f"This needs a model in MJCF or URDF, which MuJoCo reads, not '{arm.source.path}'.")
    return arm.source


def _sites(model: mujoco.MjModel, members: Sequence[int]) -> dict[str, tuple[str, np.ndarray]]:
    """Sites that are fixed to bodies of a mechanism, by name."""
    places = {name_of(model, mujoco.mjtObj.mjOBJ_SITE, s): place_of_site(model, s, members) for s in range(model.nsite)}
    return {name: place for name, place in places.items() if place is not None}


def _ranges(model: mujoco.MjModel, tree: Tree) -> dict[str, tuple[float, float]]:
    """Limits of the hinges and slides of a tree that have limits, rad or m."""
    limits = {joint_name(model, j): model.jnt_range[j].tolist() for j in range(model.njnt) if model.jnt_limited[j]}
    joints = [tree.bodies[i].joint for i in tree.moving if not tree.bodies[i].is_ball]
    return {joint: (limits[joint][0], limits[joint][1]) for joint in joints if joint in limits}


class Shape(NamedTuple):
    """A convex solid.

    Attributes:
        body: Index of the tree's body that it is on, `BASE` for solids at rest.
        vertices: Corners in the body's frame, or in the base frame for solids at rest, m (V, 3).
        faces: Corners of each triangle, counterclockwise as seen from outside (F, 3).
    """

    body: int
    vertices: np.ndarray
    faces: np.ndarray


def shapes(arm: Mechanism) -> list[Shape]:
    """Boxes, spheres, ellipsoids, capsules, cylinders and the convex hulls of meshes of a mechanism's model.

    Planes, height fields and moving geoms outside the mechanism are left out. The list is empty for a mechanism that
    was not read by MuJoCo.
    """
    if not isinstance(arm.source, Origin):
        return []
    model, members = arm.source.model, mechanism_bodies(arm.source.model, arm.source.base, arm.source.beyond)
    collected = []
    for g in range(model.ngeom):
        place = carrier_of(model, int(model.geom_bodyid[g]), members)
        # As in MuJoCo's viewer, geoms of the groups from 3 on, such as collision shapes, are not shown.
        if place is None or model.geom_group[g] >= 3 or model.geom_rgba[g, 3] == 0:
            continue
        points = _points(model, g)
        if points is None or (hull := _hull(points)) is None:
            continue
        b, carrier = place
        T = carrier @ placed_pose(model.geom_pos[g], model.geom_quat[g])
        body, T = (arm.tree.names.index(body_name(model, b)), T) if b in members else (BASE, inverse(arm.pose) @ T)
        collected.append(Shape(body, hull[0] @ T[:3, :3].T + T[:3, 3], hull[1]))
    return collected


def _points(model: mujoco.MjModel, g: int) -> np.ndarray | None:
    """Points whose convex hull is a geom, in its frame (P, 3); None for geoms without a finite one."""
    kind, (a, b, c) = mujoco.mjtGeom(model.geom_type[g]), model.geom_size[g]
    circle = np.array([[np.cos(t), np.sin(t), 0] for t in np.linspace(0, 2 * np.pi, 16, endpoint=False)])
    ends = np.array([[0, 0, -b], [0, 0, b]])
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return np.array([[x, y, z] for x in (-a, a) for y in (-b, b) for z in (-c, c)])
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return a * _directions()
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return _directions() * [a, b, c]
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return np.concatenate([a * _directions() + end for end in ends])
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return np.concatenate([a * circle + end for end in ends])
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[g]
            first = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
            # The farthest point in each direction, so that a mesh of any size has a hull of few triangles.
            return vertices[np.unique((vertices @ _directions().T).argmax(axis=0))].astype(float)
    return None


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Corners and outward triangles of a convex hull; None for points that span no volume."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    used, numbered = np.unique(faces, return_inverse=True)
    return points[used], numbered.reshape(faces.shape)


@cache
def _directions() -> np.ndarray:
    """Corners and edge midpoints of an icosahedron, scaled to unit length (42, 3)."""
    golden = (1 + np.sqrt(5)) / 2
    corners = np.array([np.roll([0, x, y], k) for k in range(3) for x in (-1, 1) for y in (-golden, golden)])
    edges = [(a + b) / 2 for a, b in combinations(corners, 2) if np.isclose(np.linalg.norm(a - b), 2)]
    points = np.concatenate([corners, edges])
    return points / np.linalg.norm(points, axis=1)[:, None]
