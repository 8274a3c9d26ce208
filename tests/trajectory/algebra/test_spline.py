"""Splines, Gauss nodes of their intervals, and banded matrices against dense ones."""

from dataclasses import replace

import numpy as np
import pytest
from measurements import random_measurement
from scipy.interpolate import BSpline

from ident.trajectory.algebra.banded import WINDOW, Banded
from ident.trajectory.algebra.rows import NODES, WORTH_IT, lagrange
from ident.trajectory.algebra.spline import DEGREE, LOCAL, ORDER, Spline
from ident.trajectory.fit import piece as piece_module
from ident.trajectory.fit.piece import Noise, Piece, Point
from ident.trajectory.fit.piece_equations import linearised, misfit
from ident.trajectory.fit.response import response


@pytest.mark.parametrize("seed", range(3))
def test_values_and_penalty_are_those_of_b_splines(seed):
    """Also beyond the ends, where scipy's splines continue as the outermost polynomials as well."""
    rng = np.random.default_rng(seed)
    spline = Spline.over(rng.normal(), 3 + rng.uniform(), rng.uniform(0.05, 0.7))
    c, step, last = rng.normal(size=(spline.size, 3)), spline.step, spline.start + spline.step * spline.intervals
    reference = BSpline(spline.start + step * np.arange(-DEGREE, spline.intervals + LOCAL), c, DEGREE)
    beyond = step * np.array([-0.7, 0, 1.3])
    time = np.concatenate([rng.uniform(spline.start, last, 50), spline.start + beyond, last + beyond])
    for derivative, own in enumerate(spline.evaluate(c, time)):
        expected = reference(time, derivative)
        np.testing.assert_allclose(own, expected, rtol=0, atol=1e-11 * abs(expected).max())
    middles = spline.start + step / 400 * (np.arange(400 * spline.intervals) + 0.5)
    jerk = (reference(middles, ORDER) ** 2).sum(axis=0) * step / 400
    np.testing.assert_allclose(spline.squared_jerk(c), jerk, rtol=1e-4)
    windows = c[np.arange(spline.intervals)[:, None] + np.arange(LOCAL)]
    np.testing.assert_allclose(np.einsum("skj,kl,slj->j", windows, spline.penalty, windows), jerk, rtol=1e-4)


