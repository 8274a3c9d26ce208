"""Signals: low-pass filters, runs and medians, sensors' ranges and resolution."""

import numpy as np
import pytest
from scipy import ndimage, signal
from slow_pendulum import rounded

from ident import Recording
from ident.recordings import smoothing
from ident.recordings.times import Sampled

T = np.arange(1200) / 100
TIME = T[:1000]
SINE, SMOOTH = np.sin(2 * TIME), np.sin(2 * TIME) + 0.3 * np.sin(5.1 * TIME)
NOISY = SMOOTH + 0.02 * np.random.default_rng(0).normal(size=1000)


def tones(t):
    return (np.array([1.0, 0.3, 0.2]) * np.sin(2 * np.pi * np.outer(t, [0.5, 1.7, 2.9]) + np.arange(3))).sum(axis=1)


@pytest.mark.parametrize("shape", [(10,), (50, 3), (943, 2)])
@pytest.mark.parametrize("cutoff", [0.1, 5.0, 45.0])
def test_the_filter_is_scipys(rng, shape, cutoff):
    x = rng.normal(size=shape).cumsum(axis=0)
    padding = min(max(9, 2 * smoothing.settling(100, cutoff)), len(x) - 1)
    expected = signal.sosfiltfilt(signal.butter(2, cutoff, output="sos", fs=100), x, axis=0, padlen=padding)
    np.testing.assert_allclose(smoothing.low_pass(x, 100, cutoff), expected, atol=1e-10 * abs(x).max())


def test_differences_are_exact_for_quartics():
    t = T[:60]
    dx, ddx = smoothing.differences(np.stack([t**4, t**2], axis=1), 100.0)
    np.testing.assert_allclose(dx[2:-2], np.stack([4 * t**3, 2 * t], axis=1)[2:-2], atol=1e-10)
    np.testing.assert_allclose(ddx[2:-2], np.stack([12 * t**2, 2 + 0 * t], axis=1)[2:-2], atol=1e-8)
    assert np.isfinite([dx, ddx]).all()


@pytest.mark.parametrize("rate", [100, 1000])
@pytest.mark.parametrize("noise", [1e-5, 1e-3, 1e-2])
def test_noise_lowers_the_cutoff_but_not_below_the_signal(rate, noise):
    t = np.arange(12 * rate) / rate
    x = np.stack([tones(t), np.sin(2 * np.pi * 2.9 * t)], axis=1)
    x += noise * np.random.default_rng(0).normal(size=x.shape)
    assert 1.9 * 2.9 < smoothing.chosen_cutoff(x, rate) <= smoothing.chosen_cutoff(tones(t), rate)


@pytest.mark.parametrize("pattern", ["0", "1", "000", "111", "1010", "0110", "1101", "0011101"])
def test_runs_are_those_of_scipy(pattern):
    mask = np.array([c == "1" for c in pattern], bool)
    spans = ndimage.find_objects(*ndimage.label(mask))
    assert smoothing.runs(mask).tolist() == [[span.start, span.stop] for (span,) in spans]


@pytest.mark.parametrize("size", [1, 4, 57])
@pytest.mark.parametrize("width", [1, 2, 5, 11])
def test_running_medians_of_blocks_of_windows_are_those_of_scipy(rng, size, width, monkeypatch):
    monkeypatch.setattr(smoothing, "AT_ONCE", 7 * width)
    x = rng.normal(size=size)
    expected, some = ndimage.median_filter(x, width, mode="nearest"), np.flatnonzero(x > 0)
    np.testing.assert_array_equal(smoothing.running_median(x, width), expected)
    np.testing.assert_array_equal(smoothing.running_median(x, width, some), expected[some])


