"""The start of an estimate, and a share of long recordings."""

import driven_arm
import numpy as np
import pytest
from measurements import random_measurement
from recorded_faults import PENDULUM, faulty

import ident
from ident.errors import ExcitationError
from ident.trajectory import moves, stages, trajectory_estimate
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.fit import iteration
from ident.trajectory.fit.piece import Piece
from ident.trajectory.start import smoothed, start

SIGMA = np.array([0.01, 0.2])


def rms(x):
    return np.sqrt(np.nanmean(x[50:-50] ** 2, axis=0))


@pytest.mark.parametrize(("seed", "missing"), [(0, 0.0), (1, 0.2)])
def test_smoothing_finds_the_noise_and_beats_the_samples(seed, missing):
    rng, time = np.random.default_rng(seed), np.arange(0, 12, 0.01)
    exact = np.stack([np.sin(2 * time) + 0.5 * np.cos(5 * time), 3 * np.sin(1.3 * time + 1)], axis=1)
    measured, spline = exact + SIGMA * rng.normal(size=exact.shape), Spline.over(-0.1, 12.1, 0.1)
    measured[rng.uniform(size=measured.shape) < missing] = np.nan
    result = smoothed([Piece(spline, time, measured, time[:0], np.zeros((0, 0)), np.zeros((0, 2, 0)))])
    np.testing.assert_allclose(result.noises[0].states, SIGMA, rtol=0.1)
    x = spline.evaluate(result.coefficients[0], time)
    velocity, difference = (np.gradient(each, time, axis=0) for each in (exact, measured))
    assert (rms(x[0] - exact) < 0.4 * SIGMA).all()
    assert (rms(x[1] - velocity) < 0.1 * rms(difference - velocity)).all()


@pytest.mark.parametrize("seed", range(2))
def test_a_start_finds_parameters_and_noise_of_a_good_recording(seed):
    """With almost exact angles, standard deviations of channels are right, and parameters are within theirs."""
    rng, time, spline = np.random.default_rng(seed), np.arange(0, 8, 0.01), Spline.over(-0.1, 8.1, 0.1)
    m = random_measurement(rng, 3, ("revolute",), contacts=0)
    r, p = len(m.equations.names), len(m.names)
    phases, at = rng.uniform(0, 6, (2, m.coordinates)), np.arange(spline.size)[:, None]
    c = 1.5 * np.sin(0.3 * at + phases[0]) + np.sin(0.11 * at + phases[1])
    theta = np.where(np.arange(p) < r, rng.normal(size=p), 0)
    x, nothing = spline.evaluate(c, time), np.zeros((len(time), 2, 0))
    clean = m.values(x[:3], nothing, theta).T
    std = 0.02 * clean.std(axis=0) + 1e-3
    measured = clean + std * rng.normal(size=clean.shape)
    measured[rng.uniform(size=measured.shape) < 0.05] = np.nan
    own = Piece(spline, time, x[0] + 1e-6 * rng.normal(size=x[0].shape), time, measured, nothing)
    found, (noise,) = start(m, [own], smoothed([own]), (np.zeros(p), np.zeros((p, p))), np.arange(p) < r)
    assert not found[r:].any() and not noise.channels_rho.any()
    np.testing.assert_allclose(noise.channels, std, rtol=0.15)
    np.testing.assert_allclose(noise.floor_channels, 1e-3 * np.nanstd(measured, axis=0))
    fitted = m.values(x[:3], nothing, found).T
    assert (np.sqrt(np.mean((fitted - clean) ** 2, axis=0)) < 0.25 * std).all()


def test_a_share_decides_and_all_is_fitted_at_the_end(monkeypatch):
    """Of a share that does not determine the parameters, twice as much is taken."""
    usual = ident.identify(driven_arm.mechanism(), driven_arm.log()).fit
    fits, covariances, fit, with_scatter = [], [], iteration.fit, stages.with_scatter
    begun = stages.Stages.begun

    def counting(measurement, begin, **how):
        if len(begin.theta):
            fits.append(sum(len(piece.when) for piece in begin.pieces))
        return fit(measurement, begin, **how)

    def scattered(measurement, fit, **how):
        covariances.append(sum(len(piece.when) for piece in fit.pieces))
        return with_scatter(measurement, fit, **how)

    def refused(self, steps, share):
        if share == 4:
            raise ExcitationError("The recording does not determine all parameters.")
        return begun(self, steps, share)

    monkeypatch.setattr(iteration, "fit", counting)
    monkeypatch.setattr(stages, "with_scatter", scattered)
    monkeypatch.setattr(stages.Stages, "begun", refused)
    monkeypatch.setattr(trajectory_estimate, "ENOUGH", 180)
    again = ident.identify(driven_arm.mechanism(), driven_arm.log())
    whole = sum(len(piece.time) for piece in again.trajectory.fit.pieces)
    assert min(fits) == pytest.approx(whole / 2, rel=0.1)
    assert fits.count(whole) <= 3 + len(again.trajectory.search.deviations)
    assert covariances.count(whole) == 1
    assert again.trajectory.fit.status == "converged" and not again.trajectory.known
    off = np.abs((again.fit.values - usual.values) / usual.std)
    assert off[: again.base.rank].max() < 0.5 and off.max() < 1.5


@pytest.mark.parametrize(("delay", "factor"), [(0.0, 1.0), (0.03, moves.ROUGHER)])
def test_smoothness_begins_lower_once_set_up_errors_are_known(delay, factor, monkeypatch):
    """Begun where it was with a person's displaced joints in the residuals, that of the pelvis stayed too high."""
    ends, begins, fit, converged = [], [], iteration.fit, moves.converged

    def fitted(measurement, begin, **how):
        begins.append(begin.noises)
        return fit(measurement, begin, **how)

    def last(stages, estimate):
        ends.append((estimate.fit.noises, len(begins)))
        return converged(stages, estimate)

    monkeypatch.setattr(iteration, "fit", fitted)
    monkeypatch.setattr(moves, "converged", last)
    ident.identify(PENDULUM, faulty(delay=delay))
    ((before, at),) = ends
    np.testing.assert_allclose(before[0].jerk / begins[at][0].jerk, factor)
