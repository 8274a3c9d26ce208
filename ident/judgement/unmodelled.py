"""Forces and lengths that the model lacks: hypotheses that would predict what is held out clearly better.

Parameters take up most of what a model lacks, so that its residuals may be small and follow the motion no more than
chance does. A hypothesis adds a few columns to the base parameters' Y:

    force   Σ_i a_i w_i + k Σ_i p_i w_i     w_i: channels of a unit force along axis i at a body's centre of mass p
    length  l ∂(Y φ)/∂l                     l: distance of a body's joint from its parent's frame

Both Y alone and with these columns are fitted to the fitted part by least squares, with motions smoothed from joint
angles alone; that of an estimate would already have taken up a part.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.judgement.evidence import Evidence, Unmodelled
from ident.judgement.finding import Finding, Place
from ident.judgement.residuals import coefficients
from ident.mechanism.body import BASE
from ident.mechanism.motion import Motion
from ident.model.regressor import inverse_dynamics

CLEARLY = 0.9
"""Residual with a hypothesis over that without, geometric mean over the channels, below which it is a doubt: at least
0.93 in five real recordings and in eight of simulated lifters whose delay was found; 0.4-0.7 for a cable that pulls
with 10 N/m, and 0.4-0.9 for a link whose length is 15 % off. Of 43 other recordings without a fault none asks for
it."""

ENOUGH = 5.0
"""Least number of fitted samples per column: in 156 exact samples of a right model of 149 columns, a force that does
not exist leaves 0.6 of the residual."""

STEP = 1e-6
"""Relative change of a length for its derivative, by a difference to the stated length: with another one it is another
mechanism, whose equations take longer to record than to evaluate. Channels are quadratic in it: the error is as small.
"""


@dataclass(frozen=True, eq=False)
class HypothesisFit:
    """Samples with one set-up, to which base parameters and hypotheses are fitted.

    Attributes:
        equations: Equations of m columns and C channels.
        values: Coefficients near which they are linear (m,).
        prior: Precision of what is known of them (m, m).
        fitted: Samples to fit.
        counting: Mask of their measurements that count (N, C).
        judged: Samples to predict.
    """

    equations: Equations
    values: np.ndarray
    prior: np.ndarray
    fitted: Samples
    counting: np.ndarray
    judged: Samples

    @cached_property
    def _parts(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Columns (m, N, C), and measured less predicted channels (N, C), fitted and judged."""
        parts = []
        for samples in (self.fitted, self.judged):
            blocks = self.equations.rows(replace(samples, covariance=None))
            rows = np.concatenate([each.copy() for each in blocks], axis=2).swapaxes(1, 2)
            parts.append((rows[:-1], rows[-1] - np.tensordot(self.values, rows[:-1], axes=1)))
        return parts

    def error(self, more: Sequence[np.ndarray] | None = None) -> float:
        """Logarithm of the residual of what is judged with further columns, mean over the channels.

        Args:
            more: Columns of the fitted and of the judged samples (k, N, C), None for none.
        """
        (X, left), (X_ahead, ahead) = self._parts
        more = (X[:0], X_ahead[:0]) if more is None else more
        X, X_ahead = np.concatenate([X, more[0]]), np.concatenate([X_ahead, more[1]])
        counting, scale = self.counting & np.isfinite(left), 1 / np.maximum(_rms(ahead), 1e-300)
        known = _root(self.prior, len(X))
        rows = np.vstack([(np.where(counting, X, 0) * scale).reshape(len(X), -1).T, known])
        target = np.append((np.where(counting, left, 0) * scale).ravel(), np.zeros(len(known)))
        x = coefficients(rows, target, 1e-8)
        return float(np.log(np.maximum(_rms(ahead - np.tensordot(x, X_ahead, axes=1)), 1e-300)).mean())

    def hypotheses(self) -> Iterator[tuple[tuple[str, str], float]]:
        """Yields kind and body of each hypothesis, and its `error`."""
        equations, motions = self.equations, (self.fitted.motion, self.judged.motion)
        tree, gravity = equations.mechanism.tree, equations.mechanism.gravity
        phi = _bodies(equations, self.values)
        stated = [_channels(equations, gravity, phi, motion) for motion in motions]
        for i, body in enumerate(tree.bodies):
            if body.moves and body.parent != BASE and body.home[:3, 3].any():
                pairs = zip(motions, stated, strict=True)
                yield ("length", body.name), self.error([_length(equations, phi, i, *pair) for pair in pairs])
        for k, i in enumerate(tree.inertial):
            # What pulls rests in the base's axes.
            if i in tree.moved and phi[10 * k] and all(motion.base is None for motion in motions):
                yield ("force", tree.names[i]), self.error([_force(equations, k, i, motion) for motion in motions])


