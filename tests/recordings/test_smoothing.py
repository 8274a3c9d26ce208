import numpy as np
import pytest
from scipy import signal

from ident.recordings.smoothing import chosen_cutoff, differences, low_pass, settling, smoothed

RATE = 100.0
T = np.arange(1200) / RATE
TONES = np.array([[0.5, 1.0], [1.7, 0.3], [2.9, 0.2]])


def tones(t):
    w, a = 2 * np.pi * TONES[:, 0], TONES[:, 1]
    angle = np.multiply.outer(t, w) + np.arange(3)
    return (a * np.sin(angle)).sum(1), (a * w * np.cos(angle)).sum(1), (-a * w**2 * np.sin(angle)).sum(1)


@pytest.mark.parametrize("cutoff", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("frequency", [0.5, 3.0, 6.0])
def test_the_filter_has_its_gain_and_no_phase(cutoff, frequency):
    x = np.sin(2 * np.pi * frequency * T)
    inner = slice(settling(RATE, cutoff), -settling(RATE, cutoff))
    warped = np.tan(np.pi * np.array([frequency, cutoff]) / RATE)
    gain = 1 / (1 + (warped[0] / warped[1]) ** 4)
    np.testing.assert_allclose(low_pass(x, RATE, cutoff)[inner], gain * x[inner], atol=2e-3)


@pytest.mark.parametrize("shape", [(10,), (50, 3), (943, 2)])
@pytest.mark.parametrize("cutoff", [0.1, 5.0, 45.0])
def test_the_filter_is_scipys(shape, cutoff):
    x = np.random.default_rng(0).normal(size=shape).cumsum(axis=0)
    padding = min(max(9, 2 * settling(100, cutoff)), len(x) - 1)
    expected = signal.sosfiltfilt(signal.butter(2, cutoff, output="sos", fs=100), x, axis=0, padlen=padding)
    np.testing.assert_allclose(low_pass(x, 100, cutoff), expected, atol=1e-10 * abs(x).max())


def test_differences_are_exact_for_quartics():
    t = T[:60]
    dx, ddx = differences(np.stack([t**4, t**2], axis=1), RATE)
    np.testing.assert_allclose(dx[2:-2], np.stack([4 * t**3, 2 * t], axis=1)[2:-2], atol=1e-10)
    np.testing.assert_allclose(ddx[2:-2], np.stack([12 * t**2, 2 + 0 * t], axis=1)[2:-2], atol=1e-8)
    assert np.isfinite(dx).all()
    assert np.isfinite(ddx).all()


def test_velocities_and_accelerations_of_tones():
    expected = tones(T)
    computed = smoothed(expected[0], RATE, 30.0)
    inner = slice(settling(RATE, 10.0), -settling(RATE, 10.0))
    for x, y in zip(computed, expected, strict=True):
        assert np.abs(x - y)[inner].max() < 2e-4 * np.abs(y).max()


def test_columns_stay_apart_and_missing_ones_stay_missing():
    x = np.stack([tones(T)[0], np.full(len(T), np.nan), np.cos(T)], axis=1)
    for together, alone in zip(smoothed(x, RATE, 4.0), smoothed(x[:, 2], RATE, 4.0), strict=True):
        assert together.shape == x.shape
        assert np.isnan(together[:, 1]).all()
        np.testing.assert_allclose(together[:, 2], alone, atol=1e-9)


@pytest.mark.parametrize("rate", [100, 1000])
@pytest.mark.parametrize("noise", [1e-5, 1e-4, 1e-3, 1e-2])
def test_noise_lowers_the_cutoff_but_not_below_the_signal(rate, noise):
    t = np.arange(12 * rate) / rate
    x = np.stack([tones(t)[0], np.sin(2 * np.pi * 2.9 * t)], axis=1)
    x += noise * np.random.default_rng(0).normal(size=x.shape)
    assert 1.9 * 2.9 < chosen_cutoff(x, rate) <= chosen_cutoff(tones(t)[0], rate)


@pytest.mark.parametrize(
    ("x", "message"),
    [
        (np.zeros((40, 2)), "at least 50 samples, got 40"),
        (np.ones((100, 2)), "a column that moves below 10 Hz"),
        (np.random.default_rng(0).normal(size=(500, 1)), "not noise alone; state a cut-off"),
        (np.sin(2 * np.pi * 30 * T), "a column that moves below 10 Hz"),
    ],
)
def test_no_cutoff_is_invented(x, message):
    with pytest.raises(ValueError, match=message):
        chosen_cutoff(x, RATE)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: low_pass(T, RATE, 50.0), "from 0.001 Hz to below half the rate, 50 Hz, got 50 Hz"),
        (lambda: low_pass(T, RATE, 1e-9), "from 0.001 Hz to below half the rate, 50 Hz, got 1e-09 Hz"),
        (lambda: low_pass(T, RATE, 0.0), "got 0 Hz"),
        (lambda: low_pass(T, RATE, np.nan), "got nan Hz"),
        (lambda: low_pass(T[:9], RATE, 3.0), "more than 9 samples, got 9"),
        (lambda: differences(T[:4], RATE), "at least 5 samples, got 4"),
    ],
)
def test_bad_input_is_one_sentence(call, message):
    with pytest.raises(ValueError, match=message):
        call()
