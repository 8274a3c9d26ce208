"""Findings on what was recorded: ranges and steps of sensors, contacts, planes, and channels that are late."""

from dataclasses import replace
from types import SimpleNamespace

import driven_arm
import numpy as np
import pytest
import sagittal_walker
import slow_pendulum
from coded import coded
from mechanisms import by_joint, sines
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, faulty, leaning, wrench_of
from scipy import signal
from slow_pendulum import recorded

import ident
import scenes
import sim
from ident.estimation.preparation import prepared
from ident.judgement import unmodelled
from ident.judgement.checks import ContactCheck
from ident.judgement.model_fit import DelayCheck, delay_check
from ident.judgement.recording_findings import delay_findings
from ident.judgement.unmodelled import unmeasured_contacts
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor


def with_wrench(recording, change):
    return angles_and_wrench(recording.time, recording.of_joints(JOINTS, "position"), change(wrench_of(recording)))


def test_a_clipped_force_is_named_and_left_out_where_it_is():
    limit = np.quantile(wrench_of(faulty())[:, 2], 0.9)
    clipped = with_wrench(faulty(), lambda wrench: np.where(np.arange(6) == 2, np.minimum(wrench, limit), wrench))
    estimate = ident.identify(PENDULUM, clipped)
    (finding,) = coded(estimate, "clipped_channel")
    values = finding.values
    assert (values["channel"], values["limits"], values["unit"]) == ("Fz", (limit,), "N")
    assert values["share"] == pytest.approx(0.1, abs=0.01) and values["kept"] and values["log"] is None
    assert not finding.doubt and finding.place.channels == ("Fz",)
    assert not estimate.setup and estimate.verdict().usable
    assert abs(estimate.psi[0] - TRUTH[0]) < 1.96 * estimate.std[0]
    assert (abs(estimate.psi - TRUTH) < 4 * estimate.std_setup).all()
    assert estimate.checks.weight.measured == pytest.approx(PENDULUM.mass, rel=0.005)


@pytest.mark.parametrize("steps", [{}, {"forces": 3.0, "moments": 0.3}])
def test_nothing_is_clipped_where_ranges_are_large_enough(steps):
    for seed in range(2):
        assert not prepared(PENDULUM, recorded(seed, speed=1, noise=1, **steps)).clipped


def test_steps_that_are_most_of_the_noise_are_named():
    coarse = recorded(speed=1, forces=3, moments=0.3, angles=2 * np.pi / 4096, jitter=0, noise=0.2)
    fine = recorded(speed=1, forces=0.1, moments=0.01, angles=1e-4, noise=1)
    estimates = (ident.identify(PENDULUM, each, setup=driven_arm.EXACT) for each in (coarse, fine))
    (finding,), none = (coded(each, "coarse_steps") for each in estimates)
    assert not finding.doubt and not none
    steps = {each["name"]: (pytest.approx(each["step"], rel=1e-3), each["unit"]) for each in finding.values["steps"]}
    angle = 2 * np.pi / 4096, "rad"
    wanted = {"Fy": (3, "N"), "Fz": (3, "N"), "Mx": (0.3, "N m"), "joint1": angle, "joint2": angle}
    assert {name: steps[name] for name in wanted} == wanted


FORCE = 10, 0, 60
WEIGHT = PENDULUM.mass * 9.81


@pytest.mark.parametrize(("spans", "heavier"), [([(2, 3), (6, 9)], 0.8), ([(0.5, 6)], 1.25)])
def test_they_are_found_where_they_are(spans, heavier):
    model = replace(PENDULUM, prior=heavier * PENDULUM.known)
    contacts = unmeasured_contacts(prepared(model, leaning(spans, FORCE)))
    assert len(contacts) == len(spans)
    for contact, (first, last) in zip(contacts, spans, strict=True):
        assert first - 0.2 < contact.start <= first + 0.03 and last - 0.03 <= contact.end < last + 0.21
        np.testing.assert_allclose(contact.carries, FORCE[2] / WEIGHT, atol=0.05)
        assert contact.body == "link2"


