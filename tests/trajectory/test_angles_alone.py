import numpy as np
import pytest

from ident.recordings.times import Sampled
from ident.trajectory.angles_alone import UNSETTLED, smoothed


def wave(time, frequency=0.7):
    return np.sin(2 * np.pi * frequency * time)[:, None]


@pytest.mark.parametrize("rate", [100, 1000])
@pytest.mark.parametrize("share", [0.3, 1.0, 1.5])
def test_a_frequency_passes_as_the_formula_says(rate, share):
    T = 0.05
    frequency = share / (2 * np.pi * T)
    time = np.arange(0, 10, 1 / rate)
    middle = time[abs(time - 5) < 3]
    q, _, ddq, _ = smoothed(Sampled(time, wave(time, frequency)), T).evaluate(middle)
    expected = wave(middle, frequency) / (1 + share**6)
    np.testing.assert_allclose(q, expected, rtol=0, atol=0.002)
    np.testing.assert_allclose(ddq, -((2 * np.pi * frequency) ** 2) * expected, rtol=0, atol=0.01 / T**2)


def test_either_side_of_a_gap_is_smoothed_by_itself():
    time = np.arange(0, 10, 0.01)
    x = wave(time) + 0.01 * np.random.default_rng(0).normal(size=(1000, 1))
    parts = [slice(0, 300), slice(640, 1000)]
    kept = np.r_[tuple(np.arange(1000)[part] for part in parts)]
    whole = smoothed(Sampled(time[kept], x[kept]), 0.05)
    for part in parts:
        alone = smoothed(Sampled(time[part], x[part]), 0.05)
        np.testing.assert_array_equal(whole.evaluate(time[part]), alone.evaluate(time[part]))
    between = time + 0.005
    near = np.min([abs(between - end) for end in (0, 2.99, 6.4, 9.99)], axis=0) < UNSETTLED
    inside = (between < 2.99) | ((between > 6.4) & (between < 9.99))
    np.testing.assert_array_equal(whole.settled(between), inside & ~near)
    assert abs(whole.evaluate(time[300:640])[0]).max() < 1.2
