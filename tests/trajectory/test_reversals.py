"""Friction near reversals and at low velocity."""

from dataclasses import replace

import driven_arm as arm
import mujoco
import numpy as np
import pytest
from coded import coded
from mechanisms import by_joint
from scipy.signal import savgol_filter

import ident
import scenes
import sim
from docs.tools.noise_conditions import CONDITIONS, drives, truth
from docs.tools.noise_recordings import SUBJECTS, noisy_recording, true_bodies
from ident.recordings.followers import with_servos
from ident.tolerances import STRIBECK
from ident.trajectory.reversals import _law


@pytest.mark.parametrize("slip", [0.003, 0.1])
def test_the_slip_of_a_joint_is_found(slip, samples=4000):
    """Of a joint with friction of 2 N m that changes its sign over it."""
    rng = np.random.default_rng(0)
    rate = np.sin(np.linspace(0, 60, samples)) * rng.uniform(0.3, 1, samples)
    law = _law(2 * np.tanh(rate / slip) + 0.5 * rate + 0.02 * rng.normal(size=samples), rate)
    assert law.coulomb == pytest.approx(2, rel=0.05) and 0.5 * slip <= law.slip <= 2 * slip


def test_the_slip_is_estimated_again_once_the_lag_of_servos_is_known():
    """While the lag is not fitted, the friction of the first joint seems to change its sign over .13 rad/s."""
    slip, lag, rate, fine = 0.1, 0.012, 100, 4000
    t, q, *_ = arm.motion(np.random.default_rng(1), 10.0, rate)
    later = np.round((t + 0.5 / rate + lag) * fine).astype(int)
    states = [x[later] for x in arm.motion(np.random.default_rng(1), 10.1, fine)[1:]]
    torque = arm.torques(*states) + np.array(arm.TRUE["frictionloss"]) * np.tanh(states[1] / slip)
    commands = states[0] + (torque + arm.KV * states[1]) / arm.KP
    channels = by_joint(arm.JOINTS, position=q + 1e-4 * np.random.default_rng(10).normal(size=q.shape))
    channels |= by_joint(arm.JOINTS, command=commands)
    model = sim.mechanism(mujoco.MjSpec.from_string(arm.text(more=arm.ACTUATORS)))
    estimate = ident.identify(model, with_servos(ident.Recording(t, channels), {}, model, []), known=False, holdout=0)
    (finding,) = coded(estimate, "setup_lag")
    assert finding.values["value"] == pytest.approx(lag, abs=1e-3)
    assert estimate.trajectory.reversals.slip == pytest.approx(slip, rel=0.15)


def recorded(name):
    """A condition whose joints rub, the arm, and its recording."""
    condition = CONDITIONS[name]
    return condition, SUBJECTS[condition.subject].mechanism, noisy_recording(condition, 0, 0)


def stated(mechanism):
    return drives(mechanism, scenes.load("arm").compile())


@pytest.mark.slow
def test_an_arm_whose_joints_rub():
    """With wide knot spacing and correlated noise, friction would be a third of its value, with narrow intervals."""
    condition, who, recording = recorded("rubs_trapezoids_100")
    estimate = ident.identify(who, recording, **condition.options)
    true = truth(estimate.fit.equations, true_bodies(condition, 0, 0), stated(who))
    values, std = (x[: len(true)] for x in (estimate.fit.values, estimate.fit.std))
    friction = [k for k, each in enumerate(estimate.fit.names[: len(true)]) if each.startswith("Fc(")]
    assert len(friction) == 4 and values[friction] == pytest.approx(true[friction], rel=0.02)
    assert (np.abs(values - true) < 1.96 * std).mean() > 0.8 and not estimate.setup
    assert coded(estimate, "breakaway_friction")
    # Friction that is higher at low velocity is not fitted where recordings do not ask for it.
    assert not any(name.startswith("Fs(") for name in estimate.fit.names)


@pytest.mark.slow
def test_a_drive_at_its_bound_has_a_one_sided_interval():
    """A parameter that noise makes negative gets an upper limit."""
    _, who, recording = recorded("rubs_sinusoids_200")
    estimate = ident.identify(who, recording, drive=["rotor", "viscous", "coulomb", "stribeck"])
    limits = {name: limit for name, (limit, _) in estimate.bounded.items()}
    assert limits and all(name.startswith("Fs(") for name in limits)
    for name, limit in limits.items():
        k = estimate.fit.names.index(name)
        assert estimate.fit.values[k] == 0 and estimate.fit.std[k] > 0 and 0 < limit < 4 * estimate.fit.std[k]
    (finding,) = coded(estimate, "drive_at_bound")
    assert finding.values["at_most"] == limits


@pytest.mark.slow
def test_friction_that_is_higher_at_low_velocity_is_fitted_where_recordings_ask_for_it():
    extra = {"shoulder": 1.0, "wrist": 0.15}
    (_, who, recording), torques = recorded("rubs_sinusoids_200"), {}
    for joint, size in extra.items():
        rate = savgol_filter(recording.measured[f"{joint}_position"], 9, 3, deriv=1, delta=1 / recording.rate)
        more = size * np.sign(rate) / (1 + (rate / STRIBECK) ** 2)
        torques[f"{joint}_torque"] = recording.measured[f"{joint}_torque"] + more
    recording = replace(recording, measured={**recording.measured, **torques})
    estimate = ident.identify(who, recording, known=False)
    values = dict(zip(estimate.fit.names, zip(estimate.fit.values, estimate.fit.std, strict=True), strict=True))
    true = {f"Fs({joint})": size for joint, size in extra.items()}
    assert {name for name in values if name.startswith("Fs(")} == set(true)
    for name, size in (true | stated(who)).items():
        if name.startswith(("Fs(", "Fc(")):
            value, std = values[name]
            assert abs(value - size) < 3 * std and std < 0.06 * size, name
    # Compared with least squares of the usual columns.
    assert len(estimate.filtered_values) == len(estimate.fit.names)
    assert all(estimate.filtered_values[estimate.fit.names.index(name)] == 0 for name in true)
    assert [set(each.place.joints) for each in coded(estimate, "low_velocity_friction")] == [set(extra)]
    assert set(estimate.drives_updated) >= set(extra)
