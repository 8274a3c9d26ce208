"""Shapes of a model for drawing: its geoms as few triangles, each on a body of a mechanism."""

from collections.abc import Iterator
from functools import cache
from itertools import combinations
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ident.geometry import se3
from ident.mechanism.body import BASE
from ident.mechanism.mechanism import Mechanism
from sim.models.model_mechanism import Origin
from sim.models.mujoco_model import carrier_of, mechanism_bodies, placed_pose
from sim.models.notes import body_name


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
    collected = []
    for g, body, T in placed_geoms(arm, arm.source):
        points = _points(arm.source.model, g)
        hull = None if points is None else _hull(points)
        if hull is not None:
            collected.append(Shape(body, hull[0] @ T[:3, :3].T + T[:3, 3], hull[1]))
    return collected


def placed_geoms(arm: Mechanism, origin: Origin) -> Iterator[tuple[int, int, np.ndarray]]:
    """Visible geoms on a mechanism's bodies, or at rest.

    Yields:
        Id of a geom, index of the tree's body that it is on or `BASE`, and its pose in that body's frame or, for geoms
        at rest, in the base frame (4, 4).
    """
    model, members = origin.model, mechanism_bodies(origin.model, origin.base, origin.beyond)
    for g in range(model.ngeom):
        place = carrier_of(model, int(model.geom_bodyid[g]), members)
        # As in MuJoCo's viewer, geoms of the groups from 3 on, such as collision shapes, are not shown.
        if place is None or model.geom_group[g] >= 3 or model.geom_rgba[g, 3] == 0:
            continue
        b, carrier = place
        T = carrier @ placed_pose(model.geom_pos[g], model.geom_quat[g])
        if b in members:
            yield g, arm.tree.names.index(body_name(model, b)), T
        else:
            yield g, BASE, se3.inverse(arm.pose) @ T


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
