"""A piece's normal equations and statistics against dense ones, by numerical differences of its residuals."""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import pytest
from measurements import at, random_measurement, random_noise

from ident.estimation.measurement import Measurement
from ident.trajectory.algebra.spline import LOCAL, ORDER, Spline
from ident.trajectory.algebra.whitening import HUBER
from ident.trajectory.fit.piece import Noise, Piece, Point
from ident.trajectory.fit.piece_equations import linearised, misfit


@dataclass(eq=False)
class Problem:
    """A piece at a trajectory and at θ."""

    measurement: Measurement
    piece: Piece
    coefficients: np.ndarray
    theta: np.ndarray
    noise: Noise

    @cached_property
    def linearised(self):
        return self.linearised_with(None)

    def linearised_with(self, root):
        return linearised(self.measurement, Point(self.piece, self.coefficients, self.theta, self.noise), root=root)

    @cached_property
    def misfit(self):
        return misfit(self.measurement, Point(self.piece, self.coefficients, self.theta, self.noise))

    @cached_property
    def size(self):
        return self.coefficients.size

    def cost(self, c, theta):
        c = c.reshape(self.coefficients.shape)
        return misfit(self.measurement, Point(self.piece, c, theta, self.noise)).cost

    def residuals(self, c, theta):
        """Measured less predicted of each kind of stream: values (N, s), times, std and ρ of each."""
        m, piece, noise = self.measurement, self.piece, self.noise
        c = c.reshape(self.coefficients.shape)
        x = piece.spline.evaluate(c, piece.time)[0]
        for j, k in m.zeros.items():
            x[:, j] += theta[k]
        yield piece.states - x, piece.time, noise.states, noise.states_rho
        late, rate = theta[at(m, "delay(ground)")], theta[at(m, "clock(ground)")]
        of_wrench = piece.when + rate * (piece.when - piece.origin) - late
        for own, when in ((slice(0, piece.late), of_wrench), (slice(piece.late, None), piece.when)):
            x = piece.spline.evaluate(c, when)
            values = (piece.measured - m.values(x[:3], piece.wrenches, theta).T)[:, own]
            yield values, when, noise.channels[own], noise.channels_rho[own]

    def innovations(self, c, theta):
        """Innovations in standard deviations, and their slow and fast halves (3, s, N), zero where missing."""
        out = []
        for values, when, std, rho in self.residuals(c, theta):
            z = np.zeros((3, values.shape[1], max(len(self.piece.time), len(self.piece.when))))
            before = np.concatenate([np.full_like(values[:1], np.nan), values[:-1]])
            before[1:][np.diff(self.piece.spline.local(when).interval) > 1] = np.nan
            scale = std * np.sqrt(1 - rho**2)
            new = np.where(np.isfinite(before), (values - rho * before) / scale, values / std)
            slow, fast = (1 - rho) * (values + before) / (2 * scale), (1 + rho) * (values - before) / (2 * scale)
            z[:, :, : len(when)] = np.nan_to_num(np.stack([new, slow, fast])).swapaxes(1, 2)
            out.append(z)
        return np.concatenate(out, axis=1)

    @cached_property
    def dense(self):
        """Innovations and halves (3, s, N), and minus their derivatives by c and θ (3, s, N, size n + p)."""
        x, h = np.concatenate([self.coefficients.ravel(), self.theta]), 1e-5
        steps = h * np.eye(len(x))
        columns = [self.innovations(*self.split(x - e)) - self.innovations(*self.split(x + e)) for e in steps]
        return self.innovations(*self.split(x)), np.stack(columns, axis=-1) / (2 * h)

    @property
    def numbers(self):
        """Numbers of samples after another one, times the variances of slow and of fast halves (2, s)."""
        out = []
        for values, when, _, rho in self.residuals(self.coefficients, self.theta):
            apart = np.diff(self.piece.spline.local(when).interval) > 1
            linked = (np.isfinite(values[1:] + values[:-1]) & ~apart[:, None]).sum(axis=0)
            out.append(linked * np.stack([1 - rho, 1 + rho]) / 2)
        return np.concatenate(out, axis=1)

    def split(self, x):
        return x[: self.size], x[self.size :]

    @cached_property
    def penalty(self):
        """Matrix of Σ λ ∫ x⃛² dt."""
        spline, n = self.piece.spline, self.coefficients.shape[1]
        P = np.zeros((spline.size, spline.size))
        for k in range(spline.intervals):
            P[k : k + LOCAL, k : k + LOCAL] += spline.penalty
        return np.kron(P, np.diag(self.noise.jerk)), np.kron(P, np.eye(n))


