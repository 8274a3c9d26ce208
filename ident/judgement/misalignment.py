"""Joint axes that the wrenches themselves ask for: how far off the model's axes are, without any pose measured.

The slopes that the search needs follow from d'Alembert's principle as `ident.model.closed_form` writes it: with T the
pose of a body in an inertial frame and J its pseudo-inertia, `W = Σ T̈ J Tᵀ` holds the force in its last column and the
moment in its skew part. A tilt of a joint's axis displaces all that the joint carries by one twist, `δT = X̂ T`, so that

    δW = X̂¨ Σ T J Tᵀ + 2 X̂˙ Σ Ṫ J Tᵀ + X̂ Σ T̈ J Tᵀ + Σ T̈ J Tᵀ X̂ᵀ
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import linalg, optimize, stats

from ident.errors import ModelError
from ident.estimation.noise import Sandwich
from ident.geometry.inertia import pseudo_inertia
from ident.geometry.se3 import coAd, hat, inverse
from ident.mechanism.body import BASE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]
"""A matrix of each sample and its first two derivatives with respect to time (N, 4, 4)."""

MOST_SAMPLES = 1000
"""Samples used at most, evenly spread: the angle is seen long before the last one."""

MOST_OF_ALL_JOINTS = 4000
"""Samples times joints used at most, so that many joints take not much longer than few."""

SEARCH_STEPS = 15
"""Steps of the search at most; five are usual."""

FARTHEST = np.tan(np.radians(30))
"""Largest tangent of a tilt that is tried: an axis that is farther off is another mechanism."""

TRUNCATED = 1e-5
"""Unit-norm columns that stick out less than this of the span of others are left out: nearly parallel axes have base
parameters of their own that hardly show."""


@dataclass(frozen=True, eq=False)
class Misalignment:
    """By how much joint axes are off.

    Attributes:
        joints: Names of the k revolute joints.
        angle: Angle between the model's axis and the one that fits the wrenches best, rad (k,).
        std: Standard deviation of each angle, rad (k,).
        p_value: Chance of such tilts, or larger ones, if the model's axes were right (k,).
        at_bound: Whether the search ended at its bound, where the angle says nothing (k,).
        explained: Fraction of the residual's weighted sum of squares that the new axes explain.
        chance: Chance that they explain as much, or more, if the model's axes were right.
        tree: The mechanism with the new axes.
    """

    joints: tuple[str, ...]
    angle: np.ndarray
    std: np.ndarray
    p_value: np.ndarray
    at_bound: np.ndarray
    explained: float
    chance: float
    tree: Tree


def estimate_misalignment(
    mechanism: Mechanism,
    motion: Motion,
    wrench: np.ndarray,
    scale: np.ndarray,
    *,
    frame: np.ndarray | None = None,
) -> Misalignment:
    """Axis directions that leave the least of the wrenches unexplained, with all parameters free (variable projection).

    Args:
        mechanism: The mechanism.
        motion: How it moves (N samples).
        wrench: Total wrench in the sensor's frame, NaN in channels that are not measured (N, 6).
        scale: Standard deviation of each channel's noise, infinite where it is to be ignored (6,).
        frame: Pose of the sensor's frame in the base frame (4, 4), without it the base frame itself.

    Returns:
        The angles. Constant offsets of the channels are free as well.

    Raises:
        ModelError: No joint of the mechanism turns about one axis.
        LinAlgError: LAPACK does not converge.
    """
    tree = mechanism.tree
    turning = tuple(i for i in tree.moving if not tree.bodies[i].is_ball and tree.bodies[i].twist[3:].any())
    if not turning:
        raise ModelError("Axes are estimated for revolute joints; the mechanism has none.")
    count = min(MOST_SAMPLES, MOST_OF_ALL_JOINTS // len(turning), len(wrench))
    part = np.unique(np.linspace(0, len(wrench) - 1, count).astype(int))
    channels = np.flatnonzero(np.isfinite(wrench).all(axis=0) & np.isfinite(scale))
    problem = _Problem(
        mechanism,
        turning,
        motion[part],
        coAd(inverse(np.eye(4) if frame is None else frame))[channels] / scale[channels, None],
        wrench[np.ix_(part, channels)] / scale[channels],
    )
    fitted = lru_cache(maxsize=1)(lambda tilts: problem.fit(np.array(tilts)))
    # A kick off zero, where parallel axes make the model singular.
    start = 1e-3 * np.cos(np.arange(2 * len(turning)))
    found = optimize.least_squares(
        lambda tilts: fitted(tuple(tilts)).residual,
        start,
        jac=lambda tilts: problem.jacobian(fitted(tuple(tilts))),
        bounds=(-FARTHEST, FARTHEST),
        x_scale=0.1,
        max_nfev=SEARCH_STEPS,
    )
    return _judged(problem, problem.fit(0 * start), problem.fit(found.x))


@dataclass(frozen=True, eq=False)
class _Fit:
    """All parameters fitted with given axes: what the columns span (N C, r), φ, zero where regrouped, and the rest."""

    tilts: np.ndarray
    basis: np.ndarray
    phi: np.ndarray
    residual: np.ndarray


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is fitted: arguments of `estimate_misalignment`, weighted, and the bodies that turn about one axis."""

    mechanism: Mechanism
    turning: tuple[int, ...]
    motion: Motion
    to_channels: np.ndarray
    target: np.ndarray

    @cached_property
    def kept(self) -> list[int]:
        """Columns of the base parameters with the model's axes, and far from these, where all show that can."""
        tilted = self.tilted(np.cos(np.arange(2 * len(self.turning))))
        sensors = Sensors(moving_base=self.motion.base is not None, channels=self.to_channels)
        found = [find_base_parameters(m, sensors=sensors).kept for m in (self.mechanism, tilted)]
        return sorted({*found[0], *found[1]})

    def tilted(self, tilts: np.ndarray) -> Mechanism:
        """The mechanism with tilted axes."""
        return replace(self.mechanism, tree=_tilted(self.mechanism.tree, self.turning, tilts))

    def fit(self, tilts: np.ndarray) -> _Fit:
        """Least squares of all parameters and of constant offsets."""
        tilted, motion, kept = self.tilted(tilts), self.motion, self.kept
        Y = base_wrench_regressor(tilted.tree, *motion.states, gravity=tilted.gravity, base=motion.base, columns=kept)
        offsets = np.tile(np.eye(self.target.shape[1]), (len(self.target), 1, 1))
        columns = np.concatenate([self.to_channels @ Y, offsets], axis=2).reshape(self.target.size, -1)
        norms = np.linalg.norm(columns, axis=0)
        norms = np.where(norms > 1e-9 * norms.max(), norms, np.inf)
        Q, R, order = linalg.qr(columns / norms, mode="economic", pivoting=True)
        sizes = np.abs(np.diag(R))
        rank = int((sizes > TRUNCATED * sizes[0]).sum())
        Q, along = Q[:, :rank], Q[:, :rank].T @ self.target.ravel()
        values = np.zeros(len(norms))
        values[order[:rank]] = linalg.solve_triangular(R[:rank, :rank], along)
        phi = np.zeros(10 * len(tilted.bodies))
        phi[kept] = (values / norms)[: len(kept)]
        return _Fit(tilts, Q, phi, self.target.ravel() - Q @ along)

    def jacobian(self, fit: _Fit) -> np.ndarray:
        """Slopes of the residual, `-(1 - Q Qᵀ) ∂(Y φ)/∂tilts` (Kaufman, BIT 15, 1975) (N C, 2 k)."""
        slopes = _slopes(self, fit)
        rows = (self.to_channels @ slopes).reshape(self.target.size, -1)
        return fit.basis @ (fit.basis.T @ rows) - rows


