"""Several recordings: noise, knots, friction and offsets of their own."""

from dataclasses import replace
from functools import cache

import driven_arm
import numpy as np
import pytest
import swinging
from coded import coded
from driven_arm import JOINTS
from recorded_faults import PENDULUM, faulty, shortened
from swinging import NOISE

import ident
from ident.estimation.preparation import Part, prepared
from ident.trajectory.trajectory_estimate import trajectory_estimate

KNOWN = {"mass": 0.2, "center": 0.05, "inertia": 0.3}
FRICTION = np.array(driven_arm.TRUE["frictionloss"])


@pytest.mark.parametrize(("samples", "used"), [(60, True), (1000, False)])
def test_a_model_is_a_prior_of_recordings_too_short_to_determine_the_bodies(samples, used):
    log = prepared(PENDULUM, shortened(faulty(0), samples), cutoff=10.0)
    estimate = trajectory_estimate([Part(log, slice(0, len(log.samples)))], log.equations, search=False, fallback=KNOWN)
    assert estimate.known == used
    if used:
        without, with_prior = np.log(estimate.errors["prior"]).mean(axis=1)
        assert with_prior < without - 0.2


def changed(seed, share, offset):
    """A log of the driven arm with a share of its friction and offsets of its torques, N m."""
    log = driven_arm.log(seed=seed)
    _, _, rate, _ = driven_arm.motion(np.random.default_rng(seed))
    more = (share - 1) * FRICTION * np.tanh(rate / 0.003) + offset
    torques = {f"{j}_torque": log.measured[f"{j}_torque"] + x for j, x in zip(JOINTS, more.T, strict=True)}
    return replace(log, measured={**log.measured, **torques})


def test_friction_and_offsets_that_differ_are_each_logs_own():
    """Of two logs with more and with less, the mean predicts a third one to its noise."""
    logs = [changed(0, 0.6, -0.15), changed(1, 1.4, 0.15)]
    estimate = ident.identify(driven_arm.mechanism(), logs, held_out=driven_arm.log(seed=2))
    first, other = (estimate.trajectory.parameters_of(k) for k in (0, 1))
    at = [estimate.fit.names.index(f"Fc({joint})") for joint in JOINTS]
    np.testing.assert_allclose(first[at], 0.6 * FRICTION, rtol=0.03)
    np.testing.assert_allclose(other[at], 1.4 * FRICTION, rtol=0.03)
    at = [estimate.fit.names.index(f"offset({joint})") for joint in JOINTS]
    np.testing.assert_allclose(other[at] - first[at], 0.3, atol=0.01)
    mean = estimate.trajectory.parameters_of(None)
    np.testing.assert_allclose(mean[: len(first)], (first + other) / 2, atol=1e-12)
    (finding,) = coded(estimate, "own_in_logs")
    assert set(finding.values["values"]) >= {f"Fc({joint})" for joint in JOINTS}
    assert (estimate.held_out.ratio < 0.03).all()


LOUDER = 8.0  # Noise of the second recording's wrench over that of the first.


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
    logs = [driven_arm.log(6.0, pace=pace) for pace in (1.0, 4.0)]
    steps = ident.identify(driven_arm.mechanism(), [logs[k] for k in order]).trajectory.steps
    slow, fast = (steps[k] for k in np.argsort(order))
    assert 2.5 * fast < slow
