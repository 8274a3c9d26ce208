"""Splines, Gauss nodes of their intervals, and banded matrices against dense ones."""

from dataclasses import replace

import numpy as np
import pytest
from measurements import random_measurement
from scipy.interpolate import BSpline

from ident.trajectory.algebra.banded import WINDOW, Banded
from ident.trajectory.algebra.nodes import NODES, WORTH_IT, lagrange
from ident.trajectory.algebra.spline import DEGREE, LOCAL, ORDER, Spline
from ident.trajectory.fit import piece as piece_module
from ident.trajectory.fit.piece import Noise, Piece, Point
from ident.trajectory.fit.piece_equations import linearised, misfit
from ident.trajectory.fit.response import response


def random_spline(rng):
    spline = Spline.over(rng.normal(), 3 + rng.uniform(), rng.uniform(0.05, 0.7))
    return spline, rng.normal(size=(spline.size, 3))


def reference(spline, coefficients):
    knots = spline.start + spline.step * np.arange(-DEGREE, spline.intervals + LOCAL)
    return BSpline(knots, coefficients, DEGREE)


@pytest.mark.parametrize("seed", range(10))
def test_values_and_derivatives_are_those_of_b_splines_at_any_time(seed):
    """Also beyond the ends, where scipy's splines continue as the outermost polynomials as well."""
    rng = np.random.default_rng(seed)
    spline, c = random_spline(rng)
    last = spline.start + spline.step * spline.intervals
    beyond = spline.step * np.array([-0.7, 0, 1.3])
    time = np.concatenate([rng.uniform(spline.start, last, 50), spline.start + beyond, last + beyond])
    own, scipys = spline.evaluate(c, time), reference(spline, c)
    for derivative in range(4):
        expected = scipys(time, derivative)
        np.testing.assert_allclose(own[derivative], expected, rtol=0, atol=1e-11 * abs(expected).max())


@pytest.mark.parametrize("seed", range(5))
def test_penalty_is_the_integral_of_the_squared_jerk(seed):
    rng = np.random.default_rng(seed)
    spline, c = random_spline(rng)
    fine = Spline.over(spline.start, spline.start + spline.step * spline.intervals, spline.step / 400)
    middle = fine.start + fine.step * (np.arange(fine.intervals) + 0.5)
    expected = (reference(spline, c)(middle, ORDER) ** 2).sum(axis=0) * fine.step
    np.testing.assert_allclose(spline.squared_jerk(c), expected, rtol=1e-4)
    windows = c[np.arange(spline.intervals)[:, None] + np.arange(LOCAL)]
    np.testing.assert_allclose(np.einsum("skj,kl,slj->j", windows, spline.penalty, windows), expected, rtol=1e-4)


@pytest.mark.parametrize("intervals", [1, 2, 3, 40])
def test_rows_of_the_penalty_are_as_many_as_its_rank(intervals):
    """As many rows as functions, less the polynomials that are not penalised: products take a third of the time."""
    spline = Spline(0.0, 0.1, intervals)
    rng, jerk = np.random.default_rng(0), np.array([1.0, 1e8])
    dense = np.zeros((spline.size, spline.size))
    for k in range(intervals):
        dense[k : k + LOCAL, k : k + LOCAL] += spline.penalty
    roots = spline.roots.toarray()
    assert np.linalg.matrix_rank(roots) == len(roots) == spline.size - ORDER
    np.testing.assert_allclose(roots.T @ roots, dense, rtol=0, atol=1e-12 * dense.max())
    c = rng.normal(size=(2 * spline.size, 3))
    bent, whole = spline.bent(c, jerk), np.kron(dense, np.diag(jerk))
    np.testing.assert_allclose(bent.T @ bent, c.T @ whole @ c, rtol=1e-10)
    np.testing.assert_allclose(spline.penalised(c, jerk), whole @ c, rtol=0, atol=1e-12 * abs(whole @ c).max())


PER_INTERVAL = 40