def _judged(problem: _Problem, before: _Fit, after: _Fit) -> Misalignment:
    """The tilts, and what the residuals before and after say of them: Wald tests of each and an F-test of all.

    The F-test takes the noise that the covariance of the tilts has, correlation over time included, and counts what has
    been fitted besides: base parameters that only tilted axes show.
    """
    joints, shape = len(problem.turning), problem.target.shape
    slopes = problem.jacobian(after)
    # All that was fitted takes part of the noise, though the tilts' columns are at right angles to the others'.
    fitted = np.hstack([slopes, after.basis])
    rows, count = fitted.reshape(*shape, -1).transpose(2, 1, 0), fitted.shape[1]
    sandwich = Sandwich(count, shape[1], steady=True)
    sandwich.add([rows], after.residual.reshape(shape).T, count / shape[1])
    bread = linalg.pinvh(fitted.T @ fitted)
    covariance = (bread @ sandwich.middle @ bread)[: 2 * joints, : 2 * joints]
    tilts = after.tilts.reshape(-1, 2)
    blocks = [covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(joints)]
    wald = [float(t @ linalg.pinvh(C) @ t) for t, C in zip(tilts, blocks, strict=True)]
    worse, better = (float(fit.residual @ fit.residual) for fit in (before, after))
    explains = 2 * joints + max(after.basis.shape[1] - before.basis.shape[1], 0)
    noise = max(float(np.trace(slopes.T @ slopes @ covariance)) / (2 * joints), 1e-300)
    spare = max(better / noise - before.basis.shape[1] - explains, 1)
    return Misalignment(
        joints=tuple(problem.mechanism.tree.bodies[i].joint for i in problem.turning),
        angle=np.arctan(np.linalg.norm(tilts, axis=1)),
        std=np.array([np.sqrt(np.trace(C) / 2) for C in blocks]),
        p_value=stats.chi2.sf(wald, 2),
        at_bound=(np.abs(tilts) > 0.95 * FARTHEST).any(axis=1),
        explained=1 - better / worse if worse else 0.0,
        chance=float(stats.f.sf((worse - better) / (explains * noise), explains, spare)),
        tree=problem.tilted(after.tilts).tree,
    )


