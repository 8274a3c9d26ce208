"""Sums over coloured noise in one pass, against sums over all pairs of samples."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty

import ident
from ident.trajectory.fit import noise_colours, sandwich
from ident.trajectory.fit.noise_colours import response_of
from ident.trajectory.fit.sandwich import _goes_on, _half, with_scatter

STEP, TIMES = 0.02, np.array([0.0, 0.05, 0.4])
AMPLITUDES = np.array([[0.3, 0.0], [0.5, 0.0], [0.2, 1.5]])
COLOURS = SimpleNamespace(times=TIMES, amplitudes=[AMPLITUDES])


def dense(y, sizes):
    """`yᵀ Γ y` with a dense Γ."""
    apart = STEP * np.abs(np.subtract.outer(np.arange(len(y)), np.arange(len(y))))
    noise = sizes[0] * np.eye(len(y)) + sum(
        size * np.exp(-apart / time) for size, time in zip(sizes[1:], TIMES[1:], strict=True)
    )
    return y.T @ noise @ y


@pytest.mark.parametrize("s", [0, 1])
@pytest.mark.parametrize("cuts", [[], [17], [17, 60]])
def test_sums_over_coloured_noise_go_on_from_piece_to_piece(s, cuts):
    y, tails = np.random.default_rng(s).normal(size=(90, 3)), {}
    computed = sum(part.T @ _half(part, COLOURS, 0, s, STEP, tails) for part in np.split(y, cuts))
    np.testing.assert_allclose(computed + computed.T, dense(y, AMPLITUDES[:, s]), rtol=1e-9, atol=1e-9)


def test_sums_of_other_signals_and_streams_are_none_of_its_own():
    y, tails = np.random.default_rng(2).normal(size=(90, 3)), {}
    colours = SimpleNamespace(times=TIMES, amplitudes=[AMPLITUDES, AMPLITUDES])
    for which, s in ((0, 1), (1, 0), (0, 0)):
        computed = y.T @ _half(y, colours, which, s, STEP, tails)
        np.testing.assert_allclose(computed + computed.T, dense(y, AMPLITUDES[:, s]), rtol=1e-9, atol=1e-9)


def piece(start, *, samples=50, origin=0.0):
    return SimpleNamespace(time=start + STEP * np.arange(samples), origin=origin)


@pytest.mark.parametrize(
    ("start", "change", "goes_on"),
    [
        (1.0, {}, True),
        (1.01, {}, True),
        (1.05, {}, False),
        (0.9, {}, False),
        (1.0, {"origin": 5.0}, False),
        (1.0, {"selection": [0, 2]}, False),
    ],
)
def test_noise_goes_on_in_the_next_piece_of_the_same_recording(start, change, goes_on):
    """Correlated noise does not continue over a gap, nor from one recording to another."""
    selection = np.array(change.get("selection", [0, 1]))
    fit = SimpleNamespace(
        pieces=[piece(0.0), piece(start, origin=change.get("origin", 0.0))], selections=[np.array([0, 1]), selection]
    )
    assert _goes_on(fit, 1) == goes_on


def test_for_decisions_some_pieces_stand_for_the_others(monkeypatch):
    estimate = ident.identify(PENDULUM, [faulty(seed) for seed in range(2)]).trajectory
    exact, used = with_scatter(estimate.measurement, estimate.fit), []

    def counted(measurement, fit, k):
        used.append(fit.pieces[k].log)
        return response_of(measurement, fit, k)

    monkeypatch.setattr(noise_colours, "ENOUGH", 300)
    monkeypatch.setattr(noise_colours, "response_of", counted)
    monkeypatch.setattr(sandwich, "response_of", counted)
    quick = with_scatter(estimate.measurement, estimate.fit, every=False)
    assert set(used) == {0, 1} and len(used) < len(estimate.fit.pieces) == len(quick.scatters)
    some, every = (np.sqrt(np.diag(each.covariance))[estimate.fit.free] for each in (quick, exact))
    assert (some / every).min() > 0.5 and (some / every).max() < 2


@pytest.mark.parametrize("start", [1.0, 3.0])
def test_the_scatter_is_that_of_noise_and_motion(monkeypatch, start):
    """For unit white weights: `Mᵀ λP M + Rᵀ Γ R`, over two adjacent pieces as over one."""
    rows, of_motion = np.random.default_rng(3).normal(size=(2, 50, 1, 2)), 9 * np.eye(2)
    streams = [SimpleNamespace(weights=lambda x: x, slack=None, std=np.array([2.0]), step=STEP)]
    places = iter(rows)

    def response(*at):
        own = next(places)
        return SimpleNamespace(streams=streams, rows=[own], scatter_of_motion=of_motion.copy())

    monkeypatch.setattr(sandwich, "some_responses", lambda measurement, fit: {})
    monkeypatch.setattr(sandwich, "noise_colours", lambda fit, responses: COLOURS)
    monkeypatch.setattr(sandwich, "response_of", response)
    monkeypatch.setattr(sandwich, "replace", lambda fit, pieces, scatters: scatters)
    pieces, both = [piece(0.0), piece(start)], [np.array([0, 1])] * 2
    shares = [(np.zeros((2, 2)), None)] * 2
    fit = SimpleNamespace(pieces=pieces, selections=both, coefficients=both, theta=np.zeros(2), shares=shares)
    every = np.concatenate(rows)[:, 0]
    parts = [every] if start == 1.0 else [rows[0][:, 0], rows[1][:, 0]]
    expected = 2 * of_motion + 4 * sum(dense(part, AMPLITUDES[:, 0]) for part in parts)
    np.testing.assert_allclose(sum(with_scatter(None, fit)), expected, rtol=1e-9)
