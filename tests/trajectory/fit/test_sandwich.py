"""Sums over coloured noise in one pass, against sums over all pairs of samples."""

from types import SimpleNamespace

import numpy as np
import pytest

from ident.trajectory.fit import sandwich
from ident.trajectory.fit.sandwich import _half, with_scatter

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


def piece(start, *, samples=50, origin=0.0):
    return SimpleNamespace(time=start + STEP * np.arange(samples), origin=origin)


@pytest.mark.parametrize("start", [1.0, 3.0])
def test_the_scatter_is_that_of_noise_and_motion(monkeypatch, start):
    """For unit white weights: `Mᵀ λP M + Rᵀ Γ R`, over two adjacent pieces as over one."""
    rows, of_motion = np.random.default_rng(3).normal(size=(2, 50, 1, 2)), 9 * np.eye(2)
    streams = [SimpleNamespace(weights=lambda x, some: x, slack=None, std=np.array([2.0]), step=STEP)]
    places = iter(rows)

    def response(*at):
        blocks = [(slice(None), next(places))]
        return SimpleNamespace(streams=streams, blocks=lambda _: blocks, scatter_of_motion=of_motion.copy())

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
