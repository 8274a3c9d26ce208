"""Covariance of the trajectory estimate as a fit of linear equations, from the root that later steps use."""

import numpy as np
import pytest

from ident.trajectory.corrected import _root_of_inverse


@pytest.mark.parametrize("seed", range(4))
def test_the_root_is_that_of_the_inverse_however_different_units_are(seed):
    rng = np.random.default_rng(seed)
    rows, scale = rng.normal(size=(30, 5)), 10.0 ** rng.uniform(-6, 6, 5)
    precision = rows.T @ rows
    root = _root_of_inverse(np.linalg.inv(precision) * np.outer(scale, scale))
    np.testing.assert_allclose(root.T @ root * np.outer(scale, scale), precision, rtol=1e-7, atol=1e-9)


def test_what_is_known_for_certain_weighs_as_much_as_rounding_tells():
    """A direction without variance does not change the other directions."""
    root = _root_of_inverse(np.diag([4.0, 0.0, 9.0]))
    precision = root.T @ root
    assert np.isfinite(root).all() and precision[1, 1] > 1e10
    np.testing.assert_allclose(precision[[0, 2]], [[1 / 4, 0, 0], [0, 0, 1 / 9]], atol=1e-12)
