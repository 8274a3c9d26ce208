import numpy as np
import pytest
from scipy.interpolate import BSpline

from ident.trajectory.algebra.spline import DEGREE, LOCAL, ORDER, Spline


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
