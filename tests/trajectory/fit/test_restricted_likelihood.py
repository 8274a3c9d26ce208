"""Updates of the noise against the maximum of the dense restricted likelihood."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import minimize

from ident.trajectory.algebra import whitening
from ident.trajectory.algebra.spline import LOCAL, Spline
from ident.trajectory.fit import iteration
from ident.trajectory.fit.fitted import Prior
from ident.trajectory.fit.iteration import LEAST_MOTION, fit, renewed
from ident.trajectory.fit.piece import Noise, Piece, Point
from ident.trajectory.fit.piece_equations import linearised, misfit
from ident.trajectory.start import COORDINATES, smoothed

STEP = 0.02
SIGMA, SIGMA_CHANNEL, JERK = 0.05, 2.0, 1e-4


class OneChannel:
    """A measurement of one channel of one coordinate x, whose derivatives by ẍ and by θ are given."""

    zeros = shifts = torque_shifts = pose_shifts = tracked = {}  # noqa: RUF012
    turning = np.zeros((1, 1), bool)
    equations = SimpleNamespace(channels=("x",))

    def derivatives(self, states, wrenches, theta, columns):
        by_states = np.zeros((1, 3, 1, len(wrenches)))
        by_states[:, 2], by_theta = self.slopes(states, wrenches, theta)
        return self.values(states, wrenches, theta), by_states, by_theta[None, columns]

    def dependence(self, theta, columns):
        return np.ones((1, 1), bool), np.ones((1, len(columns)), bool)


class Linear(OneChannel):
    """`ẍ + w·θ`, where w is measured at a contact."""

    names, smooth = ("a", "b"), False

    def values(self, states, wrenches, theta):
        return (states[2, :, 0] + wrenches[:, 0, :2] @ theta)[None]

    def slopes(self, states, wrenches, theta):
        return 1, wrenches[:, 0, :2].T


class Turned(OneChannel):
    """`θ ẍ`: a larger inertia compensates a smaller motion."""

    names, smooth = ("inertia",), True

    def values(self, states, wrenches, theta):
        return (theta[0] * states[2, :, 0])[None]

    def slopes(self, states, wrenches, theta):
        return theta[0], states[2, :, 0][None]


def correlated(rng, number, rho):
    """AR(1) noise of variance one, stationary from the first sample (N,)."""
    x = rng.normal(size=number)
    for k in range(1, number):
        x[k] = rho * x[k - 1] + np.sqrt(1 - rho**2) * x[k]
    return x


def recording(rng, rho, gap, number=240):
    """A coordinate with correlated noise, a channel with white noise."""
    time = STEP * np.arange(number)
    time[number // 3 :] += gap
    wrenches = rng.normal(size=(number, 2, 6))
    measured = np.sin(2 * time) + SIGMA * correlated(rng, number, rho)
    channel = -4 * np.sin(2 * time) + wrenches[:, 0, :2] @ [1.0, -0.5] + SIGMA_CHANNEL * rng.normal(size=number)
    return Piece(Spline.over(-0.1, time[-1] + 0.1, 0.1), time, measured[:, None], time, channel[:, None], wrenches)


def noise_of(sigma, rho):
    states, zero = np.array([sigma]), np.zeros(1)
    return Noise(states, np.array([SIGMA_CHANNEL]), np.array([JERK]), zero + rho, zero, zero, zero)


def with_root(measurement, at):
    """Normal equations with the root of the inverse of their precision, and that root."""
    root = np.linalg.cholesky(np.linalg.inv(linearised(measurement, at).eliminated.precision))
    return linearised(measurement, at, root=root), root


def updated(piece, rounds=20):
    """σ and ρ of the coordinate at which updates converge, all else given, and the residuals' own correlation."""
    noise, c, theta, linear = noise_of(SIGMA, 0.0), np.zeros((piece.spline.size, 1)), np.zeros(2), Linear()
    for _ in range(rounds):
        part, root = with_root(linear, Point(piece, c, theta, noise))
        step = root @ root.T @ part.eliminated.gradient
        c, theta = c + (part.eliminated.step - part.eliminated.by_theta @ step)[:, None], theta + step
        left = misfit(linear, Point(piece, c, theta, noise))
        new = renewed(noise, [part], [left], coloured=True)
        noise = replace(noise, states=new.states, states_rho=new.states_rho)
    residual = piece.states[:, 0] - piece.spline.evaluate(c, piece.time)[0, :, 0]
    return noise.states[0], noise.states_rho[0], residual[1:] @ residual[:-1] / (residual @ residual)


