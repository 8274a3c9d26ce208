"""Sums over coloured noise, and white and slow noise separated by residuals."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.studies.person_recordings import autoregressive
from ident.trajectory.fit import noise_colours, sandwich
from ident.trajectory.fit.noise_colours import _amplitudes, _Bands
from ident.trajectory.fit.repeats import RepeatedMotion
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
@pytest.mark.parametrize("cuts", [[], [17], [17, 60]])
def test_sums_over_coloured_noise_go_on_from_piece_to_piece(s, cuts):
    y, tails = np.random.default_rng(s).normal(size=(90, 3)), {}
    computed = sum(part.T @ _half(part, COLOURS, 0, s, STEP, tails) for part in np.split(y, cuts))
    np.testing.assert_allclose(computed + computed.T, dense(y, AMPLITUDES[:, s]), rtol=1e-9, atol=1e-9)


def piece(start, *, samples=50, origin=0.0):
    time = start + STEP * np.arange(samples)
    return SimpleNamespace(time=time, when=time, origin=origin, log=0)


@pytest.mark.parametrize("start", [1.0, 3.0])
@pytest.mark.parametrize("r", [0.0, 0.4, 1.0])
def test_the_scatter_is_that_of_noise_and_motion(monkeypatch, start, r):
    """For unit white weights, of two pieces, of which a part r of the noise repeats the other's: against dense sums."""
    rows, of_motion = np.random.default_rng(3).normal(size=(2, 50, 1, 2)), 9 * np.eye(2)
    places = iter(zip((0.0, start), rows, strict=True))

    def response(*at):
        first, own = next(places)
        time = first + STEP * np.arange(50)
        stream = SimpleNamespace(weights=lambda x, some: x, slack=None, std=np.array([2.0]), step=STEP, time=time)
        return SimpleNamespace(
            streams=[stream], blocks=lambda _: [(slice(None), own)], scatter_of_motion=of_motion.copy()
        )

    monkeypatch.setattr(sandwich, "some_responses", lambda measurement, fit: {})
    monkeypatch.setattr(sandwich, "noise_colours", lambda fit, responses: COLOURS)
    motion = RepeatedMotion({0: 0.0}, start, 9.0, np.array([[r], [0.0]]), np.array([1 + r]))
    monkeypatch.setattr(sandwich, "repetitions", lambda measurement, fit: [motion])
    monkeypatch.setattr(sandwich, "response_of", response)
    monkeypatch.setattr(sandwich, "replace", lambda fit, pieces, scatters: scatters)
    pieces, both = [piece(0.0), piece(start)], [np.array([0, 1])] * 2
    shares = [(np.zeros((2, 2)), None)] * 2
    fit = SimpleNamespace(pieces=pieces, selections=both, coefficients=both, theta=np.zeros(2), shares=shares)
    every = np.concatenate(rows)[:, 0]
    parts = [every] if start == 1.0 else [rows[0][:, 0], rows[1][:, 0]]
    apart = sum(dense(part, AMPLITUDES[:, 0]) for part in parts)
    sums = np.zeros((round(start / STEP), 2))
    for at, own in zip((0, round(start / STEP)), rows, strict=True):
        np.add.at(sums, (at + np.arange(50)) % len(sums), own[:, 0])
    repeated = dense(sums, AMPLITUDES[:, 0], around=start)
    expected = 2 * of_motion + 4 * ((1 - r) * apart + r * repeated)
    np.testing.assert_allclose(sum(with_scatter(None, fit)), expected, rtol=1e-9)


SECONDS = np.array([0.0, 2.0, 6.0, 18.0, 54.0])
"""Correlation times in samples."""


def powers(number, bands=24):
    """Expected power of white noise and of each kind of slow noise in bands, and the bands' numbers of frequencies."""
    frequency = np.fft.rfftfreq(number)
    band = np.clip(np.searchsorted(np.geomspace(1 / number, 0.5, bands + 1), frequency, side="right") - 1, 0, bands - 1)
    rho = np.where(SECONDS > 0, np.exp(-1 / np.maximum(SECONDS, 1e-9)), 0)
    each = (1 - rho**2) / (1 + rho**2 - 2 * rho * np.cos(2 * np.pi * frequency[:, None]))
    return np.stack([np.bincount(band, x, bands) for x in each.T], axis=1), np.bincount(band, minlength=bands), band


@pytest.mark.parametrize("slow", [0.0, 1.0])
def test_amplitudes_of_noise_that_was_drawn(slow):
    rng, number = np.random.default_rng(0), 4000
    own, counts, band = powers(number)
    x = rng.normal(size=number) + np.sqrt(slow) * autoregressive(rng, number, np.exp(-1 / 18))
    observed = np.bincount(band, np.abs(np.fft.rfft(x)) ** 2 / number, len(counts))
    a = _amplitudes(observed, counts.astype(float), np.zeros(len(counts)), *own.T)
    assert a[0] == pytest.approx(1, abs=0.1)
    assert a[1:].sum() == pytest.approx(slow, abs=0.35) and (slow or not a[1:].any())


def test_spectra_are_those_of_noise_that_was_drawn_without_its_slowest_part():
    """A fit follows slow noise, and with it the jump between the ends, which would leak into all frequencies."""
    rng, number = np.random.default_rng(0), 120
    drawn = np.stack([autoregressive(rng, number, 0.95) for _ in range(2000)], axis=1)
    time, one = 0.02 * np.arange(number), np.ones((number, len(drawn[0])))
    slow = np.polynomial.legendre.legvander(np.linspace(-1, 1, number), 3)
    left = drawn - slow @ np.linalg.lstsq(slow, drawn, rcond=None)[0]
    stream = SimpleNamespace(time=time, step=0.02, residual=left, clear=one > 0, std=one[0])
    bands = _Bands.of(stream, np.geomspace(0.2, 25, 25), np.array([0, -0.02 / np.log(0.95)]))
    fast = bands.summed(one[: len(bands.frequency)])[1, 10:]
    assert bands.observed[10:].mean(axis=1) == pytest.approx(fast[:, 0], rel=0.05)


def test_noise_is_found_from_some_pieces_of_logs_with_offsets_of_their_own(monkeypatch):
    """Parameters that the selected pieces leave open are known from the others."""
    monkeypatch.setattr("ident.trajectory.fit.noise_colours.ENOUGH", 400)
    logs = [shortened(faulty(seed), 400) for seed in range(3)]
    estimate = ident.identify(PENDULUM, logs, own=["offset"])
    assert np.isfinite(estimate.std).all() and (estimate.std > 0).all()


@pytest.mark.parametrize(("room", "chosen"), [(1e9, range(6)), (40_000, [0, 2, 3, 5]), (1.0, [0, 3])])
def test_noise_of_many_streams_is_estimated_from_fewer_pieces_of_every_recording(monkeypatch, room, chosen):
    pieces = [SimpleNamespace(when=np.zeros(100), log=k // 3) for k in range(6)]
    streams = {"coordinate_noise": np.ones(7), "channel_noise": np.ones(6), "theta": np.ones(10)}
    monkeypatch.setattr(noise_colours, "ROOM", room)
    monkeypatch.setattr(noise_colours, "response_of", lambda measurement, fit, k: k)
    assert [*noise_colours.some_responses(None, SimpleNamespace(pieces=pieces, **streams))] == [*chosen]
