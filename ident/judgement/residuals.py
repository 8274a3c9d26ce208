"""Residuals over time, channels that nothing could predict, and agreement: of parts of an estimate, of two estimates.

To first order, a part of the fitted samples alone is off the estimate by δ_k:

    δ_k = P_k⁻¹ g_k,        cov(δ_1 - δ_2) = P_1⁻¹ + P_2⁻¹

P_k and g_k are the precision and the right side of a part at the estimate, its trajectory eliminated.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from scipy import special

from ident.display.brief import Worded, html_table, rounded
from ident.errors import ExcitationError, InputError
from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import autocovariance, unit_of
from ident.estimation.preparation import Prepared
from ident.geometry.inertia import with_bodies
from ident.mechanism.mechanism import out_of_plane
from ident.mechanism.motion import Motion
from ident.recordings.smoothing import NOISE_ALONE, white_noise
from ident.regression.held_out import HeldOut
from ident.regression.ordinary import Fit
from ident.tolerances import LEFT, NAMED, POOR, SIGNIFICANT, SINGULAR
from ident.trajectory import left_out
from ident.trajectory.fit.fitted import embedded, inverse_of_precision, sandwich
from ident.trajectory.left_out import of_contacts
from ident.trajectory.result import TrajectoryEstimate

FAR_ABOVE = 3.0
"""Noise of a channel over its high-frequency part, or its floor, from which there is a remark."""


def coefficients(columns: np.ndarray, target: np.ndarray, rcond: float) -> np.ndarray:
    """Least-squares coefficients of columns (N, m) in a target (N,), the columns scaled to unit norm (m,)."""
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(columns / size, target, rcond=rcond)[0] / size)


def correlated_samples(left: np.ndarray, most: float) -> np.ndarray:
    """Number of samples that count as one, since residuals (N, ...) are alike for some samples (...)."""
    squares = np.maximum((left**2).sum(axis=0), 1e-300)
    lag = np.clip((left[1:] * left[:-1]).sum(axis=0) / squares, 0, most)
    return np.asarray((1 + lag) / (1 - lag))


def correlation_time(residual: np.ndarray, rate: float) -> np.ndarray:
    """Time until the autocorrelation of each residual falls below 1/e, s (C,)."""
    times = []
    for x in (residual - residual.mean(axis=0)).T:
        correlation = autocovariance(x)[:-1]
        below = np.flatnonzero(correlation < correlation[0] / np.e) if correlation[0] > 0 else np.zeros(1, int)
        times.append((below[0] if len(below) else len(x)) / rate)
    return np.array(times)


def explained_by_motion(residual: np.ndarray, motion: Motion) -> np.ndarray:
    """Share of each residual's variance that a function of q, q̇ and q̈ explains, beyond chance (C,).

    It is linear in them, sines and cosines of q, or quadratic, whichever explains more beyond chance. Of a stationary
    residual r with spectrum S that does not depend on the motion, orthonormal functions U explain on average

        E‖Uᵀr‖² = Σ_f S(f) Σ_j |Û_j(f)|²,      var ‖Uᵀr‖² ≤ 2 max(S) E‖Uᵀr‖²

    and more than the limit of chance with a probability of `SIGNIFICANT` for all channels together. The result is
    `(explained - chance) / (1 - chance)`, at least zero. S is the residual's own spectrum, smoothed by Parzen's window
    (Priestley, Spectral Analysis and Time Series, 1981, section 6.2.3), so that lines at the motion's frequencies do
    not count as chance. The first autocorrelation would not suffice: white noise and slow errors of a smoothed motion
    may be added.

    Args:
        residual: Residuals (N, C).
        motion: The motion.
    """
    # At most 3000 samples, evenly spread.
    thin = slice(None, None, -(-len(residual) // 3000))
    r = residual[thin] - residual[thin].mean(axis=0)
    spectra = np.stack([_spectrum(x) for x in r.T], axis=1)
    own = motion[thin]
    linear = np.hstack([np.sin(own.q), np.cos(own.q), own.dq, own.ddq])
    linear = (linear - linear.mean(axis=0)) / np.maximum(linear.std(axis=0), 1e-12)
    first, second = np.triu_indices(linear.shape[1])
    quadratic = np.hstack([linear, linear[:, first] * linear[:, second]])
    bases = [linear, quadratic] if quadratic.shape[1] <= len(r) / 4 else [linear]
    beyond = -float(special.ndtri(SIGNIFICANT / r.shape[1] / len(bases)))
    return np.max([_explained(r, x, spectra, beyond) for x in bases], axis=0)


def _explained(r: np.ndarray, x: np.ndarray, spectra: np.ndarray, beyond: float) -> np.ndarray:
    """Share of each residual's variance beyond chance that functions of a motion explain (C,).

    Args:
        r: Residuals without their mean (N, C).
        x: The functions (N, k).
        spectra: Power spectra of the residuals (N + 1, C).
        beyond: Standard deviations of that share that count as chance.
    """
    functions, count = _orthonormal(x), len(r)
    explained = ((functions.T @ r) ** 2).sum(axis=0) / np.maximum((r**2).sum(axis=0), 1e-12)
    power = (np.abs(np.fft.rfft(functions, 2 * count, axis=0)) ** 2).sum(axis=1)
    power[1:-1] *= 2  # All frequencies but the first and the last stand for their negatives too.
    mean = power @ spectra / (2 * count) / count
    deviation = np.sqrt(2 * spectra.max(axis=0) * mean / count)
    chance = np.minimum(mean + beyond * deviation, 1)
    return np.maximum(0, explained - chance) / np.maximum(1 - chance, 1e-12)


def _orthonormal(x: np.ndarray) -> np.ndarray:
    """Orthonormal basis of the columns less their means (N, k)."""
    x = x - x.mean(axis=0)
    squares, axes = np.linalg.eigh(x.T @ x)
    # Of dependent functions only rounding errors are left.
    kept = squares > SINGULAR * squares.max(initial=0)
    return np.asarray(x @ (axes[:, kept] / np.sqrt(squares[kept])))


def _spectrum(x: np.ndarray) -> np.ndarray:
    """Power spectrum of a signal (N,), of mean one over all frequencies, smoothed by Parzen's window (N + 1,).

    At lags beyond an eighth of a recording the autocorrelation is inaccurate, and would include the motion's own
    frequencies.
    """
    lags = np.arange(len(x) + 1) / max(1, len(x) // 8)
    window = np.where(lags < 0.5, 1 - 6 * lags**2 * (1 - lags), 2 * np.maximum(0, 1 - lags) ** 3)
    covariance = window * autocovariance(x)
    correlation = covariance / covariance[0] if covariance[0] > 0 else (lags == 0).astype(float)
    return np.maximum(np.fft.hfft(correlation), 0)[: len(x) + 1]


def still_channels(changes: Mapping[str, float]) -> dict[str, str]:
    """The reason `still` by the wrench's components that the model does not change, from predicted changes of all."""
    largest = {kind: max((x for c, x in changes.items() if c[0] == kind), default=0.0) for kind in "FM"}
    return {c: "still" for c, x in changes.items() if x <= 1e-3 * largest[c[0]]}


