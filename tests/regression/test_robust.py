from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg
from scipy.signal import butter, lfilter, sosfilt

from ident.estimation.accumulator import remembered_sums
from ident.estimation.equations import Equations
from ident.estimation.noise import Sandwich, innovations, remembered
from ident.estimation.samples import Samples
from ident.model.axes import Axes
from ident.regression.conventional import robust_fit, spread

TRUE = np.array([2.0, -1.0, 0.5])


@dataclass(frozen=True)
class Columns:
    """Equations with given columns (N, C, m) in place of a motion."""

    channels: tuple[str, ...]
    names: tuple[str, ...]
    drives: tuple[str, ...] = ()
    offsets: tuple[int, ...] = ()
    absorbed: dict[str, np.ndarray] = field(default_factory=dict)
    mixed: tuple[str, ...] = ()

    def checked(self, samples, where=""):
        return samples

    straight, beside = False, None
    residual = Equations.residual
    axes = Axes((), (), np.zeros((0, 0)), (), np.zeros((0, 0)))

    @property
    def parameters(self):
        return SimpleNamespace(rank=len(self.names) - len(self.drives) - len(self.offsets))

    @property
    def from_drives(self):
        return np.zeros(len(self.names) - len(self.offsets))

    def order(self, samples):
        return np.arange(len(self.names) + 1), (0,) * len(self.channels)

    def rows(self, samples, factors=None, order=None):
        rows = np.concatenate([samples.motion, samples.measured[..., None]], axis=2).transpose(2, 1, 0)
        yield rows if factors is None else rows * factors.T


def fit_of(columns, measured, **options):
    names = [tuple(f"{letter}{k}" for k in range(n)) for letter, n in zip("cx", columns.shape[1:], strict=True)]
    return robust_fit(Columns(*names), Samples(columns, measured), **options)


def case(rng, samples=1000, noise=(0.1, 3.0)):
    columns = rng.normal(size=(samples, len(noise), 3))
    return columns, columns @ TRUE + np.array(noise) * rng.normal(size=(samples, len(noise)))


def test_the_fit_solves_hubers_equations():
    rng = np.random.default_rng(2)
    columns, measured = case(rng)
    measured += 2 * rng.standard_t(2, size=measured.shape)
    fit = fit_of(columns, measured)
    residual = measured - columns @ fit.values
    scale = spread(residual)
    pulls = columns * (np.clip(residual / scale, -1.345, 1.345) / scale)[..., None]
    assert (abs(pulls.sum(axis=(0, 1))) < 1e-4 * abs(pulls).sum(axis=(0, 1))).all()


@pytest.mark.slow
@pytest.mark.parametrize("colour", [None, 0.02])
def test_standard_deviations_are_right_for_white_and_for_slow_noise(colour):
    """Over 200 recordings the errors are as large as predicted, for any autocorrelation of the noise."""
    samples, errors, predicted = 600, [], []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        t = np.arange(samples) / 100
        columns = np.stack([np.sin(2 * np.pi * f * t) for f in (0.3, 0.7, 1.1)], axis=1)[:, None]
        noise = rng.normal(size=samples + 500)
        if colour:
            noise = sosfilt(butter(1, colour, output="sos"), noise)
        noise = noise[500:] / noise[500:].std()
        fit = fit_of(columns, (columns @ TRUE) + noise[:, None])
        errors.append(fit.values - TRUE)
        predicted.append(fit.std)
    ratios = np.std(errors, axis=0) / np.sqrt(np.mean(np.square(predicted), axis=0))
    assert (ratios > 0.75).all() and (ratios < 1.15).all()


def autoregressive(rng, correlation, shape):
    """Noise of variance one with an autocorrelation at a lag of one sample, samples last."""
    u = rng.normal(size=(*shape[:-1], shape[-1] + 2000))
    return lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], u, axis=-1)[..., 2000:]


def test_the_middle_of_the_sandwich_is_the_sum_over_all_pairs_of_samples():
    rng = np.random.default_rng(0)
    columns, pull = rng.normal(size=(80, 3, 4)).cumsum(axis=0), autoregressive(rng, 0.8, (3, 80))
    decay, size = innovations(pull, 4 / 3)
    rows, channels = columns.transpose(2, 1, 0), columns.swapaxes(0, 1)
    each = [remembered(x.T, rho, np.zeros(4)) for x, rho in zip(channels, decay, strict=True)]
    pulls = sum(z * u for z, u in zip(each, size, strict=True))
    steady = sum(
        x.T @ (s / (1 - rho**2) * linalg.toeplitz(rho ** np.arange(80))) @ x
        for x, rho, s in zip(channels, decay, (size**2).mean(axis=1), strict=True)
    )
    equations, samples = Columns(("c0", "c1", "c2"), ("x0", "x1", "x2", "x3")), Samples(columns, pull.T)
    same = Sandwich(4, 3)
    same.add_steady(partial(remembered_sums, equations, samples), pull, 4 / 3)
    np.testing.assert_allclose(same.middle, steady, rtol=1e-9)
    for chunks in ([rows], [rows[..., :30], rows[..., 30:]]):
        varying = Sandwich(4, 3)
        varying.add(chunks, pull, 4 / 3)
        np.testing.assert_allclose(varying.middle, pulls @ pulls.T, rtol=1e-9)
    # The same in two parts.
    z = remembered(columns[:, 0].T, 0.8, np.zeros(4))
    after = remembered(columns[30:, 0].T, 0.8, z[:, 29])
    np.testing.assert_allclose(after, z[:, 30:], rtol=1e-12)
    np.testing.assert_allclose(z[:, 79], 0.8 ** np.arange(79, -1, -1) @ columns[:, 0], rtol=1e-12)