def test_cubics_are_the_same_in_another_space():
    time, cubic = np.linspace(0.1, 1.4, 30), np.array([2.0, -1.0, 0.5, 3.0])
    own, other = Spline.over(0.0, 1.5, 0.25), Spline.over(0.1, 1.4, 0.07)
    middles = own.start + (np.arange(own.size) - 2) * own.step
    coefficients = np.polyval(cubic, middles) - own.step**2 / 4 * np.polyval(np.polyder(cubic, 2), middles)
    refined = other.evaluate(own.refined(coefficients[:, None], other), time)[:3, :, 0]
    for derivative, x in enumerate(refined):
        np.testing.assert_allclose(x, np.polyval(np.polyder(cubic, derivative), time), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("intervals", [1, 2, 40])
def test_rows_of_the_penalty_are_as_many_as_its_rank(intervals):
    """As many rows as functions, less the polynomials that are not penalised: products take a third of the time."""
    spline, rng, jerk = Spline(0.0, 0.1, intervals), np.random.default_rng(0), np.array([1.0, 1e8])
    dense = np.zeros((spline.size, spline.size))
    for k in range(intervals):
        dense[k : k + LOCAL, k : k + LOCAL] += spline.penalty
    roots = spline.roots.toarray()
    assert np.linalg.matrix_rank(roots) == len(roots) == spline.size - ORDER
    np.testing.assert_allclose(roots.T @ roots, dense, rtol=0, atol=1e-12 * dense.max())
    c, whole = rng.normal(size=(2 * spline.size, 3)), np.kron(dense, np.diag(jerk))
    bent = spline.bent(c, jerk)
    np.testing.assert_allclose(bent.T @ bent, c.T @ whole @ c, rtol=1e-10)
    np.testing.assert_allclose(spline.penalised(c, jerk), whole @ c, rtol=0, atol=1e-12 * abs(whole @ c).max())


def test_polynomials_through_the_nodes_reproduce_those_of_lower_degree_also_beyond_the_ends():
    places = np.polynomial.legendre.leggauss(NODES)[0] / 2 + 0.5
    u, coefficients = np.r_[places, np.linspace(-0.05, 1.05, 50)], np.random.default_rng(0).normal(size=NODES)
    np.testing.assert_allclose(lagrange(u) @ np.polyval(coefficients, places), np.polyval(coefficients, u), rtol=1e-9)


def smooth_problem(seed):
    """A piece of a smooth motion with 40 samples of a wrench in every interval, some missing, some outliers."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 3, ("revolute", "prismatic"), torques=False, contacts=0)
    n, C, spline, time = m.coordinates, len(m.equations.channels), Spline(0.0, 0.2, 8), np.linspace(0.01, 1.59, 320)
    middles = spline.step * (np.arange(spline.size) - 2)
    c = np.sin(middles[:, None] * rng.uniform(1, 3, n) + rng.uniform(0, 6, n))
    theta = rng.normal(size=len(m.names))
    theta[len(m.equations.names) :] *= 0.01
    floors = np.zeros(n), np.zeros(C)
    noise = Noise(np.full(n, 0.01), rng.uniform(1, 2, C), np.full(n, 1e-3), *floors, *floors)
    x = spline.evaluate(c, time)[0] + 0.01 * rng.normal(size=(320, n))
    piece = Piece(spline, time, x, time, np.zeros((320, C)), np.zeros((320, 2, 0)), 0.3)
    measured = m.values(spline.evaluate(c, time)[:3], piece.wrenches, theta).T
    measured += noise.channels * rng.normal(size=measured.shape)
    measured[rng.uniform(size=measured.shape) < 0.05] = np.nan
    measured[rng.uniform(size=measured.shape) < 0.01] += 20
    return m, Point(replace(piece, measured=measured), c, theta, noise)


@pytest.mark.parametrize("seed", range(2))
def test_equations_by_nodes_are_those_by_samples(seed, monkeypatch):
    m, at = smooth_problem(seed)
    assert len(at.piece.when) > WORTH_IT * NODES * at.piece.spline.intervals and m.smooth
    root = np.random.default_rng(seed).normal(size=(len(at.theta), 4)) * 0.1

    def results():
        part, own, here = linearised(m, at, root=root), misfit(m, at), response(m, at)
        out = part._asdict() | part.eliminated._asdict() | {"cost": own.cost, "squares": own.squares}
        out |= {f"rows {k}": here.rows(k) for k in range(len(here.streams))}
        out |= {f"followed {k}": x for k, x in enumerate(here.followed(np.array([0.5, 2.0])))}
        return {name: np.asarray(x) for name, x in out.items() if name not in ("eliminated", "factors")}

    by_nodes = results()
    monkeypatch.setattr(piece_module, "WORTH_IT", np.inf)
    for name, x in results().items():
        np.testing.assert_allclose(by_nodes[name], x, rtol=1e-8, atol=1e-8 * abs(x).max(), err_msg=name)


def test_contacts_dry_friction_and_slack_are_evaluated_at_samples():
    rng = np.random.default_rng(0)
    assert not random_measurement(rng, 2, torques=False, contacts=1).smooth
    rubs = random_measurement(rng, 2, torques=True, contacts=0)
    assert not rubs.smooth
    without = [name for name in rubs.equations.drives if name.startswith(("Ia", "Fv", "K"))]
    assert replace(rubs, equations=rubs.equations.with_drives(without)).smooth
    piece, still = smooth_problem(0)[1].piece, np.zeros((1, 2), bool)
    assert piece.nodes(piece.when, still) is not None and piece.nodes(piece.when + 0.01, still) is not None
    assert replace(piece, slack=np.ones_like(piece.measured)).nodes(piece.when, still) is None
    few = slice(None, None, 3)
    assert replace(piece, when=piece.when[few]).nodes(piece.when[few], still) is None


def assembled(number, n, width, parts, start, separate):
    """A banded matrix of windows of some coordinates and of each by itself, and the dense one, with ones elsewhere."""
    functions, first = number + WINDOW - 1, WINDOW - width
    matrix, dense = Banded(functions, n, width), np.zeros((functions * n,) * 2)
    for own, root in parts:
        windows = root.swapaxes(1, 2) @ root
        matrix.add(first, windows.reshape(number, width, len(own), width, len(own)), own)
        for k, window in enumerate(windows):
            at = ((first + k + np.arange(width)[:, None]) * n + own).ravel()
            dense[at[:, None], at] += window
    matrix.add_separate(start, separate[None])
    for k, j in np.ndindex(number, n):
        at = (start + k + np.arange(len(separate))) * n + j
        dense[at[:, None], at] += separate[..., j]
    dense[np.diag(dense) == 0] = np.eye(len(dense))[np.diag(dense) == 0]
    return matrix.factored(), dense


def assert_inverse(factor, dense, number, n, width, rtol):
    """Compares the windows of the inverse with the dense one's."""
    inverse = np.linalg.inv(dense)
    for k, window in enumerate(factor.inverse_windows(number)):
        own = slice((k + WINDOW - width) * n, (k + WINDOW) * n)
        expected = inverse[own, own]
        np.testing.assert_allclose(window[-width * n :, -width * n :], expected, atol=rtol * abs(expected).max())


@pytest.mark.parametrize("width", [WINDOW - 1, WINDOW])
@pytest.mark.parametrize("seed", range(4))
def test_solutions_and_inverse_are_those_of_the_dense_matrix(seed, width):
    rng = np.random.default_rng(seed)
    number, n = int(rng.integers(1, 40)), int(rng.choice([1, 2, 3, 15, 30, 40]))
    coordinates = np.arange(n), np.sort(rng.choice(n, rng.integers(1, n + 1), replace=False))
    parts = [(own, rng.normal(size=(number, width * len(own), width * len(own)))) for own in coordinates]
    alone = np.eye(width)[..., None] + rng.random(n)
    factor, dense = assembled(number, n, width, parts, WINDOW - width, alone)
    right = rng.normal(size=(len(dense), 3))
    expected, half = np.linalg.solve(dense, right), factor.solve_lower(right)
    np.testing.assert_allclose(factor.solve(right), expected, atol=1e-9 * abs(expected).max())
    np.testing.assert_allclose(half.T @ half, right.T @ expected, atol=1e-9 * abs(right.T @ expected).max())
    assert_inverse(factor, dense, number, n, width, 1e-9)


@pytest.mark.parametrize("width", [WINDOW - 1, WINDOW])
def test_the_inverse_is_right_beside_coordinates_at_rest(width):
    """A recursion over single functions loses all digits there."""
    rng, n, number, spline = np.random.default_rng(0), 12, 60, Spline(0.0, 0.02, 60)
    rest = spline.penalty[..., None] * spline.step**5 * np.where(np.arange(n) < 5, 1e9, 1e2)
    few = np.concatenate([rng.normal(size=(number, 6, width * n)), np.tile(100 * np.eye(width * n), (number, 1, 1))], 1)
    factor, dense = assembled(number, n, width, [(np.arange(n), few)], 1, rest)
    assert_inverse(factor, dense, number, n, width, 1e-6)
