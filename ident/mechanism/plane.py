"""Mechanisms that move freely in a plane, such as sagittal models of people, and wrench components across the plane."""

import numpy as np

from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree

PARALLEL = 1e-3
"""Sine of the angle up to which axes count as parallel, as models are written with few digits."""


def plane_normal(mechanism: Mechanism) -> np.ndarray | None:
    """Unit normal, in the base frame, of the plane in which a mechanism moves freely (3,); None for other mechanisms.

    All hinges turn about the normal, all slides and gravity are perpendicular to it, and the joints of the only body on
    the base, or those of the carrier, have all three degrees of freedom in the plane.
    """
    carrier = mechanism.carrier
    carrying = mechanism.tree if carrier is None else carrier.tree
    if carrier is not None and len(carrying.root) < len(carrying.bodies):
        return None
    first = np.hstack([np.zeros((6, 0)), *(carrying.screws[i] for i in carrying.root)])
    axes = first[3:, first[3:].any(axis=0)]
    if not axes.size or np.linalg.matrix_rank(first, tol=PARALLEL) < 3:
        return None
    normal = axes[:, 0] / np.linalg.norm(axes[:, 0])
    g = mechanism.gravity
    if not _in_plane(carrying, normal) or abs(g @ normal) > PARALLEL * np.linalg.norm(g):
        return None
    if carrier is None:
        return normal
    # In the axes of the carrier's last body the normal is constant, as all joints turn about it.
    normal = carrying.generic_poses[-1][:3, :3].T @ normal
    return normal if _in_plane(mechanism.tree, normal) else None


def out_of_plane(mechanism: Mechanism, frame: np.ndarray, *, free: bool = True) -> tuple[int, ...]:
    """Components of a wrench that motion in a plane cannot explain: force along its normal, moments about axes in it.

    Args:
        mechanism: The mechanism.
        frame: Pose of the wrench's frame in the base frame (4, 4).
        free: False to include mechanisms on a resting base, whose bodies beside the plane explain the moments in part.

    Returns:
        Their indices (3), empty if the mechanism does not move in a plane or its normal is no axis of the frame.
    """
    normal = plane_normal(mechanism)
    if normal is None and not free and mechanism.carrier is None:
        normal = _common_axis(mechanism)
    if normal is None:
        return ()
    along = np.abs(frame[:3, :3].T @ normal)
    axis = int(np.argmax(along))
    if np.delete(along, axis).max() > PARALLEL:
        return ()
    return (axis, *(3 + k for k in range(3) if k != axis))


def _common_axis(mechanism: Mechanism) -> np.ndarray | None:
    """Unit normal of the plane in which all joints move, perpendicular to gravity (3,); None without one."""
    screws, g = np.hstack([np.zeros((6, 0)), *mechanism.tree.screws]), mechanism.gravity
    axes = screws[3:, screws[3:].any(axis=0)]
    if not axes.size:
        return None
    normal = axes[:, 0] / np.linalg.norm(axes[:, 0])
    return normal if _in_plane(mechanism.tree, normal) and abs(g @ normal) <= PARALLEL * np.linalg.norm(g) else None


def _in_plane(tree: Tree, normal: np.ndarray) -> bool:
    """True if all hinges turn about the normal, without a pitch, and all slides are perpendicular to it."""
    screws = np.hstack(tree.screws)
    v, w = screws[:3], screws[3:]
    turns = w.any(axis=0)
    off = [np.abs(np.cross(w[:, turns].T, normal)), np.abs((v * w).sum(axis=0)), np.abs(normal @ v[:, ~turns])]
    return all(x.max(initial=0) <= PARALLEL for x in off)