def test_a_slow_stream_has_no_gaps_between_its_samples_also_where_a_component_is_missing():
    fast, slow = np.arange(0, 10, 1 / 100), np.arange(0, 10, 1 / 8)
    plate = np.stack([slow, np.full_like(slow, np.nan), slow], axis=1)
    streams = {"hip_position": (fast, np.sin(fast)), "ground_force": (slow, plate)}
    recording = Recording.from_streams(streams, rate=100.0)
    assert recording.covered(("ground_force",)).all()
    assert smoothing.longest_step(recording.streams["ground_force"]) == 0.25
    assert smoothing.longest_step(Sampled(np.zeros(1), np.zeros(1))) == smoothing.INTERPOLATED


def test_stretches_end_at_gaps_and_where_times_jump():
    time, inside = np.r_[np.arange(10), np.arange(20, 30)] / 100, np.ones(20, bool)
    assert smoothing.stretches(time, inside) == [slice(0, 10), slice(10, 20)]
    inside[[0, 4, 5]] = False
    assert smoothing.stretches(time, inside) == [slice(1, 4), slice(6, 10), slice(10, 20)]
    assert smoothing.stretches(time, np.zeros(20, bool)) == []


@pytest.mark.parametrize("step", [0, 1e-3, 0.01])
@pytest.mark.parametrize("low, high", [(None, 0.9), (-0.9, None), (-0.8, 0.9)])
def test_flat_ends_are_found(low, high, step):
    x = np.clip(rounded(NOISY, step), low, high)
    ends = smoothing.limits(x)
    assert [each.value for each in ends] == [value for value in (low, high) if value is not None]
    for each in ends:
        np.testing.assert_array_equal(each.samples, x == each.value)
        assert smoothing.moves(each.samples, np.stack([SINE, np.cos(TIME)], axis=1))


def test_a_joint_that_settles_at_rest_does_not_move():
    """A torque that friction holds is constant there, with positions of four decimals."""
    t = np.arange(1000) / 100
    q = np.where(t % 2 < 1, np.sin(np.pi * (t % 1)), 1e-3 * np.exp(-(t % 1) / 0.2))
    assert not smoothing.moves(t % 2 >= 1, np.round(q, 4)[:, None])
    assert smoothing.moves(t % 2 < 1, np.round(q, 4)[:, None])


def test_peaks_empty_plates_and_coarse_steps_are_not_clipped():
    signals = [rounded(y, step) for y in (SINE, SMOOTH, NOISY) for step in (0, 0.01, 0.05, 0.1, 0.3, 1)][1:]
    spikes = np.where(np.arange(1000) % 100 == 50, 210.0, 207.0)
    for x in (*signals, np.maximum(SMOOTH, 0), np.full(1000, 3.0), spikes, np.full(1000, np.nan)):
        assert smoothing.limits(x) == []


@pytest.mark.parametrize("step", [0.5, 0.1, 0.01, 1e-3, 1e-4])
@pytest.mark.parametrize("std", [0, 0.5])
def test_steps_are_found_at_any_size(step, std):
    assert smoothing.quantum(rounded(SMOOTH + std * (NOISY - SMOOTH), step)) == pytest.approx(step, rel=1e-3)


def test_steps_survive_other_units_decimals_and_missing_samples_and_a_signal_on_no_lattice_has_none():
    encoder, tenths = 2 * np.pi / 4096, rounded(SMOOTH, 0.1)
    degrees = np.round(np.degrees(rounded(SMOOTH, encoder)), 2)
    assert smoothing.quantum(np.radians(degrees)) == pytest.approx(encoder, rel=0.01)
    assert smoothing.quantum(rounded(SMOOTH, 0.01).astype(np.float32).astype(float)) == pytest.approx(0.01, rel=1e-3)
    assert smoothing.quantum(np.where(np.arange(1000) % 7, tenths, np.nan)) == pytest.approx(0.1)
    for x in (SMOOTH, NOISY, NOISY.astype(np.float32).astype(float), np.full(1000, 3.0), np.zeros(0)):
        assert smoothing.quantum(x) < 1e-6
