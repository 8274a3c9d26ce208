import numpy as np
import pytest

from ident.trajectory.algebra.block_tridiagonal import WINDOW, BlockTridiagonal
from ident.trajectory.algebra.spline import LOCAL


def problem(seed):
    """Windows (S, 7 n, 7 n), and the dense matrix of their sum, with ones on the diagonal where no window is."""
    rng = np.random.default_rng(seed)
    number, n = int(rng.integers(1, 40)), int(rng.choice([1, 2, 3, 15]))
    roots = rng.normal(size=(number, WINDOW * n, WINDOW * n))
    windows = roots @ roots.swapaxes(1, 2)
    blocks = -(-(number + LOCAL) // LOCAL)
    dense = np.zeros((blocks * LOCAL * n,) * 2)
    for k, window in enumerate(windows):
        dense[k * n : (k + WINDOW) * n, k * n : (k + WINDOW) * n] += window
    beyond = np.arange((number + LOCAL) * n, len(dense))
    dense[beyond, beyond] = 1
    return windows, dense, n, rng


@pytest.mark.parametrize("seed", range(20))
def test_solutions_inverse_and_determinant_are_those_of_the_dense_matrix(seed):
    windows, dense, n, rng = problem(seed)
    factor = BlockTridiagonal.of_windows(windows).factored()
    right = rng.normal(size=(*factor.diagonal.shape[:2], 3))
    inverse = np.linalg.inv(dense)
    expected = inverse @ right.reshape(-1, 3)
    np.testing.assert_allclose(factor.solve(right).reshape(-1, 3), expected, atol=1e-9 * abs(expected).max())
    inverses = factor.inverse_windows(len(windows))
    for k, window in enumerate(inverses):
        own = slice(k * n, (k + WINDOW) * n)
        np.testing.assert_allclose(window, inverse[own, own], atol=1e-9 * abs(inverse).max())


@pytest.mark.parametrize("seed", range(5))
def test_the_factor_is_lower_triangular_and_makes_the_matrix(seed):
    windows, dense, n, _ = problem(seed)
    matrix = BlockTridiagonal.of_windows(windows)
    factor = matrix.factored()
    size = LOCAL * n
    L = np.zeros_like(dense)
    for k, block in enumerate(factor.diagonal):
        L[k * size : (k + 1) * size, k * size : (k + 1) * size] = block
    for k, block in enumerate(factor.below):
        L[(k + 1) * size : (k + 2) * size, k * size : (k + 1) * size] = block
    assert np.array_equal(L, np.tril(L))
    np.testing.assert_allclose(L @ L.T, dense, atol=1e-11 * abs(dense).max())


def test_an_indefinite_matrix_has_no_factor():
    with pytest.raises(np.linalg.LinAlgError):
        BlockTridiagonal.of_windows(-np.ones((3, WINDOW, WINDOW))).factored()
