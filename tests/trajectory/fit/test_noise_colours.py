"""White and slow noise, separated by their residuals."""

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.studies.noise_processes import autoregressive
from ident.trajectory.fit.noise_colours import _amplitudes

TIMES = np.array([0.0, 2.0, 6.0, 18.0, 54.0])
"""Correlation times in samples."""


def powers(number, bands=24):
    """Expected power of white noise and of each kind of slow noise in bands, and the bands' numbers of frequencies."""
    frequency = np.fft.rfftfreq(number)
    band = np.clip(np.searchsorted(np.geomspace(1 / number, 0.5, bands + 1), frequency, side="right") - 1, 0, bands - 1)
    rho = np.where(TIMES > 0, np.exp(-1 / np.maximum(TIMES, 1e-9)), 0)
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


def test_noise_is_found_from_some_pieces_of_logs_with_offsets_of_their_own(monkeypatch):
    """Parameters that the selected pieces leave open are known from the others."""
    monkeypatch.setattr("ident.trajectory.fit.noise_colours.ENOUGH", 400)
    logs = [shortened(faulty(seed), 400) for seed in range(3)]
    estimate = ident.identify(PENDULUM, logs, own=["offset"])
    assert np.isfinite(estimate.std).all() and (estimate.std > 0).all()
