"""Robust least squares, and least squares at the best of several cut-offs."""

from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import wrist
from fits import sampled
from mechanisms import by_joint
from scipy import linalg
from scipy.signal import butter, lfilter, sosfilt

import ident
import sim
from ident.estimation.accumulator import remembered_sums
from ident.estimation.equations import Equations
from ident.estimation.noise import Sandwich, innovations, remembered, spread
from ident.estimation.preparation import Part, filtered, prepared
from ident.estimation.samples import Samples
from ident.estimators.least_squares import filtered_least_squares, robust_fit
from ident.estimators.predictions import Candidate
from ident.model.axes import Axes
from ident.regression.held_out import HeldOut

TRUE = np.array([2.0, -1.0, 0.5])


@dataclass(frozen=True)
class Columns:
    """Equations with given columns (N, C, m) in place of a motion."""

    channels: tuple[str, ...]
    names: tuple[str, ...]

    drives = offsets = mixed = ()
    absorbed = {}  # noqa: RUF012
    straight, beside = False, None
    residual = Equations.residual
    axes = Axes((), (), np.zeros((0, 0)), (), np.zeros((0, 0)))

    def checked(self, samples, where=""):
        return samples

    @property
    def parameters(self):
        return SimpleNamespace(rank=len(self.names))

    @property
    def from_drives(self):
        return np.zeros(len(self.names))

    def order(self, samples):
        return np.arange(len(self.names) + 1), (0,) * len(self.channels)

    def rows(self, samples, factors=None, order=None):
        rows = np.concatenate([samples.motion, samples.measured[..., None]], axis=2).transpose(2, 1, 0)
        yield rows if factors is None else rows * factors.T


def fit_of(columns, measured):
    names = [tuple(f"{letter}{k}" for k in range(n)) for letter, n in zip("cx", columns.shape[1:], strict=True)]
    return robust_fit(Columns(*names), Samples(columns, measured))


def test_the_fit_solves_hubers_equations():
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(1000, 2, 3))
    measured = columns @ TRUE + [0.1, 3.0] * rng.normal(size=(1000, 2)) + 2 * rng.standard_t(2, size=(1000, 2))
    fit = fit_of(columns, measured)
    residual = measured - columns @ fit.values
    scale = spread(residual)
    pulls = columns * (np.clip(residual / scale, -1.345, 1.345) / scale)[..., None]
    assert (abs(pulls.sum(axis=(0, 1))) < 1e-4 * abs(pulls).sum(axis=(0, 1))).all()


@pytest.mark.slow
@pytest.mark.parametrize("colour", [None, 0.02])
def test_standard_deviations_are_right_for_white_and_for_slow_noise(colour):
    """Over 200 recordings the errors are as large as predicted, for any autocorrelation of the noise."""
    errors, predicted, t = [], [], np.arange(600) / 100
    columns = np.stack([np.sin(2 * np.pi * f * t) for f in (0.3, 0.7, 1.1)], axis=1)[:, None]
    for seed in range(200):
        noise = np.random.default_rng(seed).normal(size=1100)
        if colour:
            noise = sosfilt(butter(1, colour, output="sos"), noise)
        noise = noise[500:] / noise[500:].std()
        fit = fit_of(columns, (columns @ TRUE) + noise[:, None])
        errors.append(fit.values - TRUE)
        predicted.append(fit.std)
    ratios = np.std(errors, axis=0) / np.sqrt(np.mean(np.square(predicted), axis=0))
    assert (ratios > 0.75).all() and (ratios < 1.15).all()


