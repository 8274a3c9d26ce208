"""Residuals are judged where joints that rub move; what is at rest is a number of its own."""

from types import SimpleNamespace

import numpy as np
import pytest
from fits import sampled

from ident.regression.held_out import HeldOut

rng = np.random.default_rng(0)
MEASURED, RESIDUAL = rng.normal(size=(100, 3)) + 5, 0.1 * rng.normal(size=(100, 3))


FIT = SimpleNamespace(equations=SimpleNamespace(channels=("hip", "knee", "foot")))


def held(resting, versions=(MEASURED,), chosen=None, residual=RESIDUAL, **more):
    samples = tuple(sampled(*(np.full((100, 2), k) for k in range(3)), x) for x in versions)
    chosen = np.zeros(residual.shape, int) if chosen is None else chosen
    return HeldOut(np.arange(100.0), (0,), samples, chosen, FIT, residual, resting, **more)


def rests(*spans):
    """Mask of the samples at which each channel rests, by its last one."""
    return np.arange(100)[:, None] < np.array(spans)


def test_a_residual_at_rest_is_no_part_of_the_ratio_of_any_candidate():
    resting = rests(0, 30, 0)
    wrong = np.where(resting, 9.0, RESIDUAL)
    judged = held(resting, residual=wrong, rivals={"model": 2 * wrong})
    moving = slice(30, None)
    signal = MEASURED[moving, 1].std()
    assert judged.signal[1] == pytest.approx(signal) and judged.signal[0] == pytest.approx(MEASURED[:, 0].std())
    assert judged.ratio[1] == pytest.approx(np.sqrt((RESIDUAL[moving, 1] ** 2).mean()) / signal)
    assert judged.ratio_of(judged.rivals["model"]) == pytest.approx(2 * judged.ratio)
    assert judged.relative_rms[1] == pytest.approx(judged.rms[1] / np.sqrt((MEASURED[moving, 1] ** 2).mean()))
    assert judged.ratio_at_rest(wrong)[1] == pytest.approx(9 / signal)
    assert np.isnan(judged.ratio_at_rest(wrong)[[0, 2]]).all()