def idle_channels(held: HeldOut, prepared: Prepared) -> dict[str, str]:
    """Reason, as a key of `verdict.IDLE`, by the channels that are not predicted and in which nothing could be."""
    equations, mechanism, motion = held.fit.equations, prepared.mechanism, held.samples.motion
    tree = mechanism.tree
    changes = (held.samples.measured - held.residual).std(axis=0).tolist()
    idle = still_channels({c: x for c, x in zip(equations.channels, changes, strict=True) if c in COMPONENTS})
    hidden = out_of_plane(mechanism, prepared.frame, free=motion.base is not None)
    idle |= {COMPONENTS[k]: "plane" for k in hidden}
    ranges = np.ptp(tree.freedom_coordinates(motion.q), axis=0)
    balls = {name for body in tree.bodies if body.is_ball for name in body.freedom_names}
    # At rest, within 0.01 rad or m, a joint's torque is friction, of any size up to breakaway.
    resting = {tree.freedoms[k] for k in equations.torques if ranges[k] < 0.01} - balls
    idle |= {channel: "rest" for channel in equations.channels if channel in resting}
    parts = np.split(held.residual, held.starts[1:])
    # Of poses in any order everything is as rough as noise.
    for c, channel in enumerate(() if prepared.recording.still else equations.channels):
        if held.rms[c] < NOISE_ALONE * white_noise(*(part[:, c] for part in parts), robust=True):
            idle.setdefault(channel, "noise")
    # What is predicted counts, and a larger residual shows a grosser error.
    ratios = zip(equations.channels, held.ratio.tolist(), strict=True)
    return {channel: idle[channel] for channel, ratio in ratios if channel in idle and POOR < ratio <= LEFT}


def beyond_fast_noise(joint: TrajectoryEstimate, channels: Sequence[str]) -> dict[str, float]:
    """Noise of channels that are far above the sensor's fast noise, over it, by channel."""
    fit, number = joint.fit, len(joint.fit.channel_noise[: len(channels)])
    noise, floor = fit.channel_noise[:number], fit.noises[0].floor_channels[:number]
    times = noise / np.maximum(fast_noise(joint, range(number)), floor)
    return {channels[c]: float(times[c]) for c in np.flatnonzero(times > FAR_ABOVE).tolist()}


