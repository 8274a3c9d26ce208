"""Unmeasured contacts: found by the weight that they carry, named, and left out."""

from dataclasses import replace
from types import SimpleNamespace

import lifting
import mujoco
import numpy as np
import pytest
from coded import coded
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, faulty, leaning, wrench_of

import ident
import sim
from ident.estimation.preparation import prepared
from ident.judgement import unmeasured
from ident.judgement.diagnosis import ContactCheck
from ident.judgement.unmeasured import unmeasured_contacts

FORCE = 10, 0, 60
WEIGHT = PENDULUM.mass * 9.81


@pytest.mark.parametrize(("spans", "heavier"), [([(1, 2.5)], 0.8), ([(2, 3), (6, 9)], 1), ([(0.5, 6)], 1.25)])
def test_they_are_found_where_they_are(spans, heavier):
    """Also with a model that is too light or too heavy."""
    model = replace(PENDULUM, prior=heavier * PENDULUM.known)
    contacts = unmeasured_contacts(prepared(model, leaning(spans, FORCE)))
    assert len(contacts) == len(spans)
    for contact, (first, last) in zip(contacts, spans, strict=True):
        assert first - 0.2 < contact.start <= first + 0.03 and last - 0.03 <= contact.end < last + 0.21
        np.testing.assert_allclose(contact.carries, FORCE[2] / WEIGHT, atol=0.05)
        assert contact.contact.body == "link2" and contact.contact.explained > 0.99
        np.testing.assert_allclose(contact.contact.point, (0, 0, 0.1), atol=0.05)


FAULTS = [
    {},
    {"delay": 0.12},
    {"fast": 0.005},
    {"origin": (0.05, 0, 0.05)},
    {"turn": (3, 3, 3)},
    {"gains": (1, 1, 1.1, 1, 1, 1)},
    {"zero": (3, 10)},
    {"gravity": 5.0},
]


@pytest.mark.parametrize("fault", FAULTS, ids=str)
def test_nothing_is_found_where_the_set_up_is_wrong_only(fault, seed=0):
    assert not unmeasured_contacts(prepared(PENDULUM, faulty(seed, **fault)))


@pytest.mark.parametrize("seed", [3, 6])
def test_nothing_is_found_where_the_low_pass_ends(seed):
    """Errors of accelerations at the last samples can amount to a third of the weight."""
    recording = lifting.recorded(lifting.lifter(seed), lifting.STOOP, 0.4, 10 * seed + 1)
    assert not unmeasured_contacts(prepared(lifting.table(), recording))


def test_spans_are_long_and_somewhere_above_the_limit():
    tail = unmeasured.TAIL
    missing = np.zeros(60)
    missing[3:8], missing[5] = 1.1 * tail, 1.1
    missing[20:24], missing[21] = 1.1 * tail, 1.1
    missing[40:50] = 0.99
    missing[57:], missing[58] = 1.1 * tail, 1.0
    assert unmeasured._spans(missing, 1.0, 5) == [(3, 8)]
    assert unmeasured._spans(missing, 1.0, 4) == [(3, 8), (20, 24)]
    assert unmeasured._spans(missing, 0.98, 3) == [(3, 8), (20, 24), (40, 50), (57, 60)]
    assert unmeasured._spans(10 * missing, 10.0, 5) == [(3, 8)]


def test_the_limit_is_above_what_scatters_and_what_is_in_excess():
    rng = np.random.default_rng(0)
    quiet, excess = 1e-3 * rng.normal(size=400), np.zeros(400)
    excess[7] = -5.0
    assert unmeasured._limit(quiet, 1.0) == 1.0
    assert unmeasured._limit(100 * quiet, 1e-9) == pytest.approx(unmeasured.ONE_SIDED * -100 * quiet.min())
    assert unmeasured._limit(excess, 1.0) == 5 * unmeasured.ONE_SIDED
    noisy = np.abs(rng.normal(size=400))
    assert unmeasured._limit(noisy, 2.0) == pytest.approx(max(2.0, unmeasured.SPREAD * noisy[noisy < 2].std()))


