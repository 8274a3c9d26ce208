"""The held-out part is predicted from angles alone nearly as well as the true parameters allow."""

import lifting
import numpy as np
import pytest
import swinging

import ident
from ident.model.regressor import base_wrench_regressor
from ident.regression.held_out import picked
from ident.trajectory.angles_alone import smoothed
from ident.trajectory.pieces import coordinates

CONSTANTS = np.geomspace(0.005, 0.4, 40)


def pendulum(angle, rate, monkeypatch):
    """An estimate, the truth, the held-out recording with its times and true motion, and the wrench's noise."""
    noise = {"joint1_position": angle, "joint2_position": angle, "ground_force": 0.5, "ground_torque": 0.05}
    monkeypatch.setattr(swinging, "NOISE", noise)
    streams = swinging.streams(np.random.default_rng(0), angles=rate, wrench=rate)
    recording = ident.Recording.from_streams(streams)
    estimate = ident.identify(swinging.pendulum(), recording)
    when = estimate.held_out.time
    return estimate, swinging.pendulum(), recording, when, swinging.motion(when), np.repeat([0.5, 0.05], 3)


def lifter():
    """The same for lifting, judged by another lift; angles are fitted to markers on moving skin."""
    who, lows = lifting.lifter(0), (lifting.SQUAT, lifting.STOOP)
    logs = [lifting.recorded(who, low, 0.3, seed, seconds=8, skin=0.004) for seed, low in enumerate(lows)]
    judge = lifting.recorded(who, lifting.SQUAT, 0.35, 7, seconds=8, skin=0.004)
    estimate = ident.identify(lifting.table(), logs, known=True, held_out=judge)
    when = estimate.held_out.time - lifting.LATE
    motion = lifting.motion(when, lifting.SQUAT, 0.35, 7)
    return estimate, who, judge, when, motion, lifting.FORCE * np.array([1, 1, 0.2])


def errors(estimate, arm, recording, when, motion, channels):
    """Errors of the channels due to smoothing, for each constant and for those chosen by channel."""

    def wrench(states):
        return (base_wrench_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known)[:, channels]

    angles, exact = coordinates(recording, arm.tree.joints), wrench(motion.states)
    every = [wrench(smoothed(angles, T).evaluate(when)[:3]) - exact for T in CONSTANTS]
    held = estimate.held_out
    each = np.stack([wrench(version.motion.states) for version in held.versions])
    return every, picked(each, held.chosen) - exact


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "rate"), [(1e-4, 100), (5e-3, 100), (1e-3, 500), (1e-5, 12)])
def test_a_pendulum_is_judged_by_a_motion_as_good_as_its_angles(angle, rate, monkeypatch):
    check(*pendulum(angle, rate, monkeypatch), range(6))


def check(estimate, arm, recording, when, motion, noise, channels):
    """Compares residuals of the true parameters with the noise, and with residuals for other smoothing constants."""
    rms = np.sqrt((estimate.held_out.residual_with(estimate.base.regroup(arm.known)) ** 2).mean(axis=0)) / noise
    every, chosen = errors(estimate, arm, recording, when, motion, list(channels))
    every, chosen = (np.sqrt(1 + (np.array(x) ** 2).mean(axis=-2) / noise**2) for x in (every, chosen))
    assert (rms < 1.2 * chosen).all()
    assert np.exp(np.log(chosen).mean()) < 1.1 * np.exp(np.log(every).mean(axis=1)).min()
