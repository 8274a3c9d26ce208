"""A ground wrench with a delay, or on another clock, beside joint torques on the angles' clock."""

from functools import cache

import numpy as np
import pytest
import swinging

import ident
from ident.model.regressor import joint_torque_regressor
from ident.recordings.recording import Recording

pytestmark = pytest.mark.slow

NOISE = np.repeat([0.5, 0.05], [3, 5])
"""Noise of the wrench, N and N m, and of the torques."""


def recorded(seed, late=0.0, fast=0.0):
    """The paper's pendulum; the wrench is delayed, and its clock is fast."""
    rng, arm, time = np.random.default_rng(seed), swinging.pendulum(), np.arange(0.3, 9.0, 0.01)
    motion, before = swinging.motion(time), swinging.motion(time - late - fast * (time - time[0]))
    wrench = ident.base_wrench_regressor(arm.tree, *before.states, gravity=arm.gravity) @ arm.known
    torques = joint_torque_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ arm.known
    measured = np.hstack([wrench, torques])
    measured += NOISE * rng.normal(size=measured.shape)
    angles = motion.q + 3e-4 * rng.normal(size=motion.q.shape)
    channels = {"ground_force": measured[:, :3], "ground_torque": measured[:, 3:6]}
    for k, joint in enumerate(swinging.JOINTS):
        channels |= {f"{joint}_position": angles[:, k], f"{joint}_torque": measured[:, 6 + k]}
    return Recording(time, channels)


@cache
def on_time():
    """Estimate of a wrench on the torques' clock."""
    return ident.identify(swinging.pendulum(), recorded(0), holdout=0)


@pytest.mark.parametrize(
    ("fault", "name", "value"),
    [
        ({"late": -0.008}, "delay(ground)", -0.008),
        ({"late": 0.12}, "delay(ground)", 0.12),
        ({"fast": 0.004}, "clock(ground)", -0.004),
    ],
)
def test_the_wrench_alone_is_late(fault, name, value):
    estimate = ident.identify(swinging.pendulum(), recorded(0, **fault), held_out=recorded(1, **fault))
    (finding,) = estimate.setup
    assert finding.name == name and abs(finding.value - value) < 1e-4 + 2 * finding.std < 5e-4
    np.testing.assert_allclose(estimate.trajectory.fit.channel_noise, NOISE, rtol=0.1)
    assert (np.abs(estimate.psi - on_time().psi) < 2 * estimate.std).all()
    # The delay does not affect predictions of other recordings' torques and wrenches.
    truth = estimate.base.regroup(swinging.pendulum().known)
    rms = np.sqrt((estimate.held_out.residual_with(truth) ** 2).mean(axis=0))
    assert (np.delete(rms / NOISE, 3) < 1.15).all()
