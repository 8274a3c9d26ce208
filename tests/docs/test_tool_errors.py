"""Errors of inertias over size."""

import numpy as np
import pytest

from docs.tools.tool_errors import over_size


def test_errors_are_over_the_inertia_of_a_box():
    """A uniform box of 1, 2 and 3 dm with moments of twice its own, a product of one side, and another mass."""
    mass, moments = 1.2, 0.1 * np.array([0.13, 0.10, 0.05])
    true = np.array([mass, 0, 0, 0, *moments, 0, 0, 0])
    assert over_size(true, true) == 0
    assert over_size(true + np.r_[0.3, 0, 0, 0, moments, 0, 0, 0], true) == pytest.approx(0.5)
    assert over_size(true + np.r_[np.zeros(7), 0, 0, 0.1 * 0.06], true) == pytest.approx(1 / 6)
