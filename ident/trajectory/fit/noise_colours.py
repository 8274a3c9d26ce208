"""Noise spectrum of every stream: white noise plus noise of several correlation times, independent of a fit's weights.

    Γ = σ² Σ_b a_b Γ_b,        Γ_b: exp(-|t| / τ_b), or white,        a_b ≥ 0

Amplitudes maximise the likelihood of the residuals' spectra (Whittle), in which noise absorbed by the fit is accounted
for, as in restricted likelihood. The trajectory follows the share h(ω), and θ moves by `C Rᵀ W ε`, with rows R and
covariance C, so that noise of covariance Γ leaves residuals of covariance

    (1 - h) Γ (1 - h) - R C Rᵀ W Γ - Γ W R C Rᵀ + R C (Σ Rᵀ W Γ W R) C Rᵀ

The sum is over all streams of the kind, coordinates or channels, as if all of them had this noise. To it adds what the
fit makes of the other kind's noise and of motions of the prior, `h (1 - h) σ² + R C (S - Σ Rᵀ W R) C Rᵀ` with the
recordings' precision S of θ: white noise of all streams then leaves what a likeliest fit leaves.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.noise import autocovariance
from ident.trajectory.algebra.arrow import stacked
from ident.trajectory.algebra.rows import TOGETHER
from ident.trajectory.fit.fitted import TINIEST, TrajectoryFit, root_of_inverse
from ident.trajectory.fit.response import Response, Stream, response

SHORTEST, LONGEST, FACTOR = 2.0, 2.0, 3.0
"""Shortest correlation time in samples, length of a piece over the longest one, and ratio of neighbouring ones."""

BANDS = 24
"""Number of frequency bands, equally wide on a logarithmic scale, in which spectra are compared."""

ENOUGH = 8_000
"""Approximate number of samples from which the noise is estimated."""

ROOM = 4e7
"""Approximate number of derivatives by θ of all streams from which it is estimated. A person of 20 s has 7e7, which
take 2.2 GB; half of them take 1.3 GB, and standard deviations differ by 1 %."""

UPDATES = 100
"""Number of multiplicative updates of the amplitudes, which never lower the likelihood."""

DOUBTED = 3.0
"""Least gain in log likelihood, as if frequencies were independent, with which a correlation time is included: by
chance there is always some gain, and a little of the slowest noise matters for parameters with nearly constant columns.
It stands for a gain of 2: the taper makes neighbouring frequencies alike, by its mean fourth power of 1.5."""

LEFT = 0.05
"""Least share of white noise left in a band with which it is used, relative to the band with most."""

SHOWN = 0.3
"""Least share of a kind of noise left by the fit with which its amplitude is estimated, relative to white noise."""

AT_FLOOR = 1.01
"""Noise over its floor up to which it cannot be estimated from the stream's residual: an arm's intervals, in noise that
walks, hold in 88 instead of 94 % without."""


@dataclass(frozen=True, eq=False)
class NoiseColours:
    """Noise of each stream by correlation time.

    Attributes:
        times: Correlation times, s, zero for white noise (b,).
        amplitudes: Variances relative to those of the fit, for each stream (b, s).
    """

    times: np.ndarray
    amplitudes: Sequence[np.ndarray]


def some_responses(measurement: Measurement, fit: TrajectoryFit) -> dict[int, Response]:
    """Linear responses of every k-th piece of each recording by index, as many as suffice to estimate the noise.

    Args:
        measurement: Channels and parameters.
        fit: The fit.
    """
    samples, logs = sum(len(piece.when) for piece in fit.pieces), [piece.log for piece in fit.pieces]
    streams = len(fit.coordinate_noise) + len(fit.channel_noise)
    share = max(1, round(samples / ENOUGH), round(samples * streams * len(fit.theta) / ROOM))
    chosen = [k for k, log in enumerate(logs) if (k - logs.index(log)) % share == 0]
    return {k: response_of(measurement, fit, k) for k in chosen}


def response_of(measurement: Measurement, fit: TrajectoryFit, k: int) -> Response:
    """Linear response of one piece of a fit."""
    return response(measurement, fit.points[k])


def noise_colours(fit: TrajectoryFit, responses: Mapping[int, Response]) -> NoiseColours:
    """Noise spectrum from a fit's residuals.

    Args:
        fit: The fit.
        responses: Linear responses of some of its pieces, by index.
    """
    root = np.zeros((len(fit.free), int(fit.free.sum())))
    root[fit.free] = root_of_inverse(fit.precision[np.ix_(fit.free, fit.free)])
    streams, longest = next(iter(responses.values())).streams, max(np.ptp(fit.pieces[k].time) for k in responses)
    edges = np.geomspace(0.5 / longest, 0.5 / min(stream.step for stream in streams), BANDS + 1)
    shortest = SHORTEST * streams[-1].step
    number = max(int(np.log(longest / LONGEST / shortest) / np.log(FACTOR)) + 1, 1)
    times = np.append(0.0, shortest * FACTOR ** np.arange(number))
    total = root.T @ (fit.precision - fit.prior.precision) @ root
    share = sum(len(piece.when) for piece in fit.pieces) / sum(len(fit.pieces[k].when) for k in responses)
    by_piece = [
        [
            _Absorbed.of(here, which, root[fit.selections[k]], _Bands.of(stream, edges, times))
            for which, stream in enumerate(here.streams)
        ]
        for k, here in responses.items()
    ]
    followed = [here.followed(np.sqrt(edges[1:] * edges[:-1])) for here in responses.values()]
    amplitudes = list[np.ndarray]()
    for which, stream in enumerate(streams):
        alike = [k for k, other in enumerate(streams) if (other.by_row is None) == (stream.by_row is None)]
        pulls = share * np.sum([own[k].pulls for own in by_piece for k in alike], axis=0)
        each = zip(by_piece, followed, strict=True)
        powers = np.sum([own[which].powers(h[which], pulls, total) for own, h in each], axis=0)
        own = _amplitudes(*powers[:3], kinds=powers[3:])
        amplitudes.append(np.where(_at_floor(fit, stream), np.eye(len(times))[:, :1], own))
    return NoiseColours(times, amplitudes)


def _at_floor(fit: TrajectoryFit, stream: Stream) -> np.ndarray:
    """Mask of the coordinates whose noise is at its floor (s,)."""
    if stream.by_row is not None:
        return np.zeros(len(stream.std), bool)
    floors = [noise.floor_states for noise in fit.noises]
    return np.asarray(stream.std <= AT_FLOOR * np.max(floors, axis=0))


def taper(samples: int) -> np.ndarray:
    """Weights of a signal's samples, of mean square one, with which its spectrum leaks little (N,).

    Slow noise leaks into the bands of fast noise from the jump between the ends, as far as a fit leaves it, and the
    trajectory follows more at the ends (Riedel and Sidorenko, IEEE Trans. Signal Processing 43, 1995,
    doi:10.1109/78.365298).
    """
    return np.asarray(np.sqrt(2) * np.sin(np.pi * (np.arange(samples) + 0.5) / samples))


class _Bands(NamedTuple):
    """Frequencies of a stream of a piece, by bands.

    Attributes:
        frequency: The frequencies, Hz (F,).
        band: Band of each (F,).
        matrix: One where a frequency is in a band (B, F).
        kinds: Spectra of every kind of noise of unit variance (b, F).
        clear: Share of the samples from which noise is estimated (s,).
        observed: Power of the residuals (B, s).
    """

    frequency: np.ndarray
    band: np.ndarray
    matrix: np.ndarray
    kinds: np.ndarray
    clear: np.ndarray
    observed: np.ndarray

    @classmethod
    def of(cls, stream: Stream, edges: np.ndarray, times: np.ndarray) -> "_Bands":
        """Bands with given edges, Hz (B + 1,), and noise of given correlation times, s, zero for white (b,)."""
        N, step = len(stream.time), stream.step
        frequency, lag = np.fft.rfftfreq(N, step), np.arange(N)[:, None]
        band = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, BANDS - 1)
        pairs = autocovariance(taper(N))[:N, None] / N
        kinds = 2 * np.fft.rfft(pairs * np.exp(-lag * step / times[1:]), axis=0).real - pairs[0]
        kinds = np.vstack([np.ones(len(band)), kinds.T])
        matrix = (band == np.arange(BANDS)[:, None]).astype(float)
        signal = taper(N)[:, None] * stream.new.residual * stream.clear / stream.std
        observed = matrix @ np.abs(np.fft.rfft(signal, axis=0)) ** 2 / N
        return cls(frequency, band, matrix, kinds, stream.clear.mean(axis=0), observed)

    def summed(self, share: np.ndarray) -> np.ndarray:
        """Power of each kind of noise in the bands, of which a share is left at every frequency (F, s): (b, B, s)."""
        return np.asarray(self.matrix @ (self.kinds[..., None] * share)) * self.clear


class _Absorbed(NamedTuple):
    """Noise of every kind of a stream that θ absorbs, in a piece.

    Attributes:
        explained: Spectra of R, times a root of C, relative to the noise (F, s, q).
        bands: The frequencies by bands.
        taken: Diagonal of `R C Rᵀ W Γ` (b, B, s).
        pulls: `Rᵀ W Γ W R`, times the root on either side (b, q, q).
    """

    explained: np.ndarray
    bands: _Bands
    taken: np.ndarray
    pulls: np.ndarray

    @classmethod
    def of(cls, here: Response, which: int, root: np.ndarray, bands: _Bands) -> "_Absorbed":
        """That of a stream of a response, with a root of the covariance of θ (p, q)."""
        stream = here.streams[which]
        (N, s), q, number = stream.new.residual.shape, root.shape[1], len(bands.band)
        window, clear = taper(N)[:, None, None], (stream.clear / stream.std)[..., None]
        # All frequencies but the first and, of an even number of samples, the last stand for two.
        twice = np.where((bands.frequency > 0) & (bands.frequency < 0.5 / stream.step * (1 - 0.5 / N)), 2.0, 1.0)
        explained, across, sums = np.empty((number, s, q), complex), np.empty((number, s)), np.zeros((BANDS, q, q))
        for some, own in here.blocks(which, root):
            weighted = stream.weighted(own, some) * stream.std[some, None]
            signals = window * clear[:, some] * own, window * weighted, weighted
            explained[:, some], tapered, pulls = (np.fft.rfft(x, axis=0, norm="ortho") for x in signals)
            across[:, some] = np.einsum("fsq,fsq->fs", explained[:, some], tapered.conj()).real
            pulls *= np.sqrt(twice)[:, None, None]
            for band in np.unique(bands.band):
                pull = stacked(_parts(pulls[bands.band == band]))
                sums[band] += pull.T @ pull
        mean = bands.kinds @ bands.matrix.T / np.maximum(bands.matrix.sum(axis=1), 1)
        return cls(explained, bands, bands.matrix @ (bands.kinds[..., None] * across), np.tensordot(mean, sums, axes=1))

    def powers(self, followed: np.ndarray, pulls: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Observed power, number of frequencies, power of what else there is, and of each kind left (3 + b, B, s).

        Args:
            followed: Shares h in parts of the piece (k, B, s).
            pulls: Sum of `pulls` over all streams of the kind (b, q, q).
            total: Precision of θ from the recordings, times the root on either side (q, q).
        """
        bands, h = self.bands, followed[:, self.bands.band]
        *effects, of_others = self.effect(np.stack([*pulls, total - pulls[0]]))
        left = bands.summed(((1 - h) ** 2).mean(axis=0)) - 2 * self.taken + effects
        other = bands.summed((h * (1 - h)).mean(axis=0))[0] + of_others
        return np.maximum(np.stack([bands.observed, bands.summed(np.ones_like(h[0]))[0], other, *left]), 0)

    def effect(self, of_theta: np.ndarray) -> np.ndarray:
        """Power of effects of θ in the bands, with covariances over the root (b, q, q): (b, B, s)."""
        _, s, q = self.explained.shape
        out, kinds = np.zeros((len(of_theta), BANDS, s)), of_theta.reshape(-1, q * q)
        size = max(1, TOGETHER // (8 * q * q))
        for band in np.unique(self.bands.band):
            x = _parts(self.explained[self.bands.band == band]).swapaxes(0, 1)
            for some in (slice(first, first + size) for first in range(0, s, size)):
                # Products of the spectra serve all covariances.
                products = x[some].swapaxes(1, 2) @ x[some]
                out[:, band, some] = kinds @ products.reshape(-1, q * q).T
        return out


def _parts(spectra: np.ndarray) -> np.ndarray:
    """Real and imaginary parts (2 F, …) of spectra (F, …)."""
    return np.concatenate([spectra.real, spectra.imag])


def _amplitudes(observed: np.ndarray, counts: np.ndarray, other: np.ndarray, *, kinds: np.ndarray) -> np.ndarray:
    """Amplitudes a ≥ 0 of greatest likelihood for the model `Σ_b own_b a_b + other` of the power in bands (b, s).

    White noise comes first, and then, one by one, the kind with which the likelihood increases most.

    Args:
        observed: Observed power of every signal (B, s).
        counts: Numbers of frequencies (B, s).
        other: Power of the other streams' noise and of motions (B, s).
        kinds: What the fit leaves of each kind of noise (b, B, s).
    """
    # If the fit absorbs nearly all of a kind of noise, its residual is less than that of smoothing the motion.
    sums, left = kinds.sum(axis=1, keepdims=True), kinds[0] / np.maximum(counts, 1)
    there = (counts > 0) & (left > LEFT * left.max(axis=0))
    own = kinds * (sums > SHOWN * sums[:1]) * there
    given = np.stack([observed * there, counts * there, other])
    signals, every = there.shape[1], np.arange(len(own))[:, None]
    out = np.repeat((every == 0).astype(float), signals, axis=1)
    kept, likelihood = np.zeros((0, signals), int), np.full(signals, -np.inf)
    # Kinds that may be added to those of each signal.
    open_to = there.any(axis=0) & (every == 0)
    while open_to.any():
        added, of = np.nonzero(open_to)
        tried = np.vstack([kept[:, of], added])
        a, each = _likeliest(*given[..., of], own=own[tried, :, of].swapaxes(1, 2))
        likelihoods = np.full(open_to.shape, -np.inf)
        likelihoods[added, of] = each
        best = likelihoods.argmax(axis=0)
        gains = (added == best[of]) & (each >= likelihood[of] + DOUBTED)
        going, kept = of[gains], np.vstack([kept, best])
        likelihood[going], out[:, going] = each[gains], 0
        out[tried[:, gains], going] = a[:, gains]
        goes_on = np.isin(np.arange(signals), going)
        open_to = goes_on & own.any(axis=1) & ~(kept[:, None] == every).any(axis=0)
    return out


def _likeliest(
    observed: np.ndarray, counts: np.ndarray, other: np.ndarray, *, own: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes for several choices of k kinds of noise (k, t), and their log likelihoods (t,).

    The amplitudes follow from multiplicative updates. Arguments are those of `_amplitudes` of each choice (B, t), `own`
    that of its kinds (k, B, t).
    """
    a = np.ones((len(own), own.shape[2])) * observed.sum(axis=0) / np.maximum(own.sum(axis=(0, 1)), TINIEST)
    for step in range(UPDATES + 1):
        power = np.maximum(np.einsum("kt,kbt->bt", a, own) + other, TINIEST)
        if step < UPDATES:
            weights = counts / power
            pull, weight = (np.einsum("kbt,bt->kt", own, x) for x in (weights * (observed / power), weights))
            a *= np.sqrt(pull / np.maximum(weight, TINIEST))
    information = np.log(power / np.where(counts > 0, counts, 1)) + observed / power
    return a, -(counts * information).sum(axis=0)
