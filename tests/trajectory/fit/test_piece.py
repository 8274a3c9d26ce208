"""A piece's normal equations, statistics and response against dense ones, by differences of its residuals."""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
import pytest
from closeness import close
from measurements import at, random_measurement, random_point

from ident.estimation.measurement import Measurement
from ident.trajectory.algebra import arrow
from ident.trajectory.algebra.spline import LOCAL, ORDER, Sampling, Spline
from ident.trajectory.algebra.whitening import HUBER, innovations
from ident.trajectory.fit.piece import Point
from ident.trajectory.fit.piece_equations import linearised, misfit
from ident.trajectory.fit.response import Response, Stream, response


@dataclass(eq=False)
class Problem:
    """A piece at a trajectory and at θ."""

    measurement: Measurement
    at: Point

    @cached_property
    def linearised(self):
        return linearised(self.measurement, self.at)

    @cached_property
    def eliminated(self):
        return self.linearised.eliminated

    @cached_property
    def misfit(self):
        return misfit(self.measurement, self.at)

    @cached_property
    def c(self):
        return self.at.coefficients.ravel()

    def cost(self, c, theta):
        c = c.reshape(self.at.coefficients.shape)
        return misfit(self.measurement, self.at._replace(coefficients=c, theta=theta)).cost

    def residuals(self, c, theta):
        """Measured less predicted of each kind of stream: values (N, s), times, std and ρ of each."""
        m, piece, noise = self.measurement, self.at.piece, self.at.noise
        c = c.reshape(self.at.coefficients.shape)
        x = piece.spline.evaluate(c, piece.time)[0]
        for j, k in m.zeros.items():
            x[:, j] += theta[k]
        yield piece.states - x, piece.time, noise.states, noise.states_rho
        late, rate = theta[at(m, "delay(ground)")], theta[at(m, "clock(ground)")]
        of_wrench = piece.when + rate * (piece.when - piece.origin) - late
        of_torques = piece.when - (theta[at(m, "torque_delay")] if m.torque_shifts else 0)
        for own, when in ((slice(0, piece.late), of_wrench), (slice(piece.late, None), of_torques)):
            predicted = m.values(piece.spline.evaluate(c, when)[:3], piece.wrenches, theta).T
            yield (piece.measured - predicted)[:, own], when, noise.channels[own], noise.channels_rho[own]

    def apart(self, when):
        return np.diff(self.at.piece.spline.local(when).interval) > 1

    def innovations(self, c, theta):
        """Innovations in standard deviations, and their slow and fast halves (3, s, N), zero where missing."""
        out = []
        for values, when, std, rho in self.residuals(c, theta):
            z = np.zeros((3, values.shape[1], 50))
            before = np.concatenate([np.full_like(values[:1], np.nan), values[:-1]])
            before[1:][self.apart(when)] = np.nan
            scale = std * np.sqrt(1 - rho**2)
            new = np.where(np.isfinite(before), (values - rho * before) / scale, values / std)
            slow, fast = (1 - rho) * (values + before) / (2 * scale), (1 + rho) * (values - before) / (2 * scale)
            z[:, :, : len(when)] = np.nan_to_num(np.stack([new, slow, fast])).swapaxes(1, 2)
            out.append(z)
        return np.concatenate(out, axis=1)

    @cached_property
    def dense(self):
        """Innovations (s N,), and minus their derivatives by c (s N, size) and θ (s N, p)."""
        x, size, h = np.concatenate([self.c, self.at.theta]), len(self.c), 1e-5

        def innovations(x):
            return self.innovations(x[:size], x[size:])[0].ravel()

        rows = [(innovations(x - e) - innovations(x + e)) / (2 * h) for e in h * np.eye(len(x))]
        return innovations(x), np.transpose(rows[:size]), np.transpose(rows[size:])

    @cached_property
    def penalty(self):
        """Matrix of Σ λ ∫ x⃛² dt, and without λ."""
        spline, n = self.at.piece.spline, self.at.coefficients.shape[1]
        P = (spline.roots.T @ spline.roots).toarray()
        return np.kron(P, np.diag(self.at.noise.jerk)), np.kron(P, np.eye(n))


