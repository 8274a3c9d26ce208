"""Friction near reversals: its law from residuals, and arms with friction."""

import numpy as np
import pytest
from coded import coded

import ident
import scenes
from docs.tools.noise.conditions import CONDITIONS, drives, truth
from docs.tools.noise.recordings import SUBJECTS, noisy_recording, true_bodies
from ident.trajectory.reversals import _law


def rubbing(rng, slip, *, stuck=0.0, samples=4000):
    """Velocities, and torques with friction of 2 N m that changes its sign over a slip; at rest it is random."""
    rate = np.sin(np.linspace(0, 60, samples)) * rng.uniform(0.3, 1, samples)
    torque = 2 * np.tanh(rate / slip) + 0.5 * rate + 0.02 * rng.normal(size=samples)
    return rate, torque + stuck * np.exp(-((rate / 0.025) ** 2) / 2) * rng.normal(size=samples)


@pytest.mark.parametrize("slip", [0.003, 0.1])
def test_the_slip_of_a_joint_is_found(slip):
    rate, torque = rubbing(np.random.default_rng(0), slip)
    law = _law(torque, rate)
    assert law.coulomb == pytest.approx(2, rel=0.05) and 0.5 * slip <= law.slip <= 2 * slip


@pytest.mark.slow
def test_an_arm_whose_joints_rub():
    """With wide knot spacing and correlated noise, friction would be a third of its value, with narrow intervals."""
    condition = CONDITIONS["rubs_trapezoids_100"]
    who, recording = SUBJECTS[condition.subject], noisy_recording(condition, 0, 0)
    estimate = ident.identify(who.mechanism, recording, **condition.options)
    stated = drives(who.mechanism, scenes.load("arm").compile())
    true = truth(estimate.fit.equations, true_bodies(condition, 0, 0), stated)
    names = estimate.fit.names[: len(true)]
    values = estimate.fit.values[: len(true)]
    z = (values - true) / estimate.fit.std[: len(true)]
    friction = [k for k, each in enumerate(names) if each.startswith("Fc(")]
    assert len(friction) == 4
    assert values[friction] == pytest.approx(true[friction], rel=0.02)
    assert (np.abs(z) < 1.96).mean() > 0.8 and not estimate.setup
    assert coded(estimate, "breakaway_friction")


@pytest.mark.slow
def test_a_drive_at_its_bound_has_a_one_sided_interval():
    """A parameter that noise makes negative gets an upper limit."""
    condition = CONDITIONS["rubs_sinusoids_200"]
    who, recording = SUBJECTS[condition.subject], noisy_recording(condition, 0, 0)
    estimate = ident.identify(who.mechanism, recording, drive=["rotor", "viscous", "coulomb", "stribeck"])
    limits = {name: limit for name, (limit, _) in estimate.bounded.items()}
    assert limits and all(name.startswith("Fs(") for name in limits)
    for name, limit in limits.items():
        k = estimate.fit.names.index(name)
        assert estimate.fit.values[k] == 0 and estimate.fit.std[k] > 0 and 0 < limit < 4 * estimate.fit.std[k]
    (finding,) = coded(estimate, "drive_at_bound")
    assert finding.values["at_most"] == limits
