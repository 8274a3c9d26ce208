"""Noise, smoothness and knots of each of several recordings."""

from functools import cache

import driven_arm
import numpy as np
import pytest
import swinging
from swinging import NOISE

import ident

LOUDER = 8.0
"""Noise of the second recording's wrench over that of the first."""


def quiet_and_loud(seed=0):
    """Two recordings of one motion, of which the second has more noise in the wrench."""
    rng = np.random.default_rng(seed)
    quiet, loud = swinging.streams(rng), swinging.streams(rng)
    for name, (time, values) in loud.items():
        if name.startswith("ground"):
            loud[name] = time, values + np.sqrt(LOUDER**2 - 1) * NOISE[name] * rng.normal(size=values.shape)
    return [ident.Recording.from_streams(each) for each in (quiet, loud)]


@cache
def estimate():
    return ident.identify(swinging.pendulum(), quiet_and_loud())


def test_every_recording_has_noise_of_its_own():
    quiet, loud = estimate().trajectory.fit.noises
    std = np.repeat([NOISE["ground_force"], NOISE["ground_torque"]], 3)
    np.testing.assert_allclose(quiet.channels, std, rtol=0.1)
    np.testing.assert_allclose(loud.channels, LOUDER * std, rtol=0.1)
    overall = std * np.sqrt((1 + LOUDER**2) / 2)
    np.testing.assert_allclose(estimate().trajectory.fit.channel_noise, overall, rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_knots_are_as_dense_as_each_recording_needs(order):
    """A motion four times as fast needs knots about four times as dense."""
    logs = [driven_arm.log(pace=pace) for pace in (1.0, 4.0)]
    steps = ident.identify(driven_arm.mechanism(), [logs[k] for k in order]).trajectory.steps
    slow, fast = (steps[k] for k in np.argsort(order))
    assert 2.5 * fast < slow
