"""Joint axes from measured link poses (Section VI: "recover the true axis of rotation given kinematic data")."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from ident.annotations import typed
from ident.errors import InputError, ModelError
from ident.geometry import se3
from ident.mechanism.body import BASE
from ident.mechanism.tree import Tree
from ident.tolerances import LEAST_SAMPLES, ROUNDING, SIGNIFICANT

MINIMUM_TURN = 1e-3
"""Smallest root-mean-square rotation, in rad, from which an axis is recovered."""


@dataclass(frozen=True, eq=False)
class Direction:
    """A measured unit vector and the influence of each sample's noise on it.

    Attributes:
        vector: The unit vector (3,).
        influence: Contribution of each sample to its error (N, 3); its covariance is `influence.T @ influence`. It is
            kept by sample because a pose that two joints share correlates their errors.
    """

    vector: np.ndarray
    influence: np.ndarray

    @property
    def std(self) -> float:
        """Standard deviation as an angle in rad, root mean square over the two directions in which it can tilt."""
        return float(np.sqrt(np.sum(self.influence**2) / 2))

    def turned(self, R: np.ndarray) -> "Direction":
        """The direction expressed in another frame, as `R @ vector`."""
        return Direction(R @ self.vector, self.influence @ R.T)

    def along(self, other: "Direction") -> "Direction":
        """This direction or its opposite, whichever is nearer to the other one."""
        sign = -1.0 if self.vector @ other.vector < 0 else 1.0
        return Direction(sign * self.vector, sign * self.influence)


@dataclass(frozen=True, eq=False)
class Screw:
    """Axis of a revolute joint, in the frame that moves with it.

    Attributes:
        axis: Its direction.
        point: Its point nearest to the frame's origin, m (3,).
    """

    axis: Direction
    point: np.ndarray


@dataclass(frozen=True, eq=False)
class RecoveredAxes:
    """Axes of all n joints of a tree, and the groups of axes that are taken as parallel.

    Attributes:
        tree: The design with its axes turned to the recovered directions, through the design's points.
        axes: Recovered axes, in the base frame with the mechanism at home.
        separate: Axis of each trajectory estimated alone, in the same frame; equal to `axes` where nothing was pooled.
        points: Point of each axis nearest to its body's origin, in the body frame, m (n, 3).
        p_values: p-value of the test that a joint's axis is parallel to that of the joint before it, NaN where there
            is none (n,).
        groups: Indices of the joints that share one direction.
    """

    tree: Tree
    axes: tuple[Direction, ...]
    separate: tuple[Direction, ...]
    points: np.ndarray
    p_values: np.ndarray
    groups: tuple[tuple[int, ...], ...]


def estimate_screw(displacement: np.ndarray, positive: np.ndarray) -> Screw:
    """Axis of a revolute joint, estimated from noisy poses.

    No displacement moves the axis: `R a = a` and `R c + p = c`. The direction a minimises `Σ‖(R - 1) a‖²` over unit
    vectors, the point c then solves its equation by least squares. Isotropic noise on the orientation does not bias a
    to first order.

    Args:
        displacement: Poses `T_home⁻¹ T(t)` of the moving frame relative to its home (N, 4, 4).
        positive: A vector with a positive component along the axis, to choose its sign (3,).

    Returns:
        The screw, in the moving frame.

    Raises:
        InputError: There are too few poses, the frame hardly turns, or the sign of the axis is undetermined.
    """
    if len(displacement) < LEAST_SAMPLES or not np.isfinite(displacement).all():
        raise InputError(f"An axis needs at least {LEAST_SAMPLES} finite poses, got {len(displacement)}.")
    turn = displacement[:, :3, :3] - np.eye(3)
    # ‖R - 1‖² = 4 (1 - cos θ) ≈ 2 θ² in the Frobenius norm.
    if np.mean(np.sum(turn**2, axis=(1, 2))) < 2 * MINIMUM_TURN**2:
        raise InputError(f"An axis needs rotations of at least {MINIMUM_TURN} rad (root mean square) to show.")
    vectors = np.linalg.eigh(np.einsum("nij,nik->jk", turn, turn))[1]
    axis, plane = vectors[:, 0], vectors[:, 1:]
    if axis @ positive < 0:
        axis = -axis

    slope = turn @ plane
    normal = np.einsum("nij,nik->jk", slope, slope)
    gradient = np.einsum("nij,ni->nj", slope, turn @ axis)
    influence = -np.linalg.solve(normal, gradient.T).T @ plane.T
    direction = Direction(axis, influence)
    if not axis @ positive > 5 * direction.std * np.linalg.norm(positive):
        raise InputError("The axis is perpendicular to the one it should resemble, so that its sense is undefined.")
    offset = np.linalg.solve(normal, np.einsum("nij,ni->j", slope, -displacement[:, :3, 3]))
    return Screw(direction, plane @ offset)


def parallel_p_value(a: Direction, b: Direction) -> float:
    """p-value of a Wald test that two directions are parallel (or opposite).

    If they are, half their squared Mahalanobis distance is distributed as F with 2 and N - 2 degrees of freedom; the
    covariance of their difference includes errors shared sample by sample.

    Returns:
        Probability of a difference at least as large if they are parallel.
    """
    b = b.along(a)
    plane = np.linalg.svd((a.vector + b.vector)[None])[2][1:].T
    difference = (a.vector - b.vector) @ plane
    influence = (a.influence - b.influence) @ plane
    covariance = influence.T @ influence + ROUNDING**2 * np.eye(2)
    distance = difference @ np.linalg.solve(covariance, difference)
    return float(special.fdtrc(2, max(len(influence) - 2, 1), distance / 2))


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Angle between two vectors (3,) in rad, accurate also for small ones."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def common_direction(directions: Sequence[Direction]) -> Direction:
    """Common direction of parallel axes: their mean, weighted by inverse variance, with the first one's sign."""
    aligned = [d.along(directions[0]) for d in directions]
    weights = np.array([1 / (d.std**2 + ROUNDING**2) for d in aligned])
    weights /= weights.sum()
    mean = sum(w * d.vector for w, d in zip(weights, aligned, strict=True))
    influence = sum(w * d.influence for w, d in zip(weights, aligned, strict=True))
    return Direction(mean / np.linalg.norm(mean), influence)


