"""Effects of a sensor's range and resolution on a signal."""

import numpy as np
import pytest

from ident.recordings.faults import limits, moves
from ident.recordings.resolution import quantum

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


ENCODER = 2 * np.pi / 4096


def noisy(std, seed=0):
    return SIGNAL + std * np.random.default_rng(seed).normal(size=len(T))


@pytest.mark.parametrize("step", [0.5, 0.1, 0.01, 1e-3, 1e-4])
@pytest.mark.parametrize("std", [0, 0.01])
def test_steps_are_found_at_any_size(step, std):
    assert quantum(rounded(noisy(std), step)) == pytest.approx(step, rel=1e-3)


def test_steps_survive_other_units_decimals_and_missing_samples():
    degrees = np.round(np.degrees(rounded(SIGNAL, ENCODER)), 2)
    assert quantum(np.radians(degrees)) == pytest.approx(ENCODER, rel=0.01)
    assert quantum(rounded(SIGNAL, 0.01).astype(np.float32).astype(float)) == pytest.approx(0.01, rel=1e-3)
    holes = np.where(np.arange(len(T)) % 7, rounded(SIGNAL, 0.1), np.nan)
    assert quantum(holes) == pytest.approx(0.1)


@pytest.mark.parametrize(
    "x",
    [SIGNAL, noisy(0.01), noisy(0.01).astype(np.float32).astype(float), np.full(1000, 3.0), np.zeros(0)],
    ids=["smooth", "noisy", "single precision", "constant", "nothing"],
)
def test_a_signal_on_no_lattice_has_no_steps(x):
    assert quantum(x) < 1e-6