def test_a_body_is_named_whose_forces_explain_the_moment_or_pass_near(monkeypatch):
    log = prepared(PENDULUM, leaning([(1, 2.5)], FORCE))
    for explained, distance, body in ((0.81, 1, "link2"), (0.79, 0.11, "link2"), (0.79, 0.13, None)):
        check = ContactCheck("link2", np.zeros(3), explained, distance)
        monkeypatch.setattr(unmodelled, "check_contact", lambda *_, check=check: check)
        assert unmodelled._body(log, slice(0, 50), np.ones((50, 6))) == body
        assert unmodelled._body(log, slice(0, 50), np.where(np.arange(6) == 5, np.nan, np.ones((50, 6)))) is None


def on_a_deep_plate(seed, noise, push):
    """Findings of a contact left out, with a plate 0.45 m below the base and a force (N) that pushes on its origin.

    Half of the noise (N, of moments a tenth in N m) wanders.
    """
    rng, below, t = np.random.default_rng(seed), np.array([0.02, -0.03, -0.45]), slow_pendulum.TIME
    states = slow_pendulum.motion(rng, 0.5)
    wrench = ident.base_wrench_regressor(PENDULUM.tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    moment = wrench[:, 3:] - np.cross(below, wrench[:, :3])
    pushed = push * np.sin(np.outer(t, [1.3, 2.1, 2.8]) + rng.uniform(0, 6, 3))
    white, drawn = rng.normal(size=(2, *wrench.shape))
    wanders = signal.sosfiltfilt(signal.butter(2, 1, fs=100, output="sos"), drawn, axis=0)
    felt = np.hstack([wrench[:, :3] - pushed, moment])
    felt += noise * np.repeat([1, 0.1], 3) * (white + wanders / wanders.std())
    q, pose = states[0] + 2e-4 * rng.normal(size=states[0].shape), np.eye(4)
    pose[:3, 3] = below
    recording = angles_and_wrench(t, q, felt, sensors={"ground": ident.Sensor(None, pose)})
    return coded(ident.identify(PENDULUM, recording, **QUICK), "contact_left_out")


def test_noise_of_a_plate_away_from_the_base_is_no_contact_and_a_force_on_it_is():
    assert not any(on_a_deep_plate(seed, 3, 0) for seed in range(6))
    found = [on_a_deep_plate(seed, 0.5, 10) for seed in range(6)]
    assert all(found) and all(finding.doubt for (finding,) in found)
    assert {finding.values["body"] for (finding,) in found} == {"base"}
    np.testing.assert_allclose([finding.values["point"] for (finding,) in found], [[0.02, -0.03, -0.45]] * 6, atol=0.05)


def test_nothing_is_found_where_the_weight_is_not_measured():
    level = with_wrench(leaning([(1, 2.5)], FORCE), lambda wrench: np.where(np.arange(6) == 2, np.nan, wrench))
    assert not unmeasured_contacts(prepared(PENDULUM, level))


def test_nothing_is_found_where_a_recording_begins_or_ends_in_motion():
    """Fast motion for 8 s, with angles that are noisy for it."""
    arm, rng = sim.mechanism(scenes.load("arm"), base="base"), np.random.default_rng((3, 5))
    t, drawn = np.arange(800) / 100, (len(arm.tree.joints), 4)
    rate = 2 * np.pi * 1.6 * np.array([0.15, 0.31, 0.52, 0.78]) * rng.uniform(0.9, 1.1, drawn)
    size = np.array([0.5, 0.38, 0.26, 0.16]) * rng.uniform(0.3, 1, drawn)
    states = sines(t, size, rate, rng.uniform(0, 2 * np.pi, drawn))
    wrench = ident.base_wrench_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known
    wrench += np.repeat([0.5, 0.05], 3) * rng.normal(size=wrench.shape)
    angles = by_joint(arm.tree.joints, position=states[0] + 1e-3 * rng.normal(size=states[0].shape))
    recording = ident.Recording(t, angles | {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})
    assert not unmeasured_contacts(prepared(arm, recording))


QUICK = {"estimator": "weighted", "cutoff": 8.0}


def test_what_the_model_cannot_explain_is_named_with_the_option_that_leaves_it_out():
    person = sagittal_walker.mechanism()
    estimate = ident.identify(person, sagittal_walker.recording(300), **QUICK)
    (finding,) = coded(estimate, "out_of_plane")
    assert not finding.doubt and finding.values == {"normal": "z", "channels": sagittal_walker.SIDEWAYS}
    assert finding.place.channels == sagittal_walker.SIDEWAYS and "--leave-out Fz Mx My" in finding.text
    assert set(estimate.verdict().predicted) == set(estimate.channels) - set(sagittal_walker.SIDEWAYS)


@pytest.mark.slow
def test_without_it_the_estimate_is_right_usable_and_the_same_however_she_sways():
    person, left_out = sagittal_walker.mechanism(), sagittal_walker.SIDEWAYS
    recordings = (sagittal_walker.recording(sway=sway) for sway in (1.0, 0.0))
    without, upright = (ident.identify(person, recording, leave_out=left_out) for recording in recordings)
    assert without.channels == ("Fx", "Fy", "Mz") and not coded(without, "out_of_plane")
    assert without.verdict().usable and without.held_out.ratio.max() < 0.1
    z = (without.psi - without.base.regroup(person.known)) / without.std
    assert len(z) == 16 and np.sqrt(np.mean(z**2)) < 1.5 and np.abs(z).max() < 4
    np.testing.assert_allclose(without.psi, upright.psi, rtol=1e-6)
    np.testing.assert_allclose(without.std, upright.std, rtol=1e-4)
    assert "Left out, as asked for: Fz, Mx, My." in without.prepared.notes


def test_signs_of_plates_are_still_held_against_the_model():
    person, recording = sagittal_walker.mechanism(), sagittal_walker.recording(300)
    values = {name: -x if name in ("right_force", "right_torque") else x for name, x in recording.measured.items()}
    turned = ident.Recording(recording.time, values, sensors=recording.sensors, held=False)
    estimate = ident.identify(person, turned, leave_out=sagittal_walker.SIDEWAYS, **QUICK)
    (finding,) = coded(estimate, "wrench_sign_or_axes")
    assert finding.values["opposite"] and finding.values["frame"] == "as stated"
    assert finding.place.wrenches == ("right",) and not estimate.verdict().usable


ARM = driven_arm.mechanism(**driven_arm.NONE)


def late(kind, delay, rate, sign=1):
    """Check of angles, and torques or a base wrench that are late, of another arm than the model's, with noise."""
    rng, every = np.random.default_rng(4), 1000
    t, *states = driven_arm.motion(rng, 40.0, every)
    at, then = (np.arange(every, len(t) - every, every // rate) - round(shift * every) for shift in (0, delay))
    function = joint_torque_regressor if kind == "torque" else base_wrench_regressor
    channels = function(ARM.tree, *(x[then] for x in states), gravity=ARM.gravity) @ ARM.known
    channels = sign * (1.2 * channels + 0.02 * channels.std(axis=0) * rng.normal(size=channels.shape))
    named = by_joint(ARM.tree.joints, position=states[0][at])
    if kind == "torque":
        named |= by_joint(ARM.tree.joints, torque=channels)
    else:
        named |= {"ground_force": channels[:, :3], "ground_torque": channels[:, 3:]}
    return delay_check(prepared(ARM, ident.Recording(t[at], named), filters=False))


@pytest.mark.parametrize(("of", "kind"), [("torques", "torque_delay"), ("wrench", "delay")])
def test_a_delay_beside_that_of_the_estimate_is_added_to_it(of, kind):
    check = DelayCheck(of, 0.3, 0.01, 0.8, 0.1, suspicious=True)
    setup = [SimpleNamespace(kind=each, value=value) for each, value in ((kind, 0.04), ("lag", 0.5))]
    (finding,) = delay_findings(SimpleNamespace(checks=SimpleNamespace(delay=check), setup=setup))
    assert finding.values["delay"] == pytest.approx(0.34)


@pytest.mark.parametrize("kind", ["torque", "wrench"])
def test_a_long_delay_has_a_value_and_a_deviation_and_an_opposite_sign_is_none(kind):
    for delay, rate in ((0.35, 10), (0.5, 10), (-0.3, 20), (0.2, 100)):
        check = late(kind, delay, rate)
        assert check.suspicious and check.of.startswith(kind)
        assert abs(check.delay - delay) < max(4 * check.std, 0.005) and check.std < 0.03
    assert not any(late(kind, 0, 20, sign).suspicious for sign in (1, -1))
