"""Checks for contacts that are not measured, and for forces and lengths with which a model would predict better.

A foot beside the force plate, a chair or a hand on a table only pushes, so that the measured support falls short of the
weight and of the force that the motion requires, and never exceeds it. Errors of the model, delays and noise have both
signs, since accelerations average to zero over a motion. At the ends of a recording the low-pass takes accelerations to
zero. Splines leave them free there, so that support counts as missing only as far as both motions require it.

Parameters take up most of what else a model lacks, so that its residuals may be small and follow the motion no more
than chance does. A hypothesis adds a few columns to the base parameters' Y:

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
from ident.estimation.preparation import LeftOut, Prepared
from ident.estimation.recorded_motion import recorded_motion
from ident.estimation.samples import Samples
from ident.geometry.se3 import applied, coAd
from ident.judgement.checks import NEAR, NotCheckedError, check_contact, predicted_wrench, upward
from ident.judgement.evidence import Evidence, Unmodelled
from ident.judgement.finding import Finding, Place
from ident.judgement.residuals import coefficients
from ident.mechanism.body import BASE
from ident.mechanism.motion import Motion
from ident.model.regressor import inverse_dynamics
from ident.recordings.smoothing import running_median, runs
from ident.recordings.times import Sampled
from ident.recordings.wrench import GROUND
from ident.tolerances import NOTABLY
from ident.trajectory.angles_alone import smoothed

SHARPER = 0.5
"""Time constant of the splines over that of the low-pass, `1 / (2 π f)`. Of 144 simulated recordings without contacts
that end in motion, something was detected in 17 by the low-pass alone, in 2 with equal constants and in none with half;
with a quarter, noise begins to hide contacts at the ends."""

AT_AN_END = 0.5
"""Shortest span at an end of a recording, in periods of the cut-off: accelerations there follow from angles on one side
only. In 8 of 648 simulated recordings without contacts something would be detected, at an end and for at most 0.26
periods; a foot beside the plates, in four recordings of a person who walks, is detected for 1.0 to 1.5."""


def without_unmeasured(prepared: Prepared) -> Prepared:
    """Recording without the samples in which an unmeasured contact carries weight."""
    return replace(prepared, left_out=unmeasured_contacts(prepared))


def unmeasured_contacts(prepared: Prepared) -> tuple[LeftOut, ...]:
    """Spans with unmeasured contacts, detected by missing support; none where no weight is known, or of poses."""
    if prepared.recording.still or prepared.guessed:
        return ()
    try:
        up, known = upward(prepared)
    except NotCheckedError:
        return ()
    predicted = predicted_wrench(prepared)
    every = (predicted, predicted_wrench(_by_splines(prepared)), prepared.wrench)
    needed, by_splines, carried = ((wrench[:, :3] * up)[:, known].sum(axis=1) for wrench in every)
    weight = prepared.mechanism.mass * float(np.linalg.norm(prepared.mechanism.gravity))
    whole = prepared.whole
    heavier = _heavier(needed[whole], carried[whole], weight)
    if heavier is None:
        return ()
    # Samples of the shortest span, and of the margin that is left out beside each.
    reach = max(1, round(0.03 * prepared.recording.rate))
    # Where a sensor's range ends support is missing as well.
    usual, missing = (
        running_median(np.where(whole, heavier * support - carried, 0), reach)
        for support in (needed, np.minimum(needed, by_splines))
    )
    # A smaller part of the weight may be an error of the model.
    limit, contacts = _limit(usual, 0.06 * heavier * weight), []
    at_an_end = AT_AN_END * prepared.recording.rate / (prepared.cutoff or np.inf)
    # Contacts are loaded gradually.
    for first, last in runs(missing > limit / 3).tolist():
        largest = float(missing[first:last].max())
        shortest = max(reach, at_an_end) if first < reach or last > len(missing) - reach else reach
        if last - first >= shortest and largest > limit:
            times = prepared.recording.time[max(0, first - reach) : last + reach]
            residual = prepared.wrench[first:last] - heavier * predicted[first:last]
            body = _body(prepared, slice(first, last), residual)
            contacts.append(LeftOut(float(times[0]), float(times[-1]), largest / (heavier * weight), body))
    return tuple(contacts)


def _by_splines(prepared: Prepared) -> Prepared:
    """Recording with its motion smoothed by splines instead of a low-pass."""

    def smoother(x: np.ndarray, rate: float, cutoff: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        if not x.size:
            return x, x, x
        time = np.arange(len(x)) / rate
        q, dq, ddq, _ = smoothed(Sampled(time, x), SHARPER / (2 * np.pi * cutoff)).evaluate(time)
        return q, dq, ddq

    if prepared.cutoff is None:
        return prepared
    motion = recorded_motion(prepared.mechanism, prepared.recording, prepared.cutoff, smoother)
    return replace(prepared, samples=replace(prepared.samples, motion=motion))


def _heavier(needed: np.ndarray, carried: np.ndarray, weight: float) -> float | None:
    """Ratio of the mechanism's mass to its model's by the samples that agree; None if too few do.

    Args:
        needed: Support that the model predicts, N (N,).
        carried: Support that is measured, N (N,).
        weight: The model's weight, N.
    """
    # Largest factor by which a mechanism is heavier or lighter than its model; part of the samples that must agree, and
    # their largest spread over that of those that agree best.
    most, agreeing, close = 1.6, 0.15, 2.0
    standing = needed > weight / 2
    ratio = np.sort(carried[standing] / needed[standing])
    ratio = ratio[(ratio > 1 / most) & (ratio < most)]
    together = int(np.ceil(agreeing * len(needed)))
    if len(ratio) <= together:
        return None
    # Of the short intervals that hold so many of them the highest: support is missing, and never too large.
    widths = ratio[together:] - ratio[:-together]
    first = int(np.flatnonzero(widths <= close * widths.min())[-1])
    middle, reach = ratio[first + together // 2], close * widths[first]
    return float(np.median(ratio[np.abs(ratio - middle) <= reach]))


def _limit(missing: np.ndarray, least: float) -> float:
    """Missing support from which there is a contact, N, at least a given one, from missing support and excess (N,).

    It is twice the excess, and six times the standard deviation of the rest.
    """
    neither = np.abs(missing) < least
    spread = float(missing[neither].std()) if neither.any() else 0.0
    return max(least, 6 * spread, 2 * float(-missing.min()))


def _body(prepared: Prepared, part: slice, residual: np.ndarray) -> str | None:
    """Body that a contact is likely on; None if no force on or near one explains most of the missing moment.

    None as well where not all six components of the wrench are measured.
    """
    if not np.isfinite(residual).all():
        return None
    in_base, unloaded = applied(coAd(prepared.frame), residual), _unloaded(prepared, part)
    contact = check_contact(prepared.mechanism.tree, prepared.samples.motion.q[part], in_base, unloaded)
    return contact.body if contact.explained > 0.8 or contact.distance < NEAR else None


def _unloaded(prepared: Prepared, part: slice) -> set[str]:
    """Bodies of measured contacts that are unloaded during most of a part: a foot on a plate is not beside it."""
    recording, loaded = prepared.recording, dict[str, float]()
    for name in recording.wrenches:
        if name != GROUND:
            body, share = str(recording.sensors[name].body), recording[f"{name}_force"][part].any(axis=1).mean()
            loaded[body] = loaded.get(body, 0.0) + float(share)
    return {body for body, share in loaded.items() if share < 1 / 2}


ENOUGH = 5.0
"""Least number of fitted samples per column: in 156 exact samples of a right model of 149 columns, a force that does
not exist leaves 0.6 of the residual."""


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
        tree = equations.mechanism.tree
        phi = _bodies(equations, self.values)
        for i, body in enumerate(tree.bodies):
            if body.moves and body.parent != BASE and body.home[:3, 3].any():
                yield ("length", body.name), self.error([_length(equations, phi, i, motion) for motion in motions])
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


def _length(equations: Equations, phi: np.ndarray, i: int, motion: Motion) -> np.ndarray:
    """Derivative of the channels by the relative distance of a joint from its parent's frame (1, N, C).

    Channels are quadratic in it, so that the difference of twice and no distance is exact.
    """
    longer, gravity = np.eye(len(equations.mechanism.tree.bodies))[i], equations.mechanism.gravity
    twice, none = (_channels(equations, gravity, phi, motion, sign * longer) for sign in (1, -1))
    return (twice - none)[None] / 2


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
    """Doubt on a model that lacks a force or has a wrong length, with hypotheses about as good as the best.

    The residual with a hypothesis over that without is at least 0.93 in five real recordings and in eight of simulated
    lifters whose delay was found; 0.4-0.7 for a cable that pulls with 10 N/m, and 0.4-0.9 for a link whose length is
    15 % off. Of 43 other recordings without a fault none asks for it.
    """
    clear = [each for each in evidence.unmodelled if NOTABLY * each.ratio < 1]
    alike = [each for each in clear if each.ratio < NOTABLY * clear[0].ratio]
    if alike:
        causes = [{"kind": each.kind, "body": each.body} for each in alike]
        place = Place(bodies=tuple(dict.fromkeys(each.body for each in alike)))
        yield Finding.of("unmodelled", place, causes=causes, ratio=clear[0].ratio)
