"""Trapezoidal velocities: against numerical derivatives, by hand, and errors."""

import numpy as np
import pytest

from ident.errors import InputError
from sim.motion.trapezoids import LASTING, REACH, RESTING, Trapezoids


def test_a_move_by_hand():
    """3 rad in 3 s: it accelerates for a second to 1.5 rad/s, moves on for a second, and decelerates."""
    move = Trapezoids([[1.0]], [[3.0]], [[0.5, 3.5]])
    q, dq, ddq = (x[:, 0] for x in move.trajectory(np.array([-5, 0.9, 1.5, 2, 2.5, 3, 3.5, 4.1, 9])))
    np.testing.assert_allclose(q, [0.5, 0.5, 0.6875, 1.25, 2, 2.75, 3.3125, 3.5, 3.5])
    np.testing.assert_allclose(dq, [0, 0, 0.75, 1.5, 1.5, 1.5, 0.75, 0, 0], atol=1e-12)
    np.testing.assert_allclose(ddq[[0, 1, 2, 4, 6, 7, 8]], [0, 0, 1.5, 0, -1.5, 0, 0], atol=1e-12)


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


def test_drawn_moves_fill_the_time_with_moves_and_rests():
    drawn = Trapezoids.drawn(np.random.default_rng(1), 4, 20)
    assert (drawn.start[:, -1] + drawn.lasting[:, -1] > 20).all()
    _, dq, ddq = drawn.trajectory(np.arange(2000) / 100)
    rests = ((dq == 0) & (ddq == 0)).mean()
    assert 0.5 * np.mean(RESTING) / np.mean(LASTING) < rests < 0.4
    assert np.abs(drawn.goals).max() <= REACH
    # Joints do not jump together.
    assert len(np.unique(drawn.start)) == drawn.start.size


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
