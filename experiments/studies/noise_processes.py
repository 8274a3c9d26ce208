"""Unit-variance noise that is not white or not normal, and quantisation."""

import numpy as np
from scipy.signal import lfilter


def autoregressive(rng: np.random.Generator, samples: int, decay: float) -> np.ndarray:
    """Noise of variance one, `x_k = ρ x_k-1 + √(1 - ρ²) u_k` with white u (N,)."""
    u = rng.normal(size=samples)
    u[1:] *= np.sqrt(1 - decay**2)
    return np.asarray(lfilter([1.0], [1.0, -decay], u))


def flicker(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Noise whose power falls as 1/f, each column of mean zero and variance one (N, …)."""
    samples = shape[0]
    spectrum = np.fft.rfft(rng.normal(size=shape), axis=0)
    falls = np.arange(len(spectrum), dtype=float).reshape(-1, *[1] * (len(shape) - 1)) ** 0.5
    # The constant part is zero.
    falls[0] = np.inf
    return _standard(np.fft.irfft(spectrum / falls, n=samples, axis=0))


def random_walk(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Sums of white noise, each column of mean zero and variance one (N, …)."""
    return _standard(np.cumsum(rng.normal(size=shape), axis=0))


DRIFTS = {"flicker": flicker, "walk": random_walk}
"""Drifting noise, by its name in conditions."""


def student(rng: np.random.Generator, shape: tuple[int, ...], freedom: float) -> np.ndarray:
    """White noise of variance one from Student's t with more than two degrees of freedom."""
    return rng.standard_t(freedom, size=shape) * np.sqrt((freedom - 2) / freedom)


def quantised(x: np.ndarray, step: float) -> np.ndarray:
    """Readings as multiples of a step, unchanged if it is zero."""
    return step * np.round(x / step) if step else x


def _standard(x: np.ndarray) -> np.ndarray:
    """Columns with mean zero and variance one."""
    x = x - x.mean(axis=0)
    return np.asarray(x / x.std(axis=0))
