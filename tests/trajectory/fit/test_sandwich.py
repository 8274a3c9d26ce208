"""Sums over coloured noise, and white and slow noise separated by residuals."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.studies.person_recordings import autoregressive
from ident.trajectory.algebra.whitening import innovations
from ident.trajectory.fit import noise_colours, sandwich
from ident.trajectory.fit.noise_colours import _amplitudes, _Bands
from ident.trajectory.fit.repeats import RepeatedMotion
from ident.trajectory.fit.response import Stream
from ident.trajectory.fit.sandwich import _half, with_scatter

STEP, TIMES = 0.02, np.array([0.0, 0.05, 0.4])
AMPLITUDES = np.array([[0.3, 0.0], [0.5, 0.0], [0.2, 1.5]])
COLOURS = SimpleNamespace(times=TIMES, amplitudes=[AMPLITUDES])


def dense(y, sizes, around=np.inf):
    """`yᵀ Γ y` with a dense Γ, of periodic noise of the same variance also around its period."""
    apart = STEP * np.abs(np.subtract.outer(np.arange(len(y)), np.arange(len(y))))
    noise = sizes[0] * np.eye(len(y)) + sum(
        size * (np.exp(-apart / time) + np.exp((apart - around) / time)) / (1 + np.exp(-around / time))
        for size, time in zip(sizes[1:], TIMES[1:], strict=True)
    )
    return y.T @ noise @ y


@pytest.mark.parametrize("s", [0, 1])
@pytest.mark.parametrize("cuts", [[], [17, 60]])
def test_sums_over_coloured_noise_go_on_from_piece_to_piece(s, cuts):
    y, tails = np.random.default_rng(s).normal(size=(90, 3)), {}
    computed = sum(part.T @ _half(part, COLOURS, 0, s, STEP, tails) for part in np.split(y, cuts))
    np.testing.assert_allclose(computed + computed.T, dense(y, AMPLITUDES[:, s]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("start", [1.0, 3.0])
@pytest.mark.parametrize("r", [0.0, 0.4, 1.0])
def test_the_scatter_is_that_of_noise_and_motion(monkeypatch, start, r):
    """For unit white weights, of two pieces, of which a part r of the noise repeats the other's: against dense sums.

    One sample of each is an outlier.
    """
    rows, of_motion = np.random.default_rng(3).normal(size=(2, 50, 1, 2)), 9 * np.eye(2)
    times = [first + STEP * np.arange(50) for first in (0.0, start)]
    beyond, std = np.where(np.arange(50)[:, None] == 20, 3.0, 0.0), np.array([2.0])
    streams = [
        SimpleNamespace(weighted=lambda x, some: x.copy(), beyond_noise=beyond, std=std, step=STEP, time=time)
        for time in times
    ]
    responses = iter(
        SimpleNamespace(
            streams=[stream], blocks=lambda _, own=own: [(slice(None), own)], scatter_of_motion=of_motion.copy()
        )
        for stream, own in zip(streams, rows, strict=True)
    )
    motion = RepeatedMotion({0: 0.0}, start, 9.0, np.array([[r], [0.0]]), np.array([1 + r]))
    for name, value in {
        "some_responses": lambda *_: {},
        "noise_colours": lambda *_: COLOURS,
        "repetitions": lambda *_: [motion],
        "response_of": lambda *_: next(responses),
        "replace": lambda fit, pieces, scatters: scatters,
    }.items():
        monkeypatch.setattr(sandwich, name, value)
    pieces, both = [SimpleNamespace(time=time, when=time, origin=0.0, log=0) for time in times], [np.arange(2)] * 2
    shares = [(np.zeros((2, 2)), None)] * 2
    fit = SimpleNamespace(pieces=pieces, selections=both, coefficients=both, theta=np.zeros(2), shares=shares)
    parts = rows[..., 0, :]
    apart = sum(dense(part, AMPLITUDES[:, 0]) for part in ([np.concatenate(parts)] if start == 1.0 else parts))
    sums = np.zeros((round(start / STEP), 2))
    for at, own in zip((0, len(sums)), parts, strict=True):
        np.add.at(sums, (at + np.arange(50)) % len(sums), own)
    outliers = 9 * rows[:, 20, 0].T @ rows[:, 20, 0]
    expected = 2 * of_motion + outliers + 4 * ((1 - r) * apart + r * dense(sums, AMPLITUDES[:, 0], around=start))
    np.testing.assert_allclose(sum(with_scatter(None, fit)), expected, rtol=1e-9)


@pytest.mark.parametrize("slow", [0.0, 1.0])
def test_amplitudes_of_noise_that_was_drawn(slow, number=4000, bands=24):
    """Of white noise, and of correlation times of 2 to 54 samples."""
    frequency, rng = np.fft.rfftfreq(number), np.random.default_rng(0)
    band = np.clip(np.searchsorted(np.geomspace(1 / number, 0.5, bands + 1), frequency, side="right") - 1, 0, bands - 1)
    rho = np.array([0, *np.exp(-1 / np.array([2.0, 6.0, 18.0, 54.0]))])
    powers = (1 - rho**2) / (1 + rho**2 - 2 * rho * np.cos(2 * np.pi * frequency[:, None]))
    x = rng.normal(size=number) + np.sqrt(slow) * autoregressive(rng, number, rho[3])
    own, counts = [np.bincount(band, each, bands) for each in powers.T], np.bincount(band, minlength=bands)
    observed = np.bincount(band, np.abs(np.fft.rfft(x)) ** 2 / number, bands)
    given = [x[:, None] for x in (observed, counts.astype(float), np.zeros(bands))]
    a = _amplitudes(*given, kinds=np.array(own)[..., None])[:, 0]
    assert a[0] == pytest.approx(1, abs=0.1)
    assert a[1:].sum() == pytest.approx(slow, abs=0.35) and (slow or not a[1:].any())


def test_spectra_are_those_of_noise_that_was_drawn_without_its_slowest_part():
    """A fit follows slow noise, and with it the jump between the ends, which would leak into all frequencies."""
    rng, number = np.random.default_rng(0), 120
    drawn = np.stack([autoregressive(rng, number, 0.95) for _ in range(2000)], axis=1)
    time, one = 0.02 * np.arange(number), np.ones((number, len(drawn[0])))
    slow = np.polynomial.legendre.legvander(np.linspace(-1, 1, number), 3)
    left = drawn - slow @ np.linalg.lstsq(slow, drawn, rcond=None)[0]
    stream = SimpleNamespace(time=time, step=0.02, new=SimpleNamespace(residual=left), clear=one > 0, std=one[0])
    bands = _Bands.of(stream, np.geomspace(0.2, 25, 25), np.array([0, -0.02 / np.log(0.95)]))
    fast = bands.summed(one[: len(bands.frequency)])[1, 10:]
    assert bands.observed[10:].mean(axis=1) == pytest.approx(fast[:, 0], rel=0.05)


def test_noise_is_estimated_from_some_pieces_of_logs_with_offsets_of_their_own(monkeypatch):
    """Parameters that the selected pieces leave open are known from the others."""
    monkeypatch.setattr(noise_colours, "ENOUGH", 250)
    estimate = ident.identify(PENDULUM, [shortened(faulty(seed), 250) for seed in range(3)], own=["offset"])
    assert np.isfinite(estimate.std).all() and (estimate.std > 0).all()


@pytest.mark.parametrize(("room", "chosen"), [(1e9, range(6)), (40_000, [0, 2, 3, 5]), (1.0, [0, 3])])
def test_noise_of_many_streams_is_estimated_from_fewer_pieces_of_every_recording(monkeypatch, room, chosen):
    pieces = [SimpleNamespace(when=np.zeros(100), log=k // 3) for k in range(6)]
    streams = {"coordinate_noise": np.ones(7), "channel_noise": np.ones(6), "theta": np.ones(10)}
    monkeypatch.setattr(noise_colours, "ROOM", room)
    monkeypatch.setattr(noise_colours, "response_of", lambda measurement, fit, k: k)
    assert [*noise_colours.some_responses(None, SimpleNamespace(pieces=pieces, **streams))] == [*chosen]


def test_outliers_are_no_noise_of_all_samples_but_errors_of_their_own():
    """Of noise of .1, one sample that is 2 off, with slack and without."""
    residual, slack = np.full((9, 1), 0.05), np.zeros((9, 1))
    residual[4], slack[:2] = -2.0, 0.3
    new = innovations(residual, np.zeros(9, int), np.array([0.1]), np.zeros(1), slack)
    stream = Stream(np.arange(9.0), None, None, new, np.array([0.1]), slack)
    assert np.flatnonzero(~stream.clear).tolist() == [0, 1, 4]
    np.testing.assert_allclose(stream.beyond_noise[:, 0], [0.3, 0.3, 0, 0, np.sqrt(2.0**2 - 0.1**2), 0, 0, 0, 0])