def _tilted(tree: Tree, turning: tuple[int, ...], tilts: np.ndarray) -> Tree:
    """The mechanism with some axes tilted about the point where they pass the body's frame closest."""
    bodies = list(tree.bodies)
    for i, tilt in zip(turning, tilts.reshape(-1, 2), strict=True):
        v, w = bodies[i].twist[:3], bodies[i].twist[3:]
        axis = w + linalg.null_space(w[None]) @ tilt
        axis /= np.linalg.norm(axis)
        bodies[i] = replace(bodies[i], twist=np.concatenate([hat(np.cross(w, v)) @ axis + (v @ w) * axis, axis]))
    return Tree(tuple(bodies))


def _turns(twist: np.ndarray, tilt: np.ndarray) -> list[np.ndarray]:
    """How an axis turns as either of its tilts grows: twists in the body's frame, per unit of tilt (6,)."""
    w, point = twist[3:], np.cross(twist[3:], twist[:3])
    across = linalg.null_space(w[None])
    axis = w + across @ tilt
    turns = np.cross(axis, across.T) / (axis @ axis)
    return [np.concatenate([np.cross(point, turn), turn]) for turn in turns]


def _slopes(problem: _Problem, fit: _Fit) -> np.ndarray:
    """Derivatives of the predicted base wrench with respect to the tilts (N, 6, 2 k)."""
    tilted = problem.tilted(fit.tilts)
    tree, (homes, swings, poses) = tilted.tree, _motions(tilted, problem.motion)
    J = np.zeros((len(tree.bodies), 4, 4))
    J[list(tree.inertial)] = pseudo_inertia(fit.phi.reshape(-1, 10))
    carried = [_right(T, own @ np.swapaxes(T[0], -1, -2)) for T, own in zip(poses, J, strict=True)]
    for i in reversed(range(len(tree.bodies))):
        if (parent := tree.bodies[i].parent) != BASE:
            a, b = carried[parent], carried[i]
            carried[parent] = a[0] + b[0], a[1] + b[1], a[2] + b[2]
    slopes = []
    for i, tilt in zip(problem.turning, fit.tilts.reshape(-1, 2), strict=True):
        back, (_, dT, ddT), (A, dA, ddA) = inverse(poses[i][0]), poses[i], carried[i]
        for turn in map(hat, _turns(problem.mechanism.tree.bodies[i].twist, tilt)):
            # The axis turns before the joint moves, and back behind it.
            E, dE, ddE = swings[i]
            bend = turn @ E - E @ turn, turn @ dE - dE @ turn, turn @ ddE - ddE @ turn
            D, dD, ddD = _product(homes[i], bend)
            X = D @ back
            dX = (dD - X @ dT) @ back
            ddX = (ddD - 2 * dX @ dT - X @ ddT) @ back
            W = ddX @ A + 2 * dX @ dA + X @ ddA + ddA @ np.swapaxes(X, -1, -2)
            moment = [W[:, 2, 1] - W[:, 1, 2], W[:, 0, 2] - W[:, 2, 0], W[:, 1, 0] - W[:, 0, 1]]
            slopes.append(np.column_stack([W[:, :3, 3], *moment]))
    return np.stack(slopes, axis=2)


def _motions(mechanism: Mechanism, motion: Motion) -> tuple[list[Jet], list[Jet], list[Jet]]:
    """For each body the frame that its joint hangs on, what the joint does, and both multiplied: its pose.

    All are seen from an inertial frame that is the base's at the instant and falls, so that gravity is at rest.
    """
    tree, base, count = mechanism.tree, motion.base, len(motion)
    V, dV, down = np.zeros((count, 6)), np.zeros((count, 6)), np.tile(mechanism.gravity, (count, 1))
    if base is not None:
        V, dV, down = base.V, base.dV, mechanism.gravity @ base.T[:, :3, :3]
    root = _swing(np.tile(np.eye(4), (count, 1, 1)), V, dV - np.pad(down, ((0, 0), (0, 3))))
    homes: list[Jet] = []
    swings: list[Jet] = []
    poses: list[Jet] = []
    shares = tree.body_coordinates(motion.q), tree.body_velocities(motion.dq), tree.body_velocities(motion.ddq)
    for body, q, dq, ddq in zip(tree.bodies, *shares, strict=True):
        homes.append(_right(root if body.parent == BASE else poses[body.parent], body.home))
        swings.append(_swing(body.joint_pose(q), dq @ body.motions.T, ddq @ body.motions.T))
        poses.append(_product(homes[-1], swings[-1]))
    return homes, swings, poses


def _swing(T: np.ndarray, V: np.ndarray, dV: np.ndarray) -> Jet:
    """A pose that moves with a body twist."""
    return T, T @ hat(V), T @ (hat(V) @ hat(V) + hat(dV))


def _right(a: Jet, constant: np.ndarray) -> Jet:
    """Each of a jet times a matrix."""
    return a[0] @ constant, a[1] @ constant, a[2] @ constant


def _product(a: Jet, b: Jet) -> Jet:
    return a[0] @ b[0], a[1] @ b[0] + a[0] @ b[1], a[2] @ b[0] + 2 * a[1] @ b[1] + a[0] @ b[2]
