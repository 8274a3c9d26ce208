"""Noise spectrum of every stream: white noise plus noise of several correlation times, independent of a fit's weights.

    Γ = σ² Σ_b a_b Γ_b,        Γ_b: exp(-|t| / τ_b), or white,        a_b ≥ 0

Amplitudes maximise the likelihood of the residuals' spectra (Whittle). The residual that a fit leaves of each Γ_b is
computed from random draws, so that noise absorbed by the fit is accounted for, as in restricted likelihood; so are
residuals due to other streams' noise and to random motions of the prior.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.estimation.noise import autoregressive
from ident.trajectory.fit.fitted import TrajectoryFit
from ident.trajectory.fit.piece import Predictor
from ident.trajectory.fit.precision import embedded, inverse_of_precision
from ident.trajectory.fit.response import Response, Stream, response

SHORTEST, LONGEST, FACTOR = 2.0, 2.0, 3.0
"""Shortest correlation time in samples, length of a piece over the longest one, and ratio of neighbouring ones."""

DRAWS = 4
"""Number of random draws of each kind of noise; their spectra are averaged over bands as well."""

BANDS = 24
"""Number of frequency bands, equally wide on a logarithmic scale, in which spectra are compared."""

ENOUGH = 20_000
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

AT_FLOOR = 1.01
"""Noise over its floor up to which it cannot be estimated from the stream's residual."""

TINIEST = 1e-300

SEED = 0
"""Seed of the random draws, so that estimates are reproducible."""


@dataclass(frozen=True, eq=False)
class NoiseColours:
    """Noise of each stream by correlation time.

    Attributes:
        times: Correlation times, s, zero for white noise (b,).
        amplitudes: Variances relative to those of the fit, for each stream (b, s).
    """

    times: np.ndarray
    amplitudes: Sequence[np.ndarray]


def drawn_responses(measurement: Predictor, fit: TrajectoryFit) -> dict[int, Response]:
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
    """Noise spectrum from a fit's residuals, and from its residuals of random draws of noise.

    Args:
        fit: The fit.
        responses: Linear responses of some of its pieces, by index.
    """
    draws = _Draws.of(fit, responses)
    left = draws.left()
    amplitudes = []
    for which, stream in enumerate(draws.responses[0].streams):
        observed, expected, counts = draws.spectra(which, left)
        own, other = draws.parted(which, expected)
        each = [_amplitudes(observed[:, s], own[:, s], other[:, s], counts) for s in range(observed.shape[1])]
        amplitudes.append(np.where(_at_floor(fit, stream), np.eye(len(draws.times))[:, :1], np.array(each).T))
    return NoiseColours(draws.times, amplitudes)


def _at_floor(fit: TrajectoryFit, stream: Stream) -> np.ndarray:
    """Mask of the coordinates whose noise is at its floor (s,)."""
    if not isinstance(stream.which, int):
        return np.zeros(len(stream.std), bool)
    floors = [noise.floor_states[stream.which] for noise in fit.noises]
    return np.asarray(stream.std <= AT_FLOOR * np.max(floors, axis=0))