@typed()
def recover_axes(tree: Tree, poses: np.ndarray, *, significance: float = SIGNIFICANT) -> RecoveredAxes:
    """Revolute axes of a mechanism, estimated from the measured poses of its bodies.

    Every joint is first estimated alone, from the poses of its two bodies, and then compared with the joint before it
    (`parallel_p_value`). Axes that do not differ significantly from parallel get a common direction. Two estimates are
    never exactly parallel, and the smallest difference would add base parameters that the mechanism does not have (for
    the double pendulum an ill-conditioned rank 15 instead of 13).

    Args:
        tree: The design: home poses and nominal twists, which give each axis its sign and its position.
        poses: Measured pose of every body in the base frame (N, b, 4, 4).
        significance: Probability of separating truly parallel axes; 1 keeps every axis separate.

    Returns:
        The recovered axes.

    Raises:
        ModelError: A joint is not revolute.
        InputError: A joint hardly moves.
    """
    check_revolute(tree)
    screws = [_joint_screw(tree, poses, i) for i in tree.moving]
    axes = with_axes(tree, [screw.axis for screw in screws], significance)
    return replace(axes, points=np.array([screw.point for screw in screws]))


def check_revolute(tree: Tree) -> None:
    """Refuses joints that do more than turn about one axis.

    Raises:
        ModelError: A joint is not revolute.
    """
    for body in (tree.bodies[i] for i in tree.moving):
        if not body.twist[3:].any() or abs(body.twist[3:] @ body.twist[:3]) > ROUNDING:
            raise ModelError(f"Joint '{body.joint}' slides; axes are recovered for revolute joints only.")


def with_axes(tree: Tree, alone: Sequence[Direction], significance: float) -> RecoveredAxes:
    """Axes of a mechanism by those of its joints alone, through the design's points.

    Args:
        tree: The design.
        alone: Axis of each joint, in the frame of its body (n,).
        significance: Probability of separating truly parallel axes; 1 keeps every axis separate.
    """
    home = tree.poses(np.zeros(len(tree.moving)))[:, :3, :3]
    separate = [axis.turned(home[i]) for i, axis in zip(tree.moving, alone, strict=True)]
    p_values, groups = _parallel(tree, separate, significance)
    axes = list(separate)
    for group in (each for each in groups if len(each) > 1):
        common = common_direction([separate[j] for j in group])
        for j in group:
            axes[j] = common.along(separate[j])
    design = np.array([tree.bodies[i].twist for i in tree.moving])
    points = np.cross(design[:, 3:], design[:, :3])
    turned = np.array([home[i].T @ axis.vector for i, axis in zip(tree.moving, axes, strict=True)])
    return RecoveredAxes(
        tree=tree.with_twists(np.hstack([np.cross(points, turned), turned])),
        axes=tuple(axes),
        separate=tuple(separate),
        points=points,
        p_values=p_values,
        groups=tuple(map(tuple, groups)),
    )


def _parallel(tree: Tree, separate: Sequence[Direction], significance: float) -> tuple[np.ndarray, list[list[int]]]:
    """p-values of the test against the next joint towards the base (n,), and groups of joints taken as parallel."""
    p_values, groups = np.full(len(separate), np.nan), list[list[int]]()
    for j, i in enumerate(tree.moving):
        carriers = [tree.moving.index(k) for k in tree.chain(i)[:-1] if tree.bodies[k].moves]
        if carriers:
            p_values[j] = parallel_p_value(separate[carriers[-1]], separate[j])
        if significance < 1 and p_values[j] >= significance:
            next(group for group in groups if carriers[-1] in group).append(j)
        else:
            groups.append([j])
    return p_values, groups


def _joint_screw(tree: Tree, poses: np.ndarray, i: int) -> Screw:
    body = tree.bodies[i]
    parent = np.eye(4) if body.parent == BASE else poses[:, body.parent]
    try:
        return estimate_screw(se3.inverse(body.home) @ se3.inverse(parent) @ poses[:, i], body.twist[3:])
    except InputError as error:
        raise InputError(f"Joint '{body.joint}': {error}") from None