@cache
def problem(seed, outliers=0.0):
    """Samples with gaps, missing values and correlated noise; residuals are so small that none loses weight."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 3, ("revolute",), torques=seed % 2 == 0, contacts=seed % 3)
    point = random_point(rng, m)
    point.noise.channels_rho[0] = 0
    measured = []
    for values, _, std, _ in Problem(m, point).residuals(point.coefficients.ravel(), point.theta):
        size = np.where(rng.uniform(size=values.shape) < outliers, 20, 0.3)
        own = size * std * rng.uniform(-1, 1, size=values.shape) - values
        own[rng.uniform(size=own.shape) < 0.1] = np.nan
        measured.append(own)
    piece = replace(point.piece, states=measured[0], measured=np.hstack(measured[1:]))
    return Problem(m, point._replace(piece=piece))


both = pytest.mark.parametrize("seed", range(2))


@both
def test_normal_equations_are_the_dense_ones_along_the_trajectories_of_least_misfit_and_penalty(seed):
    own, (z, by_c, by_theta) = problem(seed), problem(seed).dense
    assert abs(z).max() < HUBER
    A, B, D = by_c.T @ by_c + own.penalty[0], by_c.T @ by_theta, by_theta.T @ by_theta
    right, found = by_c.T @ z - own.penalty[0] @ own.c, own.eliminated
    W, step = np.linalg.solve(A, B), np.linalg.solve(A, right)
    close(found.step, step, 1e-5)
    close(found.by_theta, W, 1e-5)
    # Misfit alone as θ moves, with the trajectory that minimises misfit and penalty: residuals and their derivatives.
    G = by_theta - by_c @ W
    close(found.precision, G.T @ G, 1e-5)
    close(found.gradient, G.T @ (z - by_c @ step), 1e-5)
    close(found.precision + found.bend, D - B.T @ W, 1e-5)
    close(found.gradient + found.pull, by_theta.T @ z - W.T @ right, 1e-5)


@both
def test_sums_are_those_of_innovations_and_halves(seed):
    own = problem(seed)
    n, counts, numbers = own.at.coefficients.shape[1], [], []
    close(own.misfit.squares, (own.innovations(own.c, own.at.theta) ** 2).sum(axis=2), 1e-5)
    for values, when, _, rho in own.residuals(own.c, own.at.theta):
        linked = np.isfinite(values[1:] + values[:-1]) & ~own.apart(when)[:, None]
        numbers.append(linked.sum(axis=0) * np.stack([1 - rho, 1 + rho]) / 2)
        counts.append(np.isfinite(values).sum(axis=0))
    close(own.misfit.number[1:], np.concatenate(numbers, axis=1), 1e-5)
    np.testing.assert_array_equal(own.misfit.number[0], np.concatenate(counts))
    assert own.apart(own.at.piece.time).any()
    for j in range(n):
        close(own.misfit.bends[j], own.c @ (own.penalty[1] * (np.arange(len(own.c)) % n == j)) @ own.c, 1e-5)
    assert (own.misfit.rank == own.at.piece.spline.size - ORDER).all()


@both
def test_gradient_is_that_of_the_cost(seed):
    """Along the trajectories that follow θ, and along the step at fixed θ, with outliers."""
    own, some = problem(seed, 0.1), np.random.default_rng(seed)
    L, c, theta = own.eliminated, own.c, own.at.theta
    clocks = {at(own.measurement, "delay(ground)"), at(own.measurement, "clock(ground)")}
    for k in {*clocks, *some.choice(len(theta), 8, replace=False)}:
        e = 1e-4 / np.sqrt(max(L.precision[k, k], 1e-12)) * np.eye(len(theta))[k]
        up, down = (own.cost(c - s * L.by_theta @ e, theta + s * e) for s in (1, -1))
        assert (up - down) / 2 == pytest.approx(-2 * (L.gradient + L.pull) @ e, rel=1e-3, abs=1e-7 * abs(up))
    up, down, here, there = (own.cost(c + s * L.step, theta) for s in (1e-4, -1e-4, 0, 0.2))
    assert up < down and there < here


def test_cost_is_the_sum_of_squares_and_beyond_outliers_grows_linearly():
    for outliers in (0.0, 0.2):
        own = problem(0, outliers)
        z = own.innovations(own.c, own.at.theta)[0]
        beyond = np.maximum(abs(z) - HUBER, 0)
        expected = (z**2 - beyond**2).sum() + own.c @ own.penalty[0] @ own.c
        assert (beyond > 0).any() == (outliers > 0)
        assert own.cost(own.c, own.at.theta) == pytest.approx(expected, rel=1e-10)


@both
def test_rows_and_motion_of_a_response_give_the_right_side_of_theta(seed):
    """The right side with the trajectory eliminated, from the residuals and the motion that the penalty smooths."""
    own = problem(seed)
    here, penalty = response(own.measurement, own.at), own.penalty[0]
    right = here.smoothed.T @ penalty @ own.c
    for k, stream in enumerate(here.streams):
        right += np.einsum("ns,nsp->p", stream.new.residual, stream.weighted(here.rows(k)))
    close(right, own.eliminated.gradient, 1e-7)
    close(here.scatter_of_motion, here.smoothed.T @ penalty @ here.smoothed, 1e-7)


@pytest.mark.parametrize("inertia", [0.01, lambda time: 0.05 * (time % 5 < 2.5)])
def test_a_trajectory_follows_what_elimination_says(inertia):
    """An inertia that turns, perhaps only seen at times: shares of sinusoids of the angle and of the torque."""
    samples, spline, every = 1000, Spline(0.0, 0.1, 100), np.arange(1000) / 100 + 0.005
    std, jerk, local = np.array([0.01, 0.1]), 1e-7, Sampling(spline, every)
    inertia = np.broadcast_to(inertia(every[:, None]) if callable(inertia) else inertia, (samples, 1))
    functions = np.zeros((3, samples, spline.size))
    functions[:, range(samples), local.local.interval + np.arange(LOCAL)[:, None]] = local.local.basis[:3].swapaxes(
        1, 2
    )
    rows = functions[0], inertia * functions[2]
    turned = inertia[..., None] * [0.0, 0.0, 1.0], np.zeros((samples, 1, 0))
    none, single = np.zeros((samples, 1)), [std[k : k + 1] for k in range(len(std))]
    streams = [
        Stream(
            every, local, None, innovations(none, local.local.interval, own, np.zeros(1)), own, None, *(k * (turned,))
        )
        for k, own in enumerate(single)
    ]
    A = jerk * (spline.roots.T @ spline.roots).toarray() + sum(x.T @ x / s**2 for x, s in zip(rows, std, strict=True))
    frequency = np.array([1.0, 1.5, 2.0, 3.0])
    shares = Response(streams, {}, None, spline, np.array([jerk])).followed(frequency)
    for x, size, share in zip(rows, std, shares, strict=True):
        pulled = x.T @ np.exp(2j * np.pi * every[:, None] * frequency) / size
        exact = (pulled.conj() * np.linalg.solve(A, pulled)).sum(axis=0).real / samples
        assert share.mean(axis=0)[:, 0] == pytest.approx(exact, abs=0.03)


@dataclass(frozen=True, eq=False)
class Dense:
    """A measurement whose channels are taken to depend on everything."""

    measurement: Measurement

    def __getattr__(self, name):
        return getattr(self.measurement, name)

    def dependence(self, theta, columns):
        of_states, of_theta = self.measurement.dependence(theta, columns)
        return np.ones_like(of_states), np.ones_like(of_theta)


KINDS = (
    {"wrench": False, "contacts": 0, "setup": False},
    {"wrench": False, "contacts": 0},
    {"wrench": False},
    {},
    {"contacts": 0, "torques": False},
    {"contacts": 0, "moving": True},
)


@pytest.mark.parametrize("kinds", KINDS)
def test_channels_grouped_by_what_they_depend_on_give_what_all_at_once_give(kinds, monkeypatch):
    """Also in groups and components as small as they can be, whatever their calls cost."""
    rng = np.random.default_rng(0)
    m = random_measurement(rng, 8, ("revolute", "prismatic"), **kinds)
    piece, c, theta, noise = random_point(rng, m)
    x = np.array(piece.spline.evaluate(c, piece.when)[:3])
    of_states, of_theta = m.dependence(theta, np.arange(len(theta)))
    values = m.values(x, piece.wrenches, theta)
    for j, e in enumerate(0.1 * np.eye(m.coordinates)):
        assert (of_states[:, j] >= (m.values(x + e, piece.wrenches, theta) != values).any(axis=1)).all()
    for k, e in enumerate(0.1 * np.eye(len(theta))):
        assert (of_theta[:, k] >= (m.values(x, piece.wrenches, theta + e) != values).any(axis=1)).all()

    states, measured = rng.normal(size=piece.states.shape), 10 * rng.normal(size=piece.measured.shape)
    for samples in (states, measured):
        samples[rng.uniform(size=samples.shape) < 0.1] = np.nan
    point = Point(replace(piece, states=states, measured=measured), c, theta, noise)
    columns = np.flatnonzero(rng.uniform(size=len(theta)) < 0.9)
    root = np.triu(rng.normal(size=2 * columns.shape))

    def arrays(m):
        part = linearised(m, point, columns=columns, root=root)
        every = part._asdict() | part.eliminated._asdict()
        return {name: value for name, value in every.items() if name not in ("eliminated", "factors")}

    def forget():
        arrow._groups.cache_clear()
        arrow._components.cache_clear()

    expected, usual = arrays(Dense(m)), arrays(m)
    with monkeypatch.context() as patched:
        for name in ("CALLED", "CALLED_OF_COMPONENT", "MOVED"):
            patched.setattr(arrow, name, 0.0)
        forget()
        split = arrays(m)
    forget()
    for name, other in expected.items():
        for own in (usual, split):
            np.testing.assert_allclose(own[name], other, rtol=0, atol=1e-9 * np.abs(other).max(), err_msg=name)