def twice_lost(piece, sigma, rho):
    """-2 log of the restricted likelihood, up to a constant:  log |R| + log |Jᵀ R⁻¹ J + S| + yᵀ R⁻¹ (y - J x̂)."""
    number, spline = len(piece.time), piece.spline
    interval, basis = spline.local(piece.time)
    J, S = np.zeros((2 * number, spline.size + 2)), np.zeros((spline.size + 2,) * 2)
    for k in range(number):
        J[k, interval[k] : interval[k] + LOCAL] = basis[0, k]
        J[number + k, interval[k] : interval[k] + LOCAL] = basis[2, k]
    J[number:, -2:] = piece.wrenches[:, 0, :2]
    S[:-2, :-2] = JERK * (spline.roots.T @ spline.roots).toarray()
    y = np.concatenate([piece.states[:, 0], piece.measured[:, 0]])
    runs = np.split(np.arange(number), np.flatnonzero(np.diff(interval) > 1) + 1)
    # The channel's noise is white and given.
    R = block_diag(*(sigma**2 * rho ** np.abs(np.subtract.outer(run, run)) for run in runs))
    both = np.column_stack([J, y])
    weighted = np.vstack([np.linalg.solve(R, both[:number]), both[number:] / SIGMA_CHANNEL**2])
    H = J.T @ weighted[:, :-1] + S
    x = np.linalg.solve(H, weighted[:, :-1].T @ y)
    return np.linalg.slogdet(R)[1] + np.linalg.slogdet(H)[1] + y @ (weighted @ [*-x, 1])


@pytest.mark.parametrize(("rho", "gap"), [(0.3, 0.5), (0.6, 0.0), (0.85, 0.0), (0.85, 0.5)])
def test_updates_end_at_the_maximum_of_the_restricted_likelihood(rho, gap, monkeypatch):
    """Except for the ends of the recording, where likelihood and updates weight half a sample differently."""
    monkeypatch.setattr(whitening, "HUBER", 100.0)
    piece = recording(np.random.default_rng(round(100 * rho)), rho, gap)
    best = minimize(lambda x: twice_lost(piece, *x), [SIGMA, rho], method="Nelder-Mead", options={"fatol": 1e-4})
    *end, plain = updated(piece)
    assert twice_lost(piece, *end) - best.fun < 0.03
    np.testing.assert_allclose(end, best.x, rtol=0.02)
    # The trajectory has absorbed slow noise: the residuals themselves are less correlated.
    assert end[1] - plain > 0.05


@pytest.mark.parametrize("seed", range(2))
def test_motion_below_slow_noise_is_not_taken_as_none(seed):
    """Four, instead of .04 to .6 degrees of freedom."""
    time, none = STEP * np.arange(200), np.zeros(0)
    noisy = 0.2 * np.sin(3 * time) + 0.5 * correlated(np.random.default_rng(seed), 200, 0.9)
    spline, wrenches = Spline.over(-0.1, time[-1] + 0.1, 0.15), np.zeros((0, 2, 0))
    piece = Piece(spline, time, noisy[:, None], none, np.zeros((0, 0)), wrenches)
    given = replace(noise_of(0.5, 0.9), channels=none, channels_rho=none, floor_channels=none)
    end = smoothed([piece], [given])
    here = Point(piece, end.coefficients[0], none, end.noises[0])
    assert misfit(COORDINATES, here).rank - with_root(COORDINATES, here)[0].held > 0.9 * LEAST_MOTION


def turned(rng, rho, sigma, inertia=2.0, number=300):
    """Error of θ in standard deviations with given noise and estimated smoothness, for a motion of some tenths."""
    time = STEP * np.arange(number)
    w, phase, size = rng.uniform(1.5, 6, 4), rng.uniform(0, 2 * np.pi, 4), 0.1 * rng.normal(size=4)
    waves = np.sin(np.outer(time, w) + phase)
    measured = (waves @ size + sigma * correlated(rng, number, rho))[:, None]
    channel = (-inertia * waves @ (size * w**2) + 0.1 * rng.normal(size=number))[:, None]
    piece = Piece(Spline.over(-0.1, time[-1] + 0.1, 0.1), time, measured, time, channel, np.zeros((number, 2, 0)))
    noise = replace(noise_of(sigma, rho), channels=np.array([0.1]))
    alone, prior = smoothed([piece], [noise]), Prior(np.zeros(1), np.zeros((1, 1)))
    given = {
        "names": ["inertia"],
        "of_recording": [np.array([0])],
        "prior": prior,
        "noises": [noise],
        "pieces": [piece],
    }
    fitted = fit(Turned(), replace(alone, **given, theta=np.array([inertia]), free=np.array([True])))
    return (fitted.theta[0] - inertia) / np.sqrt(fitted.covariance[0, 0])


@pytest.mark.slow
@pytest.mark.parametrize(("rho", "sigma"), [(0.0, 0.1), (0.9, 0.02)])
def test_smoothness_takes_nothing_of_the_motion_that_matters(rho, sigma, monkeypatch):
    """With the penalty in its own cost, θ is two to four standard deviations too large, with a coverage of one half."""
    monkeypatch.setattr(
        iteration, "renewed", lambda noise, *at, **how: replace(noise, jerk=renewed(noise, *at, **how).jerk)
    )
    z = np.array([turned(np.random.default_rng(seed), rho, sigma) for seed in range(24)])
    assert abs(z.mean()) < 0.5
    assert np.mean(np.abs(z) < 1.96) >= 0.9
