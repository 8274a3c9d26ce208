"""Channels that a verdict does not count: noise, joints at rest, and what the model does not change."""

from types import SimpleNamespace

import driven_arm
import numpy as np

from ident.judgement.residuals import idle_channels, still_channels
from ident.mechanism.motion import Motion


def idle(size, rough, ratio, *, still=False):
    """Reasons of the arm's torques, whose first joint moves by a size, with rough or smooth residuals."""
    rng, t = np.random.default_rng(0), np.arange(1000) / 100
    q = np.sin(np.outer(t, [1.0, 1.3, 1.7])) * [size / 2, 1, 1]
    residual = np.where(rough, rng.normal(size=q.shape), np.sqrt(2) * np.sin(np.outer(t, [2.0, 3.0, 4.0])))
    equations = SimpleNamespace(channels=driven_arm.JOINTS, torques=(0, 1, 2))
    held = SimpleNamespace(
        fit=SimpleNamespace(equations=equations),
        samples=SimpleNamespace(motion=Motion(q, 0 * q, 0 * q), measured=q),
        residual=residual,
        starts=(0, 500),
        rms=np.sqrt((residual**2).mean(axis=0)),
        ratio=np.array(ratio),
    )
    recording = SimpleNamespace(still=still)
    return idle_channels(held, SimpleNamespace(mechanism=driven_arm.mechanism(), frame=np.eye(4), recording=recording))


def test_a_torque_of_a_joint_at_rest_and_one_of_noise_do_not_count():
    assert idle(1e-3, [False, False, True], [0.95, 0.95, 0.95]) == {"turn": "rest", "bend": "noise"}
    assert idle(1.0, [False, True, True], [0.95, 0.95, 0.4]) == {"lift": "noise"}
    assert not idle(1.0, [False, True, True], [0.95, 0.95, 0.4], still=True)


def test_a_component_that_the_model_does_not_change_is_of_a_wrench():
    changes = {"Fx": 1e-9, "Fy": 5.0, "Fz": 8.0, "Mx": 0.2, "My": 1e-5, "Mz": 0.0}
    assert set(still_channels(changes)) == {"Fx", "My", "Mz"} and still_channels({"Fz": 0.0}) == {"Fz": "still"}
