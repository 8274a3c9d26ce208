import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import scenes
from ident.errors import ModelError
from ident.model.regressor import base_wrench_regressor
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, tree_from_model
from sim.motion.excitation import DOUBLE_PENDULUM, Trapezoids
from sim.simulation.readings import sensors
from sim.simulation.simulate import RATE, simulate


@pytest.fixture(scope="module")
def spec():
    return scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120)


@pytest.fixture(scope="module")
def recording(spec):
    return simulate(spec, DOUBLE_PENDULUM, seed=1)


def test_servos_track_the_excitation(recording):
    assert recording.provenance["tracking_error_rad"] < 0.0003
    excitation_rng, _ = np.random.default_rng(1).spawn(2)
    q, _, _ = DOUBLE_PENDULUM.trajectory(recording.time, excitation_rng)
    measured = recording.noise_free.joint_states(["joint1", "joint2"])[0]
    assert abs(measured - q).max() == pytest.approx(recording.provenance["tracking_error_rad"])


def test_all_channels_are_of_the_same_instant(spec, recording):
    model = spec.compile()
    truth = recording.noise_free
    states = truth.joint_states(["joint1", "joint2"])
    tree, phi = tree_from_model(model, "base"), parameters_from_model(model, "base")
    wrench = base_wrench_regressor(tree, *states, gravity=gravity_in_base(model, "base")) @ phi
    np.testing.assert_allclose(truth.wrench("ground").values, wrench, atol=1e-11 * abs(wrench).max())
    np.testing.assert_allclose(truth.poses("link2"), tree.poses(states[0])[:, 2], atol=1e-13)


def test_accelerations_are_rates_of_velocities(recording):
    # Without a one-step shift central differences agree to their own error, with it they would not (jerk 16 rad/s³).
    _, dq, ddq = recording.noise_free.joint_states(["joint1", "joint2"])
    central = (dq[2:] - dq[:-2]) * RATE / 2
    assert np.median(abs(central - ddq[1:-1])) < 0.02 < np.median(abs(central - ddq[2:]))


def test_noise_has_the_declared_levels_and_is_white(spec, recording):
    declared = {s.name: s.noise for s in sensors(spec.compile())}
    assert dict(recording.noise) == declared
    for name, std in declared.items():
        if name.endswith("_orientation"):
            true, measured = (Rotation.from_quat(x[name], scalar_first=True) for x in (recording.true, recording))
            noise = (true.inv() * measured).as_rotvec()
        else:
            noise = recording[name] - recording.true[name]
        assert np.isclose(noise.std(), std, rtol=0.1), name
        flat = noise.reshape(len(noise), -1)
        correlation = np.mean(flat[1:] * flat[:-1]) / std**2
        assert abs(correlation) < 4 / np.sqrt(flat[1:].size), name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"samples": 0}, "needs 1 to 1000000 samples, got 0"),
        ({"noise_scale": -1}, "from 0 to 1000, got -1"),
        ({"noise_scale": np.nan}, "from 0 to 1000, got nan"),
    ],
)
def test_senseless_arguments_are_refused(spec, arguments, message):
    with pytest.raises(ValueError, match=message):
        simulate(spec, DOUBLE_PENDULUM, **arguments)


def test_an_arm_follows_moves_at_another_rate():
    spec, moves = scenes.load("arm"), Trapezoids.drawn(np.random.default_rng(0), 4, 2)
    slow, fast = (simulate(spec, moves, samples=round(2 * rate), rate=rate, noise_scale=0) for rate in (100, 500))
    assert fast.rate == pytest.approx(500) and fast.provenance["rate_hz"] == 500
    assert fast.provenance["tracking_error_rad"] < 0.01
    for channel in ("elbow_position", "elbow_torque", "ground_force"):
        np.testing.assert_array_equal(fast[channel][::5], slow[channel])
    assert fast.units["elbow_torque"] == "N m"
    with pytest.raises(ModelError, match="must divide"):
        simulate(spec, moves, samples=10, rate=300)
