"""Clocks of plates and wrenches beside those of angles: delays, rates and jumps."""

from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import lifting
import numpy as np
import pytest
import swinging
import walker
from mechanisms import by_joint
from recorded_faults import PENDULUM, faulty

import ident
import scenes
import sim
from docs.tools.noise import Case
from docs.tools.noise_conditions import CONDITIONS
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import Part, prepared
from ident.estimation.setup_parameters import SetupParameter
from ident.judgement.finding import setup_findings
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.recordings.times import Sampled
from ident.setup import PRIORS
from ident.trajectory.cut_pieces import cut
from ident.trajectory.fit.fitted import Prior
from ident.trajectory.start import likely_delay
from ident.trajectory.trajectory_estimate import trajectory_estimate

pytestmark = pytest.mark.slow
LIFTS = (lifting.SQUAT, 0.35), (lifting.STOOP, 0.4)


def later(recording, start):
    """A recording on a clock with another origin."""
    streams = {name: (x.time + start, x.values) for name, x in recording.streams.items()}
    return replace(recording, time=recording.time + start, streams=streams)


def found_of(seed, begin, **options):
    """Set-up errors found in two lifts on clocks with other origins."""
    who = lifting.lifter(seed)
    logs = [lifting.recorded(who, *lift, 10 * seed + k, seconds=3.0) for k, lift in enumerate(LIFTS)]
    logs = [later(each, start) for each, start in zip(logs, begin, strict=True)]
    return ident.identify(lifting.table(), logs, known=True, **options).setup


@pytest.mark.parametrize(("seed", "late"), [(1, -0.08), (0, 0.15)])
def test_plates_that_are_far_from_the_angles_clock_are_found(seed, late, monkeypatch):
    monkeypatch.setattr(lifting, "LATE", late)
    (finding,) = found_of(seed, (1000.0, 1100.0), holdout=0.2)
    assert finding.name == "delay(ground)" and finding.value == pytest.approx(late, abs=0.004)
    assert ("ms late" if late > 0 else "ms early") in finding.text


def test_plates_on_the_angles_clock_are_left_there(monkeypatch):
    monkeypatch.setattr(lifting, "LATE", 0.0)
    assert not found_of(1, (0.0, 0.0))


def test_a_clock_that_is_fast_is_no_delay():
    """Over forty seconds a fast clock amounts to a tenth of a second."""
    who, rng, fast, time = lifting.lifter(0), np.random.default_rng(0), 0.003, np.arange(0, 40, 0.04)
    motion, before = (lifting.motion(t, lifting.SQUAT, 0.35, 0) for t in (time, (1 - fast) * time))
    wrench = base_wrench_regressor(who.tree, *before.states, gravity=who.gravity) @ who.known
    wrench += lifting.FORCE * np.array([1, 1, 1, 0.2, 0.2, 0.2]) * rng.normal(size=wrench.shape)
    wrench[:, [1, 3, 5]] = np.nan
    channels = {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]}
    channels |= by_joint(lifting.JOINTS, position=motion.q + 0.002 * rng.normal(size=motion.q.shape))
    (finding,) = ident.identify(lifting.table(), ident.Recording(time, channels), known=True).setup
    assert finding.name == "clock(ground)" and finding.value == pytest.approx(-fast, abs=1e-4)


@pytest.mark.parametrize("std", [10.0, 1e6, np.inf])
def test_delays_that_are_longer_than_a_recording_are_no_candidates(std):
    ready = prepared(PENDULUM, faulty(0, delay=0.1))
    at, delay = len(ready.equations.names), SetupParameter("delay", "ground", None, std)
    measurement = Measurement(ready.equations, (delay,), False, ready.frame, tuple(range(6)), {})
    pieces = cut(ready, measurement, slice(0, 600), 0.05)
    theta = np.append(ready.equations.parameters.regroup(PENDULUM.known), 0.0)
    prior = Prior(np.zeros(at + 1), np.diag(np.append(np.zeros(at), std**-2.0)))
    fit = SimpleNamespace(theta=theta, prior=prior, pieces=pieces, selections=[np.arange(at + 1)] * len(pieces))
    assert likely_delay(measurement, at, fit) == pytest.approx(0.1)


@pytest.mark.parametrize("fast", [0.0, 0.003])
def test_jumps_are_no_clock_but_a_fast_clock_is_found(fast):
    """A clock error of 0.023 ± 0.002 %, a tenth of a sample, would predict unseen pieces better."""
    condition = CONDITIONS["trapezoids_100"]
    # A rate error of this size needs no more than six seconds.
    case = Case.drawn(replace(condition, samples=600) if fast else condition, 0, 2)
    t, measured = case.recording.time, dict(case.recording.measured)
    for name in ("ground_force", "ground_torque"):
        measured[name] = np.stack([np.interp(t * (1 - fast), t, x) for x in measured[name].T], axis=1)
    recording = replace(case.recording, measured=measured)
    setup = ident.identify(case.subject.mechanism, recording, **{"holdout": 0.0, **condition.options}).setup
    assert [each.name for each in setup] == ["clock(ground)"] * (fast > 0)
    assert [abs(each.value) for each in setup] == [pytest.approx(fast, rel=0.1)] * (fast > 0)