@pytest.mark.parametrize(("explained", "beside", "named"), [(0.85, 2.0, True), (0.5, 0.9, True), (0.75, 1.1, False)])
def test_a_body_is_named_that_a_force_on_it_explains_or_passes_near(explained, beside, named):
    at = ContactCheck("hand", np.zeros(3), explained, beside * unmeasured.NEAR)
    assert unmeasured.Unmeasured(1.0, 2.0, 0.3, at).body == ("hand" if named else None)


def test_a_body_whose_plate_is_unloaded_mostly_may_stand_beside_it():
    felt = {"left": np.arange(9) < 5, "right": np.arange(9) < 4}
    channels = {f"{name}_force": np.outer(there, [0.0, 0, 9]) for name, there in felt.items()}
    channels |= {f"{name}_torque": np.zeros((9, 3)) for name in felt}
    sensors = {name: ident.Sensor(f"{name}_foot") for name in felt}
    recording = ident.Recording(np.arange(9.0), channels, sensors=sensors)
    assert unmeasured._unloaded(SimpleNamespace(recording=recording), slice(None)) == {"right_foot"}


ENDS_IN_MOTION = [(1, 315, 637), (8, 170, 500), (19, 337, 634)]


@pytest.mark.parametrize(("seed", "first", "last"), ENDS_IN_MOTION)
def test_nothing_is_found_where_a_recording_ends_in_motion(seed, first, last):
    whole = faulty(seed)
    part, q = slice(first, last), whole.of_joints(JOINTS, "position")
    cut = angles_and_wrench(whole.time[part], q[part], wrench_of(whole)[part])
    assert not unmeasured_contacts(prepared(PENDULUM, cut))


SCARA = """<mujoco><worldbody><body name="base"><geom size=".05" mass="2"/>
<body name="upper" pos="0 0 .3"><joint name="shoulder"/><geom size=".05" pos=".15 0 0" mass="4"/>
<body name="fore" pos=".3 0 0"><joint name="elbow"/><geom size=".05" pos=".12 0 0" mass="3"/>
<body name="quill" pos=".25 0 0"><joint name="lift" type="slide"/><geom size=".03" pos="0 0 -.05" mass="1.5"/>
<body name="end"><joint name="roll"/><geom type="box" size=".05 .03 .02" pos=".02 0 -.1" mass="1"/>
</body></body></body></body></body></worldbody></mujoco>"""

TREE = """<mujoco><worldbody><body name="base"><geom size=".05" mass="3"/>
<body name="trunk" pos="0 0 .2"><joint name="waist" axis="0 1 0"/><geom size=".08" pos="0 0 .25" mass="8"/>
<body name="left" pos="0 .2 .4"><joint name="shoulder" axis="0 1 0"/><geom size=".05" pos=".2 0 0" mass="3"/>
<body name="end" pos=".35 0 0"><joint name="elbow" axis="0 1 0"/><geom size=".04" pos=".15 0 0" mass="1.5"/>
</body></body>
<body name="right" pos="0 -.2 .4"><joint name="right" axis="0 1 0"/><geom size=".05" pos=".2 0 0" mass="3"/>
<body name="fore" pos=".35 0 0"><joint name="fore"/><geom size=".04" pos=".15 0 0" mass="1.5"/></body></body>
</body></body></worldbody></mujoco>"""


def in_motion(robot, seed, seconds, noise, pushed=(0.0, 0.0), share=0.0):
    """A recording that begins and ends in motion, 100 Hz.

    Args:
        robot: The mechanism.
        seed: Seed of motion and noise.
        seconds: Its length, s.
        noise: Noise of the angles, rad.
        pushed: First and last time at which something carries the body `end`, s.
        share: Share of the weight that it carries.
    """
    rng, t, n = np.random.default_rng(seed), np.arange(round(100 * seconds)) / 100, len(robot.tree.joints)
    slides = np.where(np.array(robot.tree.joints) == "lift", 0.2, 1)
    q = dq = ddq = np.zeros((len(t), n))
    for _ in range(4):
        w, phase = 2 * np.pi * rng.uniform(0.2, 1.2, n), rng.uniform(0, 2 * np.pi, n)
        size, x = slides * rng.uniform(0.06, 0.2, n), w * t[:, None] + phase
        q, dq, ddq = q + size * np.sin(x), dq + size * w * np.cos(x), ddq - size * w**2 * np.sin(x)
    wrench = ident.base_wrench_regressor(robot.tree, q, dq, ddq, gravity=robot.gravity) @ robot.known
    at = robot.tree.poses(q)[:, robot.tree.names.index("end"), :3, 3]
    force = share * 9.81 * robot.mass * ((t >= pushed[0]) & (t <= pushed[1]))[:, None] * [0.05, 0.02, 1]
    wrench += rng.normal(size=wrench.shape) * [1, 1, 1, 0.1, 0.1, 0.1] - np.hstack([force, np.cross(at, force)])
    q = q + noise * slides * rng.normal(size=q.shape)
    channels = {f"{joint}_position": x for joint, x in zip(robot.tree.joints, q.T, strict=True)}
    return ident.Recording(t, channels | {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})


