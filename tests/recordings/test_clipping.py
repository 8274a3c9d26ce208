"""Signals with flat ends, clipped by a sensor's range, and others that only look clipped."""

import numpy as np
import pytest

from ident.recordings.faults import limits, moves

T = np.arange(1000) / 100
SIGNAL = np.sin(2 * T) + 0.3 * np.sin(5.1 * T)
NOISY = SIGNAL + 0.02 * np.random.default_rng(0).normal(size=len(T))
Q = np.stack([np.sin(2 * T), np.cos(T)], axis=1)


def rounded(x, step):
    return step * np.round(x / step)


@pytest.mark.parametrize("step", [0, 1e-3, 0.01])
@pytest.mark.parametrize("low, high", [(None, 0.9), (-0.9, None), (-0.8, 0.9)])
def test_flat_ends_are_found(low, high, step):
    x = np.clip(rounded(NOISY, step) if step else NOISY, low, high)
    ends = limits(x)
    assert [each.value for each in ends] == [value for value in (low, high) if value is not None]
    for each in ends:
        np.testing.assert_array_equal(each.samples, x == each.value)
        assert moves(each.samples, Q)


@pytest.mark.parametrize(
    "x",
    [
        SIGNAL,
        NOISY,
        *(rounded(y, step) for y in (np.sin(2 * T), SIGNAL, NOISY) for step in (0.01, 0.05, 0.1, 0.3, 1)),
        np.maximum(SIGNAL, 0),
        np.full(1000, 3.0),
        np.where(np.arange(1000) % 100 == 50, 210.0, 207.0),
        np.full(1000, np.nan),
    ],
)
def test_peaks_empty_plates_and_coarse_steps_are_not_clipped(x):
    assert limits(x) == []