def test_the_middle_of_the_sandwich_is_the_sum_over_all_pairs_of_samples():
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(80, 3, 4)).cumsum(axis=0)
    pull = lfilter([0.6], [1, -0.8], rng.normal(size=(3, 180)))[:, 100:]
    decay, size = innovations(pull, 4 / 3)
    rows, channels = columns.transpose(2, 1, 0), columns.swapaxes(0, 1)
    pulls = sum(remembered(x.T, rho, np.zeros(4)) * u for x, rho, u in zip(channels, decay, size, strict=True))
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
    z = remembered(rows[:, 0], 0.8, np.zeros(4))
    np.testing.assert_allclose(z[:, 79], rows[:, 0] @ 0.8 ** np.arange(79, -1, -1), rtol=1e-12)
    np.testing.assert_allclose(remembered(rows[:, 0, 30:], 0.8, z[:, 29]), z[:, 30:], rtol=1e-12)
    # Residuals whose squares are zero have no correlation.
    assert innovations(np.full((1, 50), 1e-200), 1.0)[0] == [0.0]


def test_samples_near_reversals_are_left_alone(monkeypatch):
    """Of an arm with friction of 2 N m that sticks for 20 ms at each reversal."""
    arm, (t, q, dq, ddq) = sim.mechanism(mujoco.MjSpec.from_string(wrist.model())), wrist.motion(10.0, 100.0)
    rng = np.random.default_rng(0)
    torque = ident.joint_torque_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity) @ arm.known
    torque += 2 * np.where(np.abs(dq) < 0.05, rng.uniform(-1, 1, dq.shape), np.sign(dq))
    torque += 0.02 * rng.normal(size=q.shape)
    channels = by_joint(wrist.JOINTS, position=q + 1e-4 * rng.normal(size=q.shape), torque=torque)
    log = prepared(arm, ident.Recording(t, channels), drive=("viscous", "coulomb"))
    fitted, judged = slice(0, 600), slice(600, 970)
    rank, moving, errors = log.equations.parameters.rank, np.abs(dq[judged]) > 0.2, []
    for slow in (0.1, 0.0):
        monkeypatch.setattr("ident.estimators.least_squares.SLOW", slow)
        known = np.zeros(rank), np.zeros((rank, rank))
        fit = filtered_least_squares([Part(log, fitted)], [Part(log, judged)], log.equations, known)
        motion = filtered(log, fit.cutoffs[0])[0].motion[log.taken(judged)]
        error = Candidate(log.equations, fit.values[[0]]).residuals(Samples(motion, torque[judged]))[0]
        errors.append(np.sqrt((error[moving] ** 2).mean()))
    assert errors[0] < 0.8 * errors[1]


def test_a_residual_at_rest_is_no_part_of_the_ratio_of_any_candidate():
    """Of three channels, of which the second rests in its first 30 samples."""
    rng, moving = np.random.default_rng(0), slice(30, None)
    measured, residual = rng.normal(size=(100, 3)) + 5, 0.1 * rng.normal(size=(100, 3))
    resting = np.arange(100)[:, None] < np.array([0, 30, 0])
    wrong = np.where(resting, 9.0, residual)
    samples = sampled(*(np.full((100, 2), k) for k in range(3)), measured)
    fit = SimpleNamespace(equations=SimpleNamespace(channels=("hip", "knee", "foot")))
    chosen = np.zeros((100, 3), int)
    judged = HeldOut(np.arange(100.0), (0,), (samples,), chosen, fit, wrong, resting, rivals={"model": 2 * wrong})
    signal = measured[moving, 1].std()
    assert judged.signal[1] == pytest.approx(signal) and judged.signal[0] == pytest.approx(measured[:, 0].std())
    assert judged.ratio[1] == pytest.approx(np.sqrt((residual[moving, 1] ** 2).mean()) / signal)
    assert judged.ratio_of(judged.rivals["model"]) == pytest.approx(2 * judged.ratio)
    assert judged.relative_rms[1] == pytest.approx(judged.rms[1] / np.sqrt((measured[moving, 1] ** 2).mean()))
    assert judged.ratio_at_rest(wrong)[1] == pytest.approx(9 / signal)
    assert np.isnan(judged.ratio_at_rest(wrong)[[0, 2]]).all()
