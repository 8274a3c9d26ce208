"""Priors, and friction and offsets of each recording's own, where left-out pieces ask for them."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
from coded import coded
from driven_arm import JOINTS
from recorded_faults import PENDULUM, faulty, shortened

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


def second(share, offset):
    """Another log of the driven arm with a share of its friction and offsets of its torques, N m."""
    log = driven_arm.log(seed=1)
    _, _, rate, _ = driven_arm.motion(np.random.default_rng(1))
    more = (share - 1) * FRICTION * np.tanh(rate / 0.003) + offset
    torques = {f"{j}_torque": log.measured[f"{j}_torque"] + x for j, x in zip(JOINTS, more.T, strict=True)}
    return replace(log, measured={**log.measured, **torques})


def test_friction_and_offsets_that_differ_are_each_logs_own():
    share, offset = 1.5, 0.3
    estimate = ident.identify(driven_arm.mechanism(), [driven_arm.log(), second(share, offset)])
    first, other = (estimate.trajectory.parameters_of(k) for k in (0, 1))
    at = [estimate.fit.names.index(f"Fc({joint})") for joint in JOINTS]
    np.testing.assert_allclose(first[at], FRICTION, rtol=0.03)
    np.testing.assert_allclose(other[at], share * FRICTION, rtol=0.03)
    at = [estimate.fit.names.index(f"offset({joint})") for joint in JOINTS]
    np.testing.assert_allclose(other[at] - first[at], offset, atol=0.01)
    mean = estimate.trajectory.parameters_of(None)
    np.testing.assert_allclose(mean[: len(first)], (first + other) / 2, atol=1e-12)
    (finding,) = coded(estimate, "own_in_logs")
    assert set(finding.values["values"]) >= {f"Fc({joint})" for joint in JOINTS}


@pytest.mark.slow
def test_another_log_is_predicted_with_the_mean():
    """Of two logs with more and with less friction, the mean predicts a third one to its noise."""
    logs = [second(0.6, 0.0), second(1.4, 0.0)]
    estimate = ident.identify(driven_arm.mechanism(), logs, held_out=driven_arm.log(seed=2))
    assert coded(estimate, "own_in_logs") and (estimate.held_out.ratio < 0.03).all()
