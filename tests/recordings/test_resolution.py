"""Resolution of signals, from their smallest differences, and coordinates at rest."""

import numpy as np
import pytest

from ident.recordings.resolution import quantum

T = np.arange(1000) / 100
SIGNAL = np.sin(2 * T) + 0.3 * np.sin(5.1 * T)
ENCODER = 2 * np.pi / 4096


def noisy(std, seed=0):
    return SIGNAL + std * np.random.default_rng(seed).normal(size=len(T))


def rounded(x, step):
    return step * np.round(x / step)


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
