from dataclasses import replace

import numpy as np
import pytest

from sim.motion.excitation import DOUBLE_PENDULUM, Excitation

TIME = np.arange(943) / 100


def test_motion_stays_within_a_ur5s_speed_and_the_scenes_limits():
    q, dq, _ = DOUBLE_PENDULUM.trajectory(TIME)
    np.testing.assert_allclose([q[:, 0].min(), q[:, 1].max()], [-1.89, 1.90], atol=0.01)
    assert 2.2 < abs(dq).max() < 2.3


def test_noise_is_held_and_integrated_exactly():
    rng_state = np.random.default_rng(3)
    excitation = replace(DOUBLE_PENDULUM, noise=0.5)
    fine = np.arange(0, 1000) / 1000
    clean = np.array(DOUBLE_PENDULUM.trajectory(fine))
    q, dq, ddq = np.array(excitation.trajectory(fine, rng_state)) - clean
    held = ddq.reshape(100, 10, 2)
    np.testing.assert_allclose(held, held[:, :1] + np.zeros((1, 10, 1)), atol=1e-12)
    assert np.isclose(held[:, 0].std(), 0.5, rtol=0.2)
    h = 1e-3
    np.testing.assert_allclose(np.diff(dq, axis=0), h * ddq[:-1], atol=1e-12)
    np.testing.assert_allclose(np.diff(q, axis=0), h * dq[:-1] + h**2 / 2 * ddq[:-1], atol=1e-12)
    assert not dq[0].any() and not q[0].any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"offset": [0.0]}, r"shapes \(1,\), \(2, 2\)"),
        ({"phase": [[0.0], [0.0]]}, r"and \(2, 1\)"),
        ({"frequency": [[0.0, 1], [1, 1]]}, "positive frequencies"),
        ({"noise": -1.0}, "zero or more, got -1.0"),
        ({"noise": np.nan}, "zero or more"),
    ],
)
def test_bad_excitations_are_refused(change, message):
    good = {name: getattr(DOUBLE_PENDULUM, name) for name in ("offset", "amplitude", "frequency", "phase", "noise")}
    with pytest.raises(ValueError, match=message):
        Excitation(**(good | change))
