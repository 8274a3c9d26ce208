"""Residuals over time: how long they stay alike, what the motion explains, and channels that nothing could predict."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy import special

from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import autocovariance
from ident.estimation.preparation import Prepared
from ident.mechanism.mechanism import out_of_plane
from ident.mechanism.motion import Motion
from ident.recordings.smoothing import NOISE_ALONE, white_noise
from ident.regression.held_out import HeldOut
from ident.tolerances import LEFT, POOR, SIGNIFICANT, SINGULAR
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
