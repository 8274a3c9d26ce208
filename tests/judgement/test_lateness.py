"""Delays of channels behind the joint angles that no estimator searches for."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest

import ident
from ident.estimation.preparation import prepared
from ident.judgement.model_fit import delay_check
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor

ARM = driven_arm.mechanism(**driven_arm.NONE)


def recording(kind, delay, rate, seconds=40.0):
    """Angles, and torques or a base wrench that are late, of another arm than the model's, with noise."""
    rng, every = np.random.default_rng(4), 1000
    t, *states = driven_arm.motion(rng, seconds, every)
    at, late = (np.arange(every, len(t) - every, every // rate) - round(shift * every) for shift in (0, delay))
    function = joint_torque_regressor if kind == "torque" else base_wrench_regressor
    channels = function(ARM.tree, *(x[late] for x in states), gravity=ARM.gravity) @ ARM.known
    channels = 1.2 * channels + 0.02 * channels.std(axis=0) * rng.normal(size=channels.shape)
    named = {f"{joint}_position": x for joint, x in zip(ARM.tree.joints, states[0][at].T, strict=True)}
    if kind == "torque":
        named |= {f"{joint}_torque": x for joint, x in zip(ARM.tree.joints, channels.T, strict=True)}
    else:
        named |= {"ground_force": channels[:, :3], "ground_torque": channels[:, 3:]}
    return ident.Recording(t[at], named)


@pytest.mark.parametrize("kind", ["torque", "wrench"])
@pytest.mark.parametrize(("delay", "rate"), [(0.35, 10), (0.5, 10), (-0.3, 20), (0.2, 100)])
def test_a_long_delay_has_a_value_and_a_deviation(kind, delay, rate):
    check = delay_check(prepared(ARM, recording(kind, delay, rate), filters=False))
    assert check.suspicious and check.of.startswith(kind)
    assert abs(check.delay - delay) < max(4 * check.std, 0.005) and check.std < 0.03


@pytest.mark.parametrize("kind", ["torque", "wrench"])
def test_channels_in_time_or_of_the_opposite_sign_are_not_late(kind):
    log = recording(kind, 0, 20)
    for sign in (1, -1):
        measured = {name: x if "position" in name else sign * x for name, x in log.measured.items()}
        assert not delay_check(prepared(ARM, replace(log, measured=measured), filters=False)).suspicious