def unmodelled(comparisons: Sequence[HypothesisFit]) -> tuple[Unmodelled, ...]:
    """Hypotheses with their residuals of what is judged, over those without, the best first; none of few samples.

    Args:
        comparisons: Samples with the set-up as estimated, and those with it as stated if that differs: there a
            hypothesis stands for the errors of the set-up.
    """
    if len(comparisons[0].fitted) < ENOUGH * len(comparisons[0].values):
        return ()
    usual, best = comparisons[0].error(), dict[tuple[str, str], float]()
    for comparison in comparisons:
        for key, error in comparison.hypotheses():
            best[key] = min(error, best.get(key, np.inf))
    each = (Unmodelled(*key, float(np.exp(error - usual))) for key, error in best.items())
    return tuple(sorted(each, key=lambda one: one.ratio))


def _rms(x: np.ndarray) -> np.ndarray:
    """Root mean square of each channel where it is measured (C,)."""
    return np.sqrt(np.nanmean(x**2, axis=0))


def _root(precision: np.ndarray, columns: int) -> np.ndarray:
    """R with `Rᵀ R` a precision of the first columns (k, columns)."""
    values, axes = np.linalg.eigh(precision)
    root = np.sqrt(np.maximum(values, 0))[:, None] * axes.T
    return np.pad(root, ((0, 0), (0, columns - len(root))))


def _bodies(equations: Equations, values: np.ndarray) -> np.ndarray:
    """Parameters φ of all bodies nearest to the model's that have the base parameters (10 b,)."""
    known = equations.mechanism.known
    B = equations.parameters.regroup(np.eye(len(known))).T
    links = (values - np.pad(equations.from_drives, (0, len(values)))[: len(values)])[: len(B)]
    return np.asarray(known + np.linalg.lstsq(B, links - B @ known, rcond=None)[0])


def _length(equations: Equations, phi: np.ndarray, i: int, motion: Motion, stated: np.ndarray) -> np.ndarray:
    """Derivative of stated channels (N, C) by the relative distance of a joint from its parent's frame (1, N, C)."""
    longer = STEP * np.eye(len(equations.mechanism.tree.bodies))[i]
    return (_channels(equations, equations.mechanism.gravity, phi, motion, longer) - stated)[None] / STEP


def _force(equations: Equations, k: int, i: int, motion: Motion) -> np.ndarray:
    """Channels of forces at a body's centre of mass, one along each axis and one towards the origin (4, N, C)."""
    tree, own = equations.mechanism.tree, equations.mechanism.known[10 * k : 10 * k + 4]
    point, pose = own[1:] / max(own[0], 1e-300) if own[0] else np.zeros(3), tree.poses(motion.q)[:, i]
    unit = np.zeros(10 * len(tree.inertial))
    unit[10 * k : 10 * k + 4] = 1, *point
    # A mass at rest is a force, along whatever axis gravity has.
    rest = Motion(motion.q, 0 * motion.dq, 0 * motion.ddq)
    along = np.stack([_channels(equations, axis, unit, rest) for axis in np.eye(3)])
    place = pose[:, :3, 3] + pose[:, :3, :3] @ point
    return np.concatenate([along, np.einsum("anc,na->nc", along, place)[None]])


def _channels(
    equations: Equations, gravity: np.ndarray, phi: np.ndarray, motion: Motion, longer: np.ndarray | None = None
) -> np.ndarray:
    """Channels of bodies alone (N, C), at relative increases of their distances from their parents (bodies,)."""
    wrench, torques = inverse_dynamics(equations.mechanism.tree, motion, phi, gravity, longer)
    wrench = wrench if equations.wrench is None else wrench @ equations.wrench.T
    number = len(equations.channels) - len(equations.torques)
    return np.concatenate([wrench[:, :number], torques[:, list(equations.torques)]], axis=1)


def unmodelled_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on a model that lacks a force or has a wrong length, with hypotheses nearly as good as the best."""
    clear = [each for each in evidence.unmodelled if each.ratio < CLEARLY]
    alike = [each for each in clear if each.ratio < 1.1 * clear[0].ratio]
    if alike:
        causes = [{"kind": each.kind, "body": each.body} for each in alike]
        place = Place(bodies=tuple(dict.fromkeys(each.body for each in alike)))
        yield Finding.of("unmodelled", place, causes=causes, ratio=clear[0].ratio)