@cache
def problem(seed, outliers=0.0):
    """Samples with gaps, missing values and correlated noise; residuals are so small that none loses weight."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 3, ("revolute",), torques=seed % 2 == 0, contacts=seed % 3)
    n, C, p = m.coordinates, len(m.equations.channels), len(m.names)
    time = np.cumsum(rng.uniform(0.02, 0.06, 45))
    time[30:] += 0.4
    when = time[0] + np.cumsum(rng.uniform(0.02, 0.05, 50))
    spline = Spline.over(time[0] - 0.2, time[-1] + 0.2, 0.2)
    c, theta = rng.normal(size=(spline.size, n)), rng.normal(size=p)
    theta[len(m.equations.names) :] *= 0.01
    noise = random_noise(rng, n, C)
    noise.channels_rho[0] = 0
    wrenches = rng.normal(size=(len(when), 2, 6 * len(m.contacts)))
    zeros = np.zeros((len(time), n))
    late = len(m.components)  # Joint torques are on the angles' clock.
    nothing = Piece(spline, time, zeros, when, np.zeros((len(when), C)), wrenches, 0.3, late)
    empty = Problem(m, nothing, c, theta, noise)
    measured = []
    for values, _, std, _ in empty.residuals(c, theta):
        size = np.where(rng.uniform(size=values.shape) < outliers, 20, 0.3)
        own = size * std * rng.uniform(-1, 1, size=values.shape) - values
        own[rng.uniform(size=own.shape) < 0.1] = np.nan
        measured.append(own)
    empty.piece = replace(empty.piece, states=measured[0], measured=np.hstack(measured[1:]))
    return empty


def close(own, expected, rtol=1e-5):
    np.testing.assert_allclose(own, expected, rtol=rtol, atol=rtol * np.abs(expected).max(initial=0))


SEEDS = range(2)


@pytest.mark.parametrize("seed", SEEDS)
def test_normal_equations_are_the_dense_ones_along_the_trajectories_of_least_misfit_and_penalty(seed):
    own = problem(seed)
    z, J = own.dense
    assert abs(z[0]).max() < HUBER
    weighted, _ = own.penalty
    rows, size = J[0].reshape(z[0].size, -1), own.size
    H, right = rows.T @ rows, rows.T @ z[0].ravel()
    H[:size, :size] += weighted
    right[:size] -= weighted @ own.coefficients.ravel()
    A, B, D = H[:size, :size], H[:size, size:], H[size:, size:]
    W = np.linalg.solve(A, B)
    step = np.linalg.solve(A, right[:size])
    close(own.linearised.eliminated.step, step)
    close(own.linearised.eliminated.by_theta, W)
    # Misfit alone as θ moves, with the trajectory that minimises misfit and penalty: residuals and their derivatives.
    G, left = rows[:, size:] - rows[:, :size] @ W, z[0].ravel() - rows[:, :size] @ step
    close(own.linearised.eliminated.precision, G.T @ G)
    close(own.linearised.eliminated.gradient, G.T @ left)
    close(own.linearised.eliminated.precision + own.linearised.eliminated.bend, D - B.T @ W)
    close(own.linearised.eliminated.gradient + own.linearised.eliminated.pull, right[size:] - W.T @ right[:size])


@pytest.mark.parametrize("seed", SEEDS)
def test_sums_are_those_of_innovations_and_halves(seed):
    own = problem(seed)
    z, _ = own.dense
    n, c = own.coefficients.shape[1], own.coefficients.ravel()
    _, plain = own.penalty
    close(own.misfit.squares, (z**2).sum(axis=2))
    close(own.misfit.number[1:], own.numbers)
    there = [np.isfinite(values).sum(axis=0) for values, *_ in own.residuals(own.coefficients, own.theta)]
    np.testing.assert_array_equal(own.misfit.number[0], np.concatenate(there))
    assert (np.diff(own.piece.spline.local(own.piece.time).interval) > 1).any()
    for j in range(n):
        close(own.misfit.bends[j], c @ (plain * (np.arange(own.size) % n == j)) @ c)
    assert (own.misfit.rank == own.piece.spline.size - ORDER).all()


@pytest.mark.parametrize("outliers", [0.0, 0.1])
@pytest.mark.parametrize("seed", SEEDS)
def test_gradient_is_that_of_the_cost(seed, outliers):
    """Also with outliers; along the trajectories that follow θ, and along the step at fixed θ."""
    own = problem(seed, outliers)
    L, c = own.linearised, own.coefficients.ravel()
    some = np.random.default_rng(seed).choice(len(own.theta), 12, replace=False)
    for k in {at(own.measurement, "delay(ground)"), at(own.measurement, "clock(ground)"), *some}:
        scale = 1e-4 / np.sqrt(L.eliminated.precision[k, k]) if L.eliminated.precision[k, k] > 1e-12 else 1e-4
        e = scale * np.eye(len(own.theta))[k]
        up, down = (own.cost(c - s * L.eliminated.by_theta @ e, own.theta + s * e) for s in (1, -1))
        right = L.eliminated.gradient + L.eliminated.pull
        assert (up - down) / 2 == pytest.approx(-2 * right @ e, rel=1e-3, abs=1e-7 * abs(up))
    up, down, here = (own.cost(c + s * L.eliminated.step, own.theta) for s in (1e-4, -1e-4, 0))
    assert (up - down) / 2e-4 < 0
    assert own.cost(c + 0.2 * L.eliminated.step, own.theta) < here


def test_cost_is_the_sum_of_squares_and_beyond_outliers_grows_linearly():
    for outliers in (0.0, 0.2):
        own = problem(0, outliers)
        z = own.innovations(own.coefficients, own.theta)[0]
        weighted, _ = own.penalty
        c = own.coefficients.ravel()
        beyond = np.maximum(abs(z) - HUBER, 0)
        expected = (z**2 - beyond**2).sum() + c @ weighted @ c
        assert (beyond > 0).any() == (outliers > 0)
        assert own.cost(c, own.theta) == pytest.approx(expected, rel=1e-10)
