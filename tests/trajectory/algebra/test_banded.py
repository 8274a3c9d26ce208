"""Banded matrices against dense ones."""

import numpy as np
import pytest

from ident.trajectory.algebra.banded import WINDOW, Banded
from ident.trajectory.algebra.spline import LOCAL, Spline


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
        np.testing.assert_allclose(
            window[-width * n :, -width * n :], inverse[own, own], atol=1e-9 * abs(inverse).max()
        )


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