@dataclass(frozen=True, eq=False)
class _Draws:
    """Random draws of noise and of motions, for some pieces of a fit.

    Attributes:
        fit: The fit.
        chosen: Indices of the pieces.
        responses: Their linear responses.
        times: Correlation times, s, zero for white noise (b,).
    """

    fit: TrajectoryFit
    chosen: Sequence[int]
    responses: Sequence[Response]
    times: np.ndarray

    @classmethod
    def of(cls, fit: TrajectoryFit, responses: Mapping[int, Response]) -> "_Draws":
        """Draws for the pieces of a fit with these responses."""
        chosen = list(responses)
        first = SHORTEST * responses[chosen[0]].streams[-1].step
        longest = max(float(np.ptp(fit.pieces[k].time)) for k in chosen) / LONGEST
        number = max(int(np.log(longest / first) / np.log(FACTOR)) + 1, 1)
        return cls(fit, chosen, list(responses.values()), np.append(0.0, first * FACTOR ** np.arange(number)))

    def left(self) -> list[list[np.ndarray]]:
        """Residuals of the draws after the fit, for each piece and stream (N, s, draws).

        The draws are the coordinates' noise for each correlation time, the channels' noise, and motions.
        """
        fit, rng = self.fit, np.random.default_rng(SEED)
        number = (2 * len(self.times) + 1) * DRAWS
        right = np.zeros((len(fit.theta), number))
        steps, drawn = [], []
        for k, here in zip(self.chosen, self.responses, strict=True):
            noise = [self._noise(rng, stream) for stream in here.streams]
            c, theta = here.adjoint([stream.weights(x) for stream, x in zip(here.streams, noise, strict=True)])
            right[fit.selections[k]] += theta - here.follows.T @ c
            c[:, -DRAWS:] -= here.spline.penalty_scores(rng, here.jerk, DRAWS)
            c = here.solved(c)
            right[fit.selections[k]] -= here.stiff.T @ c
            steps.append(c)
            drawn.append(noise)
        inverse = embedded(inverse_of_precision(fit.precision[np.ix_(fit.free, fit.free)]), fit.free)
        step, out = inverse @ right, []
        for k, here, noise, c in zip(self.chosen, self.responses, drawn, steps, strict=True):
            own = step[fit.selections[k]]
            moved = here.signals(c - here.follows @ own, own)
            out.append([x - y for x, y in zip(noise, moved, strict=True)])
        return out

    def _noise(self, rng: np.random.Generator, stream: Stream) -> np.ndarray:
        """Random noise of a stream, zero in the draws of other streams (N, s, draws)."""
        N, s, b = len(stream.time), len(stream.std), len(self.times)
        u = rng.normal(size=(b, N, s, DRAWS))
        for k, time in enumerate(self.times):
            if time:
                rho = np.exp(-stream.step / time)
                u[k, 1:] *= np.sqrt(1 - rho**2)
                u[k] = autoregressive(u[k], rho)
        out = np.zeros((N, s, 2, b, DRAWS))
        out[:, :, _kind(stream)] = u.transpose(1, 2, 0, 3) * stream.std[:, None, None]
        return np.concatenate([out.reshape(N, s, -1), np.zeros((N, s, DRAWS))], axis=2)

    def spectra(self, which: int, left: Sequence[Sequence[np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Relative power of residuals in bands (B, s), of draws (B, s, draws), and numbers of frequencies (B,)."""
        streams = [here.streams[which] for here in self.responses]
        longest = max(float(np.ptp(stream.time)) for stream in streams)
        edges = np.geomspace(0.5 / longest, 0.5 / streams[0].step, BANDS + 1)
        counts, powers = np.zeros(BANDS), list[np.ndarray]()
        for stream, own in zip(streams, left, strict=True):
            N, clear = len(stream.time), stream.clear[..., None]
            band = np.searchsorted(edges, np.fft.rfftfreq(N, stream.step), side="right") - 1
            band = np.clip(band, 0, BANDS - 1)
            sums = np.zeros((BANDS, len(band)))
            sums[band, np.arange(len(band))] = 1 / N
            counts += np.bincount(band, minlength=BANDS)
            signals = np.concatenate([stream.residual[..., None], own[which]], axis=2) * clear / stream.std[:, None]
            powers.append(np.tensordot(sums, np.abs(np.fft.rfft(signals, axis=0)) ** 2, axes=1))
        power = np.sum(powers, axis=0)
        return power[..., 0], power[..., 1:], counts

    def parted(self, which: int, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residual power of a stream's own noise (B, s, b), and of the other kind's white noise and motions (B, s)."""
        noise = expected[..., :-DRAWS].reshape(*expected.shape[:2], 2, len(self.times), DRAWS).mean(axis=-1)
        kind = _kind(self.responses[0].streams[which])
        return noise[:, :, kind], noise[:, :, 1 - kind, 0] + expected[..., -DRAWS:].mean(axis=-1)


def _kind(stream: Stream) -> int:
    """0 for coordinates, 1 for channels."""
    return int(stream.by_row is not None)


def _amplitudes(observed: np.ndarray, own: np.ndarray, other: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Amplitudes a ≥ 0 of greatest likelihood for the observed power (B,) with the model `own a + other` (B, b)."""
    # If the fit absorbs nearly all of a kind of noise, its residual is less than that of smoothing the motion.
    own = own * (own.sum(axis=0) > SHOWN * own[:, 0].sum())
    left = own[:, 0] / np.maximum(counts, 1)
    there = (counts > 0) & (left > LEFT * left.max())
    if not there.any():
        return np.eye(own.shape[1])[0]
    bands = _Bands(observed[there], own[there], other[there], counts[there])
    kept, ((a,), (likelihood,)) = [0], bands.likeliest([[0]])
    while len(kept) < own.shape[1]:
        tried = [[*kept, b] for b in range(1, own.shape[1]) if b not in kept and own[:, b].any()]
        if not tried:
            break
        amplitudes, likelihoods = bands.likeliest(tried)
        best = int(np.argmax(likelihoods))
        if likelihoods[best] < likelihood + DOUBTED:
            break
        kept, a, likelihood = tried[best], amplitudes[best], likelihoods[best]
    out = np.zeros(own.shape[1])
    out[kept] = a
    return out


class _Bands(NamedTuple):
    """Observed power in bands, residual power of each kind of noise and of others, and numbers of frequencies."""

    observed: np.ndarray
    own: np.ndarray
    other: np.ndarray
    counts: np.ndarray

    def likeliest(self, kinds: list[list[int]]) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of several choices of k kinds of noise (t, k), and their log likelihoods (t,).

        The amplitudes follow from multiplicative updates.
        """
        own = self.own[:, kinds].swapaxes(0, 1)
        across, total = own.swapaxes(1, 2), np.maximum(own.sum(axis=(1, 2)), TINIEST)
        a = np.ones(own.shape[2]) * (self.observed.sum() / total)[:, None]
        power = np.maximum((own @ a[..., None])[..., 0] + self.other, TINIEST)
        pulls = np.empty((*power.shape, 2))
        for _ in range(UPDATES):
            pulls[..., 1] = self.counts / power
            pulls[..., 0] = pulls[..., 1] * self.observed / power
            sums = across @ pulls
            a *= np.sqrt(sums[..., 0] / np.maximum(sums[..., 1], TINIEST))
            power = np.maximum((own @ a[..., None])[..., 0] + self.other, TINIEST)
        return a, -(self.counts * (np.log(power / self.counts) + self.observed / power)).sum(axis=1)
