"""Joint axes that the wrenches themselves ask for: how far off the model's axes are, without any pose measured."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg, optimize, stats

from ident.regressor import base_wrench_regressor
from ident.robust import sandwich
from ident.se3 import coAd, hat, inverse
from ident.tree import BaseMotion, Tree

SAMPLES = 1000
"""Samples used at most, evenly spread: the angle is seen long before the last one."""

STEPS = 30
"""Steps of the search at most; five are usual."""

FARTHEST = np.tan(np.radians(40))
"""Largest tangent of a tilt that is tried."""

TRUNCATED = 1e-5
"""Combinations of unit-norm columns shorter than this fraction of the longest are left out: nearly parallel axes have
base parameters of their own that hardly show."""


@dataclass(frozen=True, eq=False)
class Misalignment:
    """By how much joint axes are off.

    Attributes:
        joints: Names of the k revolute joints.
        angle: Angle between the model's axis and the one that fits the wrenches best, rad (k,).
        std: Standard deviation of each angle, rad (k,).
        p_value: Chance of such tilts, or larger ones, if the model's axes were right (k,).
        explained: Fraction of the residual's weighted sum of squares that the new axes explain.
        tree: The mechanism with the new axes.
    """

    joints: tuple[str, ...]
    angle: np.ndarray
    std: np.ndarray
    p_value: np.ndarray
    explained: float
    tree: Tree


def estimate_misalignment(
    tree: Tree,
    states: tuple[np.ndarray, np.ndarray, np.ndarray],
    wrench: np.ndarray,
    scale: np.ndarray,
    *,
    gravity: np.ndarray,
    base: BaseMotion | None = None,
    frame: np.ndarray | None = None,
) -> Misalignment:
    """Axis directions that leave the least of the wrenches unexplained, with all parameters free (variable projection).

    Args:
        tree: The mechanism.
        states: Joint coordinates, velocities and accelerations (N, n_q), (N, n), (N, n).
        wrench: Total wrench in the sensor's frame, NaN in channels that are not measured (N, 6).
        scale: Standard deviation of each channel's noise, infinite where it is to be ignored (6,).
        gravity: Acceleration of gravity as for `base_wrench_regressor`, m/s² (3,).
        base: Motion of the base, without it at rest.
        frame: Pose of the sensor's frame in the base frame (4, 4), without it the base frame itself.

    Returns:
        The angles. Constant offsets of the channels are free as well.

    Raises:
        ValueError: No joint of the mechanism turns about one axis.
    """
    turning = [i for i in tree.moving if not tree.bodies[i].is_ball and tree.bodies[i].twist[3:].any()]
    if not turning:
        raise ValueError("Axes are estimated for revolute joints; the mechanism has none.")
    part = np.unique(np.linspace(0, len(wrench) - 1, min(SAMPLES, len(wrench))).astype(int))
    states = tuple(x[part] for x in states)
    base = None if base is None else BaseMotion(base.T[part], base.V[part], base.dV[part])
    channels = np.flatnonzero(np.isfinite(wrench).all(axis=0) & np.isfinite(scale))
    target = wrench[np.ix_(part, channels)] / scale[channels]
    to_sensor = coAd(inverse(np.eye(4) if frame is None else frame))[channels]
    offsets = np.tile(np.eye(len(channels)), (len(part), 1, 1))

    def residual(tilts: np.ndarray) -> np.ndarray:
        Y = base_wrench_regressor(_tilted(tree, turning, tilts), *states, gravity=gravity, base=base)
        columns = np.concatenate([(to_sensor @ Y) / scale[channels, None], offsets], axis=2)
        rows = columns.reshape(target.size, -1)
        norms = np.linalg.norm(rows, axis=0)
        rows = rows[:, norms > 1e-9 * norms.max()] / norms[norms > 1e-9 * norms.max()]
        return target.ravel() - rows @ linalg.lstsq(rows, target.ravel(), cond=TRUNCATED)[0]

    start = np.zeros(2 * len(turning))
    # A kick off zero, where parallel axes make the model singular.
    first = start + 1e-3 * np.cos(np.arange(len(start)))
    found = optimize.least_squares(
        residual, first, bounds=(-FARTHEST, FARTHEST), diff_step=1e-4, x_scale=0.1, max_nfev=STEPS
    )
    jacobian = found.jac.reshape(*target.shape, -1)
    covariance, _ = sandwich(-jacobian, found.fun.reshape(target.shape), np.ones_like(target))
    tilts, blocks = (
        found.x.reshape(-1, 2),
        [covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(len(turning))],
    )
    wald = [float(t @ linalg.pinvh(C) @ t) for t, C in zip(tilts, blocks, strict=True)]
    before, after = (float(r @ r) for r in (residual(start), found.fun))
    return Misalignment(
        joints=tuple(tree.bodies[i].joint for i in turning),
        angle=np.arctan(np.linalg.norm(tilts, axis=1)),
        std=np.array([np.sqrt(np.trace(C) / 2) for C in blocks]),
        p_value=stats.chi2.sf(wald, 2),
        explained=1 - after / before if before else 0.0,
        tree=_tilted(tree, turning, found.x),
    )


def _tilted(tree: Tree, turning: list[int], tilts: np.ndarray) -> Tree:
    """The mechanism with some axes tilted about the point where they pass the body's frame closest."""
    bodies = list(tree.bodies)
    for i, (a, b) in zip(turning, tilts.reshape(-1, 2), strict=True):
        v, w = bodies[i].twist[:3], bodies[i].twist[3:]
        across = linalg.null_space(w[None])
        axis = w + across @ [a, b]
        axis /= np.linalg.norm(axis)
        point, pitch = np.cross(w, v), v @ w
        bodies[i] = replace(bodies[i], twist=np.concatenate([hat(point) @ axis + pitch * axis, axis]))
    return Tree(tuple(bodies))
