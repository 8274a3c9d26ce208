"""Noise spectrum of every stream: white noise plus noise of several correlation times, independent of a fit's weights.

    Γ = σ² Σ_b a_b Γ_b,        Γ_b: exp(-|t| / τ_b), or white,        a_b ≥ 0

Amplitudes maximise the likelihood of the residuals' spectra (Whittle), in which noise absorbed by the fit is accounted
for, as in restricted likelihood. With the share h(ω) that the trajectory follows and the share g(ω) that θ explains,
the residual of noise of spectrum S has the spectrum

    [(1 - h)² - g] S + h (1 - h) σ²

whose last term is the other streams' noise and motions of the prior, which the trajectory confuses with this noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.fit.piece import Predictor
from ident.trajectory.fit.precision import embedded, root_of_inverse
from ident.trajectory.fit.response import Response, response

SHORTEST, LONGEST, FACTOR = 2.0, 2.0, 3.0
"""Shortest correlation time in samples, length of a piece over the longest one, and ratio of neighbouring ones."""

BANDS = 24
"""Number of frequency bands, equally wide on a logarithmic scale, in which spectra are compared."""

ENOUGH = 8_000
"""Approximate number of samples from which the noise is estimated."""

UPDATES = 100
"""Number of multiplicative updates of the amplitudes, which never lower the likelihood."""

DOUBTED = 2.0
"""Least gain in log likelihood with which a correlation time is included: by chance there is always some gain, and a
little of the slowest noise matters for parameters with nearly constant columns."""

LEFT = 0.05
"""Least share of white noise left in a band with which it is used, relative to the band with most."""

SHOWN = 0.3
"""Least share of a kind of noise left by the fit with which its amplitude is estimated, relative to white noise."""

TINIEST = 1e-300


@dataclass(frozen=True, eq=False)
class NoiseColours:
    """Noise of each stream by correlation time.

    Attributes:
        times: Correlation times, s, zero for white noise (b,).
        amplitudes: Variances relative to those of the fit, for each stream (b, s).
    """

    times: np.ndarray
    amplitudes: Sequence[np.ndarray]


def some_responses(measurement: Predictor, fit: TrajectoryFit) -> dict[int, Response]:
    """Linear responses of every k-th piece of a fit by index, as many as suffice to estimate the noise.

    Args:
        measurement: Channels and parameters.
        fit: The fit.
    """
    total = sum(len(piece.when) for piece in fit.pieces)
    return {k: response_of(measurement, fit, k) for k in range(0, len(fit.pieces), max(1, round(total / ENOUGH)))}


def response_of(measurement: Predictor, fit: TrajectoryFit, k: int) -> Response:
    """Linear response of one piece of a fit."""
    piece, theta = fit.pieces[k], fit.theta[fit.selections[k]]
    return response(measurement, piece, fit.coefficients[k], theta, fit.noises[piece.log])


def noise_colours(fit: TrajectoryFit, responses: Mapping[int, Response]) -> NoiseColours:
    """Noise spectrum from a fit's residuals.

    Args:
        fit: The fit.
        responses: Linear responses of some of its pieces, by index.
    """
    root = embedded(root_of_inverse(fit.precision[np.ix_(fit.free, fit.free)]), fit.free)
    streams, longest = next(iter(responses.values())).streams, max(np.ptp(fit.pieces[k].time) for k in responses)
    edges = np.geomspace(0.5 / longest, 0.5 / min(stream.step for stream in streams), BANDS + 1)
    shortest = SHORTEST * streams[-1].step
    number = max(int(np.log(longest / LONGEST / shortest) / np.log(FACTOR)) + 1, 1)
    times = np.append(0.0, shortest * FACTOR ** np.arange(number))
    spectra: list[np.ndarray] = [np.zeros(())] * len(streams)
    for k, here in responses.items():
        followed = here.followed(np.sqrt(edges[1:] * edges[:-1]))
        for which, rows in enumerate(here.rows):
            explained = rows @ root[fit.selections[k]]
            spectra[which] = spectra[which] + _spectra(here, which, explained, followed[which], edges, times)
    return NoiseColours(times, [np.array([_amplitudes(*each) for each in own]).T for own in spectra])


def _spectra(
    here: Response, which: int, explained: np.ndarray, followed: np.ndarray, edges: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Arguments of `_amplitudes` for every coordinate or channel of a stream (s, 3 + b, B).

    Args:
        here: Linear response of a piece.
        which: Index of the stream.
        explained: Its rows of θ times a root of the covariance of θ (N, s, q).
        followed: Share of its noise that the trajectory follows in each band (B, s).
        edges: Edges of the bands, Hz (B + 1,).
        times: Correlation times, s, zero for white noise (b,).
    """
    stream = here.streams[which]
    N, step, clear = len(stream.time), stream.step, stream.clear
    frequency, lag = np.fft.rfftfreq(N, step), np.arange(N)[:, None]
    band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, BANDS - 1)
    h = followed[band] * (frequency < 0.5 / here.spline.step)[:, None]
    g = stream.weight(2 * np.pi * frequency) * _power(explained, clear * stream.weights.scale)
    left, other = np.maximum((1 - h) ** 2 * clear.mean(axis=0) - g, 0), h * (1 - h) * clear.mean(axis=0)
    # On a circle of N samples, N - k pairs are k samples apart as in the piece, and k pairs N - k samples.
    around = (1 - lag / N) * np.exp(-lag * step / times[1:]) + lag / N * np.exp((lag - N) * step / times[1:])
    kinds = np.column_stack([np.ones(len(band)), np.fft.rfft(around, axis=0).real])
    observed = _power(stream.residual[..., None], clear / stream.std)
    every = np.stack([observed, np.ones_like(h), other, *(left * kind[:, None] for kind in kinds.T)])
    return np.asarray(every.transpose(2, 0, 1) @ (band[:, None] == np.arange(BANDS)))