NOISE = np.repeat([0.5, 0.05], [3, 5])
"""Noise of the wrench, N and N m, and of the torques."""


def recorded(seed, late=0.0, fast=0.0):
    """The paper's pendulum; the wrench is delayed, and its clock is fast."""
    rng, arm, time = np.random.default_rng(seed), swinging.pendulum(), np.arange(0.3, 9.0, 0.01)
    motion, before = swinging.motion(time), swinging.motion(time - late - fast * (time - time[0]))
    wrench = base_wrench_regressor(arm.tree, *before.states, gravity=arm.gravity) @ arm.known
    torques = joint_torque_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ arm.known
    wrench, torques = np.split(np.hstack([wrench, torques]) + NOISE * rng.normal(size=(len(time), 8)), [6], axis=1)
    channels = by_joint(swinging.JOINTS, position=motion.q + 3e-4 * rng.normal(size=motion.q.shape), torque=torques)
    return ident.Recording(time, channels | {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})


@pytest.mark.parametrize(
    ("fault", "name", "value"),
    [({"late": -0.008}, "delay(ground)", -0.008), ({"fast": 0.004}, "clock(ground)", -0.004)],
)
def test_the_wrench_alone_is_late(fault, name, value):
    estimate = ident.identify(swinging.pendulum(), recorded(0, **fault), held_out=recorded(1, **fault))
    (finding,) = estimate.setup
    assert finding.name == name and abs(finding.value - value) < 1e-4 + 2 * finding.std < 5e-4
    np.testing.assert_allclose(estimate.trajectory.fit.channel_noise, NOISE, rtol=0.1)
    truth = estimate.base.regroup(swinging.pendulum().known)
    assert (np.abs(estimate.psi - truth) < 3.5 * estimate.std).all()
    # The delay does not affect predictions of other recordings' torques and wrenches.
    rms = np.sqrt((estimate.held_out.residual_with(truth) ** 2).mean(axis=0))
    assert (np.delete(rms / NOISE, 3) < 1.15).all()


EXACT = dict.fromkeys(PRIORS, 0.0)


def z_of(fit, ready, mechanism):
    """Errors of the base parameters in standard deviations."""
    truth = ready.equations.parameters.regroup(mechanism.known)
    return (fit.theta[: len(truth)] - truth) / np.sqrt(np.diag(fit.covariance)[: len(truth)])


def test_plates_that_are_late_are_found_where_nothing_holds_the_base():
    """The pelvis's coordinates are joints; a plate and a rail, both 30 ms late, add up to the total wrench."""
    rng, late, person, (time, q, *_) = np.random.default_rng(0), 3, walker.mechanism(walker.SMALL), walker.motion()
    total, share = walker.truth(walker.SMALL)[0], 0.2 + 0.1 * np.sin(3 * time)
    q = q[late:, : len(person.tree.joints)]
    measured = by_joint(person.tree.joints, position=q + 0.002 * rng.normal(size=q.shape))
    for name, taken in (("plate", 1 - share), ("rail", share)):
        values = taken[:, None] * total + rng.normal(size=total.shape) * [1, 1, 1, 0.3, 0.3, 0.3]
        measured |= {f"{name}_force": values[:-late, :3], f"{name}_torque": values[:-late, 3:]}
    sensors = {name: ident.Sensor(body, frame="world") for name, body in (("plate", "pelvis"), ("rail", "arm"))}
    ready = prepared(person, ident.Recording(time[late:], measured, sensors=sensors), cutoff=8.0)
    setup = EXACT | {"delay": 0.05}
    result = trajectory_estimate([Part(ready, slice(0, 300))], ready.equations, setup=setup, knots=0.12)
    (finding,) = setup_findings(result)
    assert finding.text.startswith("The wrench 'plate + rail' is ") and abs(finding.value - 0.03) < 3 * finding.std
    assert finding.std < 0.002
    assert 0.5 < np.sqrt(np.mean(z_of(result.fit, ready, person) ** 2)) < 1.5


@pytest.mark.parametrize("beside_wrench", [True, False])
def test_torques_that_are_late_against_the_angles_are_found(beside_wrench):
    arm = sim.mechanism(scenes.load("arm"), base="base")
    recording = ident.read_log(str(files(scenes) / "arm.csv"), arm)
    measured = {name: x for name, x in recording.measured.items() if beside_wrench or not name.startswith("ground")}
    then = recording.time + 0.012
    streams = {name: Sampled(then, recording[name]) for name in (f"{joint}_torque" for joint in arm.joints)}
    delayed = measured | {name: np.interp(recording.time, then, own.values) for name, own in streams.items()}
    on_time, late = (
        ident.identify(arm, ident.Recording(recording.time, own, streams=shifted))
        for own, shifted in ((measured, {}), (delayed, streams))
    )
    assert "torque_delay" not in [each.name for each in on_time.setup]
    (delay,) = (each for each in late.setup if each.name == "torque_delay")
    assert abs(delay.value - 0.012) < 4 * delay.std and delay.std < 1e-3
    assert late.verdict().usable
    drives = [name for name in late.fit.names if name.startswith(("Fv", "Fc"))]
    assert drives
    for name in drives:
        assert abs(late[name].value - on_time[name].value) < 3 * np.hypot(late[name].std_setup, on_time[name].std_setup)
