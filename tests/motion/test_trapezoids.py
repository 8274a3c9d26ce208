"""Trapezoidal velocities: against numerical derivatives, by hand, and errors."""

import numpy as np
import pytest

from ident.errors import InputError
from sim.motion.excitation import Trapezoids


def test_velocities_and_accelerations_are_the_derivatives():
    drawn, h = Trapezoids.drawn(np.random.default_rng(0), 3, 10), 1e-4
    time = np.arange(0, 10, h)
    q, dq, ddq = drawn.trajectory(time)
    assert q.shape == dq.shape == ddq.shape == (len(time), drawn.joints) == (100_000, 3)
    assert np.abs(np.gradient(q, h, axis=0) - dq).max() < 4 * h * np.abs(ddq).max()
    # Except at the jumps, four for each move.
    wrong = np.abs(np.gradient(dq, h, axis=0) - ddq) > 1e-6
    assert wrong.mean() < 4 * 3 * 11 / len(time)
    np.testing.assert_array_equal(drawn.with_noise(3).trajectory(time, np.random.default_rng(1))[0], q)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (([[0, 1]], [[1]], [[0, 1, 2]]), r"got shapes \(1, 2\), \(1, 1\) and \(1, 3\)"),
        (([[0, 1]], [[1, 1]], [[0, 1]]), "goals"),
        (([[0, 1]], [[1, np.nan]], [[0, 1, 2]]), "finite numbers"),
        (([[0, 1]], [[1.5, 1]], [[0, 1, 2]]), "to end before the next one"),
        (([[0, 1]], [[0, 1]], [[0, 1, 2]]), "take some time"),
    ],
)
def test_what_is_no_such_motion_is_refused(given, message):
    with pytest.raises(InputError, match=message):
        Trapezoids(*given)