def test_polynomials_through_the_nodes():
    """They reproduce polynomials of a degree below the number of nodes, also at the nodes and beyond the ends."""
    places = np.polynomial.legendre.leggauss(NODES)[0] / 2 + 0.5
    u = np.concatenate([places, np.linspace(-0.05, 1.05, 50)])
    coefficients = np.random.default_rng(0).normal(size=NODES)
    np.testing.assert_allclose(lagrange(u) @ np.polyval(coefficients, places), np.polyval(coefficients, u), rtol=1e-9)


def smooth_problem(seed):
    """A piece of a smooth motion with many samples of a wrench in every interval, some missing, some outliers."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 3, ("revolute", "prismatic"), torques=False, contacts=0)
    n, C, p = m.coordinates, len(m.equations.channels), len(m.names)
    spline = Spline(0.0, 0.2, 8)
    time = np.linspace(0.01, 1.59, 8 * PER_INTERVAL)
    middles = spline.step * (np.arange(spline.size) - 2)
    c = np.sin(middles[:, None] * rng.uniform(1, 3, n) + rng.uniform(0, 6, n))
    theta = rng.normal(size=p)
    theta[len(m.equations.names) :] *= 0.01
    noise = Noise(
        states=np.full(n, 0.01),
        channels=rng.uniform(1, 2, size=C),
        jerk=np.full(n, 1e-3),
        states_rho=np.zeros(n),
        channels_rho=np.zeros(C),
        floor_states=np.zeros(n),
        floor_channels=np.zeros(C),
    )
    x = spline.evaluate(c, time)[0] + 0.01 * rng.normal(size=(len(time), n))
    piece = Piece(spline, time, x, time, np.zeros((len(time), C)), np.zeros((len(time), 2, 0)), 0.3)
    exact = m.values(spline.evaluate(c, time)[:3], piece.wrenches, theta).T
    measured = exact + noise.channels * rng.normal(size=exact.shape)
    measured[rng.uniform(size=exact.shape) < 0.05] = np.nan
    measured[rng.uniform(size=exact.shape) < 0.01] += 20
    return m, replace(piece, measured=measured), c, theta, noise


def both(monkeypatch, function):
    """Results by nodes and by samples."""
    by_nodes = function()
    monkeypatch.setattr(piece_module, "WORTH_IT", np.inf)
    return by_nodes, function()


@pytest.mark.parametrize("seed", range(3))
def test_equations_of_a_piece(seed, monkeypatch):
    m, piece, c, theta, noise = smooth_problem(seed)
    assert len(piece.when) > WORTH_IT * NODES * piece.spline.intervals and m.smooth
    root = np.random.default_rng(seed).normal(size=(len(theta), 4)) * 0.1
    one, other = both(monkeypatch, lambda: linearised(m, Point(piece, c, theta, noise), root=root))
    one, other = (part._asdict() | part.eliminated._asdict() for part in (one, other))
    for name in one.keys() - {"eliminated", "factors"}:
        a, b = np.asarray(one[name]), np.asarray(other[name])
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max(), err_msg=name)


@pytest.mark.parametrize("seed", range(2))
def test_misfit_and_response(seed, monkeypatch):
    m, piece, c, theta, noise = smooth_problem(seed)

    def results():
        own, here = (function(m, Point(piece, c, theta, noise)) for function in (misfit, response))
        return [own.cost, own.squares, *map(here.rows, range(len(here.streams))), *here.followed(np.array([0.5, 2.0]))]

    for a, b in zip(*both(monkeypatch, results), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8 * np.abs(b).max())


def test_contacts_dry_friction_and_slack_are_evaluated_at_samples():
    rng = np.random.default_rng(0)
    assert not random_measurement(rng, 2, torques=False, contacts=1).smooth
    rubs = random_measurement(rng, 2, torques=True, contacts=0)
    assert not rubs.smooth
    without = [name for name in rubs.equations.drives if name.startswith(("Ia", "Fv", "K"))]
    assert replace(rubs, equations=rubs.equations.with_drives(without)).smooth
    piece, still = smooth_problem(0)[1], np.zeros((1, 2), bool)
    assert piece.nodes(piece.when, still) is not None and piece.nodes(piece.when + 0.01, still) is not None
    assert replace(piece, slack=np.ones_like(piece.measured)).nodes(piece.when, still) is None
    few = slice(None, None, 3)
    assert replace(piece, when=piece.when[few]).nodes(piece.when[few], still) is None


def problem(seed, width=WINDOW):
    """A matrix of some windows, and the dense one, with ones on the diagonal where no window is."""
    rng = np.random.default_rng(seed)
    number, n = int(rng.integers(1, 40)), int(rng.choice([1, 2, 3, 15, 30, 40]))
    functions, first = number + WINDOW - 1, WINDOW - width
    matrix, dense = Banded(functions, n, width), np.zeros((functions * n,) * 2)
    coordinates = np.sort(rng.choice(n, rng.integers(1, n + 1), replace=False))
    for own in (np.arange(n), coordinates):
        roots = rng.normal(size=(number, width * len(own), width * len(own)))
        windows = (roots @ roots.swapaxes(1, 2)).reshape(number, width, len(own), width, len(own))
        matrix.add(first, windows, own)
        for k, window in enumerate(windows):
            at = ((first + k + np.arange(width)[:, None]) * n + own).ravel()
            dense[at[:, None], at] += window.reshape(len(at), -1)
    alone = np.eye(width) + rng.random((1, n, 1, 1))
    matrix.add_separate(first, alone.transpose(0, 2, 3, 1))
    for k in range(number):
        for j in range(n):
            at = (first + k + np.arange(width)) * n + j
            dense[at[:, None], at] += alone[0, j]
    dense[np.diag(dense) == 0] = np.eye(len(dense))[np.diag(dense) == 0]
    return matrix, dense, number, n, rng


@pytest.mark.parametrize("width", [WINDOW - 1, WINDOW])
@pytest.mark.parametrize("seed", range(6))
def test_solutions_and_inverse_are_those_of_the_dense_matrix(seed, width):
    matrix, dense, number, n, rng = problem(seed, width)
    factor = matrix.factored()
    right = rng.normal(size=(len(dense), 3))
    inverse = np.linalg.inv(dense)
    expected = inverse @ right
    np.testing.assert_allclose(factor.solve(right), expected, atol=1e-9 * abs(expected).max())
    half = factor.solve_lower(right)
    np.testing.assert_allclose(half.T @ half, right.T @ expected, atol=1e-9 * abs(right.T @ expected).max())
    for k, window in enumerate(factor.inverse_windows(number)):
        own = slice((k + WINDOW - width) * n, (k + WINDOW) * n)
        corner = window[-width * n :, -width * n :]
        np.testing.assert_allclose(corner, inverse[own, own], atol=1e-9 * abs(inverse).max())


@pytest.mark.parametrize("width", [WINDOW - 1, WINDOW])
def test_the_inverse_is_right_beside_coordinates_at_rest(width):
    """A recursion over single functions loses all digits there."""
    rng, n, number, spline = np.random.default_rng(0), 30, 60, Spline(0.0, 0.02, 60)
    first, rest = WINDOW - width, np.where(np.arange(n) < 12, 1e3, 1e-4) / 1e-6
    matrix, dense = Banded(number + LOCAL, n, width), np.zeros(((number + LOCAL) * n,) * 2)
    roots = rng.normal(size=(number, 6, width * n))
    windows = (roots.swapaxes(1, 2) @ roots + 1e4 * np.eye(width * n)).reshape(number, width, n, width, n)
    matrix.add(first, windows, np.arange(n))
    matrix.add_separate(1, (spline.penalty[..., None] * spline.step**5 * rest)[None])
    for k, window in enumerate(windows):
        own = slice((first + k) * n, (first + k + width) * n)
        dense[own, own] += window.reshape(width * n, -1)
        for j in range(n):
            at = (1 + k + np.arange(LOCAL)) * n + j
            dense[at[:, None], at] += spline.penalty * spline.step**5 * rest[j]
    dense[: first * n, : first * n] = np.eye(first * n)
    inverse = np.linalg.inv(dense)
    for k, window in enumerate(matrix.factored().inverse_windows(number)):
        own = slice((k + first) * n, (k + WINDOW) * n)
        expected = inverse[own, own]
        np.testing.assert_allclose(window[-width * n :, -width * n :], expected, atol=1e-6 * abs(expected).max())
