"""Left-out channels of equations, estimate and verdict, with a moving base, a ground, and torques."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import walker

import ident
import scenes
import sim
from ident.estimation.preparation import prepared
from ident.recordings.wrench import transform_wrench
from sim.motion.excitation import DOUBLE_PENDULUM


def posed(sway):
    """A person with a measured pelvis pose, on a plate and a rail whose readings sway about their own x."""
    rng, (time, q, *_) = np.random.default_rng(0), walker.motion()
    total, places = walker.truth(walker.SMALL)
    poses, share = places["pelvis"].copy(), 0.2 + 0.1 * np.sin(3 * time)
    felt = walker.in_frame(poses, total)
    felt[:, 3] += sway * 30 * np.sin(5 * time)
    total = transform_wrench(poses, felt)
    measured = {"shoulder_position": q[:, 6] + 0.002 * rng.normal(size=len(q))}
    for name, taken in (("plate", 1 - share), ("rail", share)):
        values = taken[:, None] * total + rng.normal(size=total.shape) * [1, 1, 1, 0.3, 0.3, 0.3]
        measured |= {f"{name}_force": values[:, :3], f"{name}_torque": values[:, 3:]}
    sensors = {name: ident.Sensor(body, frame="world") for name, body in (("plate", "pelvis"), ("rail", "arm"))}
    poses[:, :3, 3] += 0.001 * rng.normal(size=(len(q), 3))
    return ident.Recording(time, measured, sensors=sensors, base=poses)


@pytest.mark.slow
def test_without_a_ground_a_component_is_left_out_in_the_axes_of_the_base():
    person = sim.mechanism(mujoco.MjSpec.from_string(walker.SMALL), base="pelvis")
    upright, swaying = (ident.identify(person, posed(sway), leave_out=["Mx"]) for sway in (0, 1))
    assert swaying.channels == ("Fx", "Fy", "Fz", "My", "Mz")
    np.testing.assert_allclose(swaying.psi, upright.psi, atol=1e-4 * upright.std.min())
    np.testing.assert_allclose(swaying.held_out.ratio, upright.held_out.ratio, rtol=0.01)
    assert upright.held_out.ratio.max() < 0.25
    z = (swaying.psi - swaying.base.regroup(person.known)) / swaying.std
    assert np.sqrt(np.mean(z**2)) < 1.5


@pytest.fixture(scope="module")
def pendulum():
    spec = scenes.load("double_pendulum")
    return sim.mechanism(spec, base="base"), sim.simulate(spec, DOUBLE_PENDULUM)


@pytest.mark.parametrize("estimator", ["trajectory", "ordinary"])
def test_of_a_ground_what_is_left_out_is_as_good_as_not_measured(pendulum, estimator):
    arm, recording = pendulum
    out = {"ground_force": [False, False, True], "ground_torque": [True, False, False]}
    lacking = {name: np.where(gone, np.nan, recording.measured[name]) for name, gone in out.items()}
    missing = replace(recording, measured={**recording.measured, **lacking}, true={})
    dead = {name: np.where(gone, 1e3, recording.measured[name]) for name, gone in out.items()}
    dead["ground_force"][::2, 2] *= -1
    wrong = replace(recording, measured={**recording.measured, **dead}, true={})
    expected = ident.identify(arm, missing, estimator=estimator)
    own = ident.identify(arm, wrong, estimator=estimator, leave_out=("Fz", "Mx"))
    assert own.channels == expected.channels == ("Fx", "Fy", "My", "Mz")
    np.testing.assert_array_equal(own.psi, expected.psi)
    assert [each.text for each in own.findings] == [each.text for each in expected.findings]


def test_torques_are_left_out_by_their_joints(pendulum):
    arm, recording = pendulum
    torques = {f"{joint}_torque": np.sin(recording.time) for joint in arm.joints}
    both = replace(recording, measured={**recording.measured, **torques}, true={})
    ready = prepared(arm, both, leave_out=[arm.joints[0], "Mz"])
    assert ready.equations.channels == ("Fx", "Fy", "Fz", "Mx", "My", arm.joints[1])
    assert ready.samples.measured.shape[1] == 6 and np.isnan(ready.wrench[:, 5]).all()
    rest = ("Fx", "Fy", "Fz", "Mx", "My", "Mz", *arm.joints)
    with pytest.raises(ident.LogError, match="has nothing to fit: all that it measures is left out, Fx, "):
        prepared(arm, both, leave_out=rest)
    with pytest.raises(ident.InputError, match=f"leave_out needs a list out of {', '.join(rest)}; got Fq"):
        prepared(arm, both, leave_out=["Fq"])