def _power(signals: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Summed spectra of weighted signals (N, s, k), one for white noise of unit variance (F, s)."""
    spectra = (np.abs(np.fft.rfft(weights * each, axis=0)) ** 2 for each in np.moveaxis(signals, 2, 0))
    return np.asarray(sum(spectra) / len(signals))


def _amplitudes(observed: np.ndarray, counts: np.ndarray, other: np.ndarray, *kinds: np.ndarray) -> np.ndarray:
    """Amplitudes a ≥ 0 of greatest likelihood for the model `Σ_b own_b a_b + other` of the power in bands (b,).

    Args:
        observed: Observed power (B,).
        counts: Numbers of frequencies (B,).
        other: Power of the other streams' noise and of motions (B,).
        kinds: What the fit leaves of each kind of noise (B,) each.
    """
    # If the fit absorbs nearly all of a kind of noise, its residual is less than that of smoothing the motion.
    own = np.array([kind * (kind.sum() > SHOWN * kinds[0].sum()) for kind in kinds])
    left = kinds[0] / np.maximum(counts, 1)
    there = (counts > 0) & (left > LEFT * left.max())
    if not there.any():
        return np.eye(len(own))[0]
    likeliest = partial(_likeliest, observed[there], counts[there], other[there])
    kept, ((a,), (likelihood,)) = [0], likeliest(own[[[0]]][..., there])
    while tried := [[*kept, b] for b in np.flatnonzero(own.any(axis=1)).tolist() if b not in kept]:
        amplitudes, likelihoods = likeliest(own[tried][..., there])
        best = int(np.argmax(likelihoods))
        if likelihoods[best] < likelihood + DOUBTED:
            break
        kept, a, likelihood = tried[best], amplitudes[best], likelihoods[best]
    out = np.zeros(len(own))
    out[kept] = a
    return out


def _likeliest(
    observed: np.ndarray, counts: np.ndarray, other: np.ndarray, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes for several choices of k kinds of noise (t, k), and their log likelihoods (t,).

    The amplitudes follow from multiplicative updates. Arguments are those of `_amplitudes`, `own` that of the kinds of
    each choice (t, k, B).
    """
    a = np.ones(own.shape[:2]) * (observed.sum() / np.maximum(own.sum(axis=(1, 2)), TINIEST))[:, None]
    for step in range(UPDATES + 1):
        power = np.maximum((a[:, None] @ own)[:, 0] + other, TINIEST)
        if step < UPDATES:
            pull, weight = (own @ x[..., None] for x in (counts / power * (observed / power), counts / power))
            a *= np.sqrt(pull / np.maximum(weight, TINIEST))[..., 0]
    return a, -(counts * (np.log(power / counts) + observed / power)).sum(axis=1)