@pytest.mark.parametrize("model", [SCARA, TREE], ids=["scara", "tree"])
@pytest.mark.parametrize(("seconds", "noise"), [(10, 1e-3), (6, 3e-3)])
def test_accelerations_that_the_low_pass_loses_are_no_contact(model, seconds, noise):
    """They are forces of a body's inertia, so that a force on a body explains them."""
    robot = sim.mechanism(mujoco.MjSpec.from_string(model), base="base")
    every = [unmeasured_contacts(prepared(robot, in_motion(robot, seed, seconds, noise))) for seed in range(4)]
    assert not any(every)


@pytest.mark.parametrize("model", [SCARA, TREE], ids=["scara", "tree"])
@pytest.mark.parametrize("pushed", [(0, 0.25), (9.75, 10)])
def test_a_contact_for_a_moment_at_an_end_is_found(model, pushed):
    robot = sim.mechanism(mujoco.MjSpec.from_string(model), base="base")
    for seed in range(2):
        recording = in_motion(robot, seed, 10, 1e-3, pushed, 0.3)
        (contact,) = unmeasured_contacts(prepared(robot, recording))
        assert contact.start == pytest.approx(pushed[0], abs=0.2) and contact.end == pytest.approx(pushed[1], abs=0.2)
        assert contact.carries == pytest.approx(0.3, abs=0.1) and contact.body


def test_nothing_is_found_where_as_much_is_too_much_elsewhere():
    """A contact only pushes: errors to both sides are the model's, or a sensor's."""
    pushed, pulled = (wrench_of(leaning([span], FORCE)) for span in ((1, 2.5), (6, 7)))
    right = faulty()
    both = pushed - 0.7 * (pulled - wrench_of(right))
    q = right.of_joints(JOINTS, "position")
    assert len(unmeasured_contacts(prepared(PENDULUM, angles_and_wrench(right.time, q, pushed)))) == 1
    assert not unmeasured_contacts(prepared(PENDULUM, angles_and_wrench(right.time, q, both)))


def test_nothing_is_found_where_the_weight_is_not_measured():
    recording = leaning([(1, 2.5)], FORCE)
    wrench = wrench_of(recording)
    wrench[:, 2] = np.nan
    level = angles_and_wrench(recording.time, recording.of_joints(JOINTS, "position"), wrench)
    assert not unmeasured_contacts(prepared(PENDULUM, level))


@pytest.mark.parametrize("estimator", ["trajectory", "weighted"])
def test_an_identification_says_so_and_does_without_these_samples(estimator):
    estimate = ident.identify(PENDULUM, leaning([(2, 3), (6, 9)], FORCE, seed=1), estimator=estimator)
    contacts = coded(estimate, "unmeasured_contact")
    assert len(contacts) == 2 and all(finding.values["body"] == "link2" for finding in contacts)
    for finding, (start, end) in zip(contacts, [(2, 3), (6, 9)], strict=True):
        place = finding.place
        assert place.bodies == ("link2",) and place.log == 0 and place.span == pytest.approx((start, end), abs=0.3)
    for time in (estimate.held_out.time, estimate.prepared.recording.time[estimate.prepared.taken(estimate.part)]):
        assert not ((time > 2) & (time < 3) | (time > 6) & (time < 9)).any()
    assert len(estimate.residual) == len(estimate.prepared.taken(estimate.part))
    if estimator == "trajectory":
        assert (np.abs(estimate.psi - TRUTH) < 4 * estimate.std_setup).all()
        assert estimate.verdict().usable