def fast_noise(joint: TrajectoryEstimate, columns: Iterable[int]) -> np.ndarray:
    """Noise of channels from sample to sample, contacts included (k,)."""
    fit = joint.fit
    own = zip(fit.pieces, fit.selections, strict=True)
    signals = [piece.measured - of_contacts(joint.measurement, piece, fit.theta[at]) for piece, at in own]
    return np.array([white_noise(*(x[:, c] for x in signals), robust=True) for c in columns])


DISAGREE = 2.0
"""Root mean square z of the differences between halves or between logs above which they disagree."""

LEAST_ADDED = 0.01
"""Least variance of these differences, over a parameter's own: it is computed as a difference, with rounding errors."""

BEYOND_CHANCE = 4.0
"""Standard deviations from which a difference is no chance: of thousands of normal numbers none is as large, and the
standard deviations may be a third too small."""


def differences(joint: TrajectoryEstimate) -> np.ndarray | None:
    """Differences of the base parameters between two halves, of the recordings if there are more, as z (r,).

    Each half is combined with half of the prior's precision. None if a half does not determine the parameters.
    """
    fit, counts = joint.fit, joint.counts
    pieces = len(fit.shares)
    first = sum(counts[: len(counts) // 2]) if len(counts) > 1 else pieces // 2
    rank = joint.measurement.equations.parameters.rank
    steps, covariances = [], []
    for half in (slice(0, first), slice(first, pieces)):
        part = fit.shares[half]
        scatter = sum(fit.scatter_shares[half], start=fit.prior.weight * fit.prior.precision / 2)
        precision = sum((schur for schur, _ in part), start=fit.prior.precision / 2)
        right = sum((g for _, g in part), start=-fit.prior.precision @ (fit.theta - fit.prior.mean) / 2)
        # What only the other half has, as an offset of its own, is not fitted.
        free = fit.free & (np.diag(precision) > 0)
        if not free[:rank].all():
            return None
        own = np.ix_(free, free)
        try:
            covariance = sandwich(precision[own], scatter[own])
        except ExcitationError:
            return None
        steps.append((inverse_of_precision(precision[own]) @ right[free])[:rank])
        covariances.append(covariance[:rank, :rank])
    return np.asarray((steps[0] - steps[1]) / np.sqrt(np.diag(covariances[0] + covariances[1])))


def widening(disagreement: float | None) -> float:
    """Factor on the standard deviations from the noise, max(1, z), for halves that differ by z; 1 without halves.

    This is Birge's ratio (Phys. Rev. 40, 207, 1932, doi:10.1103/PhysRev.40.207). For errors whose variance is φ times
    the stated one, and twelve independent differences, 95 % intervals hold in 96, 94, 93 and 93 % for φ = 1, 1.5, 2.5
    and 4: it costs 7 % of width where nothing is wrong.
    """
    return max(1.0, disagreement or 0.0)


def widenings(z: np.ndarray | None, wider: float, columns: int) -> np.ndarray:
    """Factors on the standard deviations of columns from the noise (m,).

    Halves of a parameter that differ beyond chance widen it by their own difference, if that is more: a moment that
    drifts moves the first moment of a base at rest and nothing else.

    Args:
        z: Differences of the first ones, the base parameters, as from `differences` (r,); None without halves.
        wider: Factor for the others, from `widening`.
        columns: Number m of columns.
    """
    out = np.full(columns, wider)
    if z is not None:
        beyond = -special.ndtri(SIGNIFICANT / 2 / len(z))
        out[: len(z)] = np.where(np.abs(z) > max(beyond, wider), np.abs(z), wider)
    return out


def disagreements(joint: TrajectoryEstimate) -> tuple[float, ...]:
    """Root mean square z of each recording's base parameters against those of the others; empty for one or two.

    The estimate θ of all and θ_k of all but one differ by `θ_k - θ = -(P - P_k)⁻¹ g_k`, and the right side g_k of the
    one at θ is `(1 - P_k P⁻¹) s_k - P_k P⁻¹ Σ_j≠k s_j`, with the right sides s of the recordings at the truth, whose
    covariance is that of their noise. What a recording has of its own passes for its noise, so that z is in standard
    deviations of the noise that the others have, if it has more. Empty as well if the parameters are not determined
    without one of the recordings.
    """
    if len(joint.counts) < 3:
        return ()
    rank, out = joint.measurement.equations.parameters.rank, []
    noise = np.log([each.channels for each in joint.fit.noises])
    for which in range(len(joint.counts)):
        try:
            theta, covariance = _difference(joint, which)
        except ExcitationError:
            return ()
        variances = np.maximum(np.diag(covariance)[:rank], LEAST_ADDED * np.diag(joint.fit.covariance)[:rank])
        louder = np.exp(max((noise[which] - np.median(np.delete(noise, which, axis=0), axis=0)).mean(), 0.0))
        out.append(float(louder * np.sqrt(((theta - joint.fit.theta)[:rank] ** 2 / variances).mean())))
    return tuple(out)


def without(joint: TrajectoryEstimate, which: int) -> np.ndarray:
    """Parameters without one of the recordings (p,).

    Raises:
        ExcitationError: The others do not determine them.
    """
    return left_out.without(joint.fit, joint.pieces_of(which))[0]


def _difference(joint: TrajectoryEstimate, which: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters without one of the recordings (p,), and the covariance of their difference from those of all (p, p).

    Raises:
        ExcitationError: The others do not determine them.
    """
    fit, own = joint.fit, joint.pieces_of(which)
    theta, inverse, free = left_out.without(fit, own)
    each = np.ix_(free, free)
    schur = np.sum([schur for schur, _ in fit.shares[own]], axis=0)[each]
    scatter = np.sum(fit.scatter_shares[own], axis=0)[each]
    # The recording's right side is its own noise's, less what all noise has moved the estimate by. Of recordings alike,
    # what repeats in all of them cancels.
    moved = schur @ inverse_of_precision(fit.precision[each])
    apart, others = np.eye(len(moved)) - moved, fit.scatter - sum(fit.scatter_shares[len(fit.shares) :])
    noise = apart @ scatter @ apart.T + moved @ (others[each] - scatter) @ moved.T
    return theta, embedded(inverse @ noise @ inverse, free)


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Worded):
    """The difference between two estimates from recordings of their own.

    Attributes:
        names: Names of the r parameters, the base parameters first, then the drives that both have.
        difference: First less second (r,).
        covariance: Its covariance, the sum of both (r, r).
        bodies: Names of the bodies.
    """

    names: tuple[str, ...]
    difference: np.ndarray
    covariance: np.ndarray
    bodies: tuple[str, ...] = ()

    @property
    def z(self) -> np.ndarray:
        """Each difference in its standard deviations (r,)."""
        return self.difference / np.sqrt(np.diag(self.covariance))

    @property
    def chi2(self) -> float:
        """Squared Mahalanobis distance, distributed as χ² with r degrees of freedom if nothing but noise differs."""
        return float(self.difference @ np.linalg.solve(self.covariance, self.difference))

    @property
    def p_value(self) -> float:
        """Chance of a distance at least as large, if nothing but noise differs."""
        return float(special.chdtrc(len(self.names), self.chi2))

    @property
    def order(self) -> np.ndarray:
        """Parameters in descending order of |z| (r,)."""
        return np.argsort(-np.abs(self.z), kind="stable")

    @property
    def differs(self) -> bool:
        """True if the difference is more than noise."""
        return self.p_value < SIGNIFICANT

    def __str__(self) -> str:
        rows = ((name, f"{by} ± {std} {unit}".strip(), z) for name, by, std, unit, z in self._rows(NAMED))
        largest = "; ".join(f"{name} by {size} (z {z})" for name, size, z in rows)
        p = f"p {self.p_value:.2g}" if self.p_value else "p below 1e-300"
        how = "more" if self.differs else "no more"
        return (
            f"χ² is {self.chi2:.1f} of {len(self.names)} parameters ({p}), {how} than noise explains. "
            f"The largest differences, ± one standard deviation: {largest}."
        )

    def _rows(self, most: int | None = None) -> Iterator[tuple[str, ...]]:
        """Parameter, difference, its standard deviation, unit and z, the largest first."""
        for k in self.order[:most]:
            by, std = rounded(self.difference[k], float(np.sqrt(self.covariance[k, k])))
            by = by if by.startswith("-") else f"+{by}"
            unit = unit_of(self.names[k]) or ""
            yield with_bodies([self.names[k]], self.bodies), by, std, unit, f"{self.z[k]:+.1f}"

    def _repr_html_(self) -> str:
        heads = ("parameter", "difference", "s.d.", "unit", "z")
        sentence = escape(str(self).partition(" The largest")[0])
        return f"<div><p>{sentence}</p>{html_table(heads, self._rows(), (1, 2, 4))}</div>"


def compared(first: Fit, second: Fit) -> Comparison:
    """Compares the base parameters of two fits, and the drives that both have.

    Raises:
        InputError: They are not of the same base parameters.
    """
    names = first.parameters.names
    if names != second.parameters.names:
        raise InputError(
            f"Estimates of the same base parameters can be compared, got {', '.join(names)} and "
            f"{', '.join(second.parameters.names)}."
        )
    names += tuple(name for name in first.equations.drives if name in second.equations.drives)
    a, b = ([fit.names.index(name) for name in names] for fit in (first, second))
    covariance = first.covariance[np.ix_(a, a)] + second.covariance[np.ix_(b, b)]
    return Comparison(names, first.values[a] - second.values[b], covariance, first.equations.mechanism.bodies)
