import numpy as np
import pytest

from sim.motion.fourier import FourierTrajectory, basis


def random_trajectory(harmonics=5, joints=3, duration=7.3):
    rng = np.random.default_rng(harmonics)
    return FourierTrajectory(duration, rng.normal(size=joints), rng.normal(size=(joints, 2 * harmonics - 2)))


@pytest.mark.parametrize("harmonics", [2, 3, 5, 12])
def test_it_rests_at_both_ends_and_returns(harmonics):
    q, dq, ddq = random_trajectory(harmonics).states(np.array([0, 7.3]))
    np.testing.assert_allclose(dq, 0, atol=1e-12)
    np.testing.assert_allclose(ddq, 0, atol=1e-11)
    np.testing.assert_allclose(q[0], q[1], atol=1e-12)


def test_derivatives_are_those_of_finite_differences():
    trajectory, time, h = random_trajectory(), np.linspace(0, 7.3, 50), 1e-5
    before, now, after = (trajectory.states(time + shift) for shift in (-h, 0, h))
    for k in (0, 1):
        np.testing.assert_allclose((after[k] - before[k]) / (2 * h), now[k + 1], atol=1e-7)


def test_the_columns_span_all_series_that_rest():
    # Sines and cosines of K harmonics, less one condition on each.
    for harmonics in (2, 5):
        B = basis(1.0, harmonics, np.linspace(0, 1, 100))[1]
        assert np.linalg.matrix_rank(B) == B.shape[1] == 2 * harmonics - 2
        np.testing.assert_allclose(B[:-1].T @ B[:-1], 99 / 2 * np.eye(B.shape[1]), atol=1e-10)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"coefficients": [[1.0, 2, 3]]}, r"shapes \(1,\) and \(1, 3\)"),
        ({"coefficients": [[], []]}, r"shapes \(1,\) and \(2, 0\)"),
        ({"center": [0.0, 1]}, r"shapes \(2,\) and \(1, 2\)"),
        ({"center": [np.nan]}, "finite numbers"),
        ({"duration": 0.0}, "positive duration, got 0.0 s"),
        ({"duration": np.inf}, "positive duration"),
    ],
)
def test_bad_series_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        FourierTrajectory(**({"duration": 1.0, "center": [0.0], "coefficients": [[1.0, 2.0]]} | change))
