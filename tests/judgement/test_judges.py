"""Judges of residuals, convergence, set-up, contacts, weight and mass: their thresholds, and those of doubts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from coded import coded
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, estimated, faulty, wrench_of

import ident
from ident.judgement import mass_findings
from ident.judgement.checks import ContactCheck, Weight
from ident.judgement.finding import SetupFinding
from ident.judgement.fit_findings import course_findings, quality_findings
from ident.judgement.recording_findings import contact_findings, setup_remarks
from ident.mechanism.motion import Motion
from ident.recordings.wrench import Sensor


def joint(**fit):
    return SimpleNamespace(trajectory=SimpleNamespace(fit=SimpleNamespace(**fit)))


def judged_by(judge, **evidence):
    return list(judge(SimpleNamespace(**evidence)))


@pytest.mark.parametrize(
    ("status", "steps", "doubted"),
    [
        ("converged", [5.0, 0.01], False),
        ("converged", [5.0, 0.5], False),
        ("rounds", [5.0, 0.25], False),
        ("rounds", [5.0, 0.35], True),
        ("stuck", [0.35], True),
        ("interrupted", [5.0, 1.0, 0.01], True),
    ],
)
def test_an_estimate_that_did_not_settle_is_a_doubt(status, steps, doubted):
    findings = list(course_findings(joint(status=status, trace=steps)))
    assert [(finding.code, finding.doubt) for finding in findings] == [("not_converged", True)] * doubted
    assert not findings or findings[0].values == {"status": status, "rounds": len(steps)}


LATE = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}


@pytest.mark.parametrize("setup", [(), (SetupFinding("delay(ground)", 0.02, 0.001, "delay", LATE, ()),)])
def test_a_set_up_that_explains_nothing_is_a_doubt_beside_what_was_found(setup):
    search = SimpleNamespace(incredible=True)
    *remarks, doubt = setup_remarks(SimpleNamespace(setup=setup, trajectory=SimpleNamespace(search=search)))
    assert [(finding.code, finding.doubt) for finding in remarks] == [("setup_delay", False)] * len(setup)
    assert (doubt.code, doubt.doubt, doubt.values) == ("setup_unexplained", True, {"changed": bool(setup)})


def test_residuals_over_signals_are_sorted_by_what_they_mean():
    ratios = {"a": 0.2, "b": 0.6, "c": 0.97, "d": 1.7, "e": 0.61}
    frames = {"ground": SimpleNamespace(mirrored=("f",))}
    given = {"ratios": ratios | {"f": 2.0, "g": 2.0}, "checks": SimpleNamespace(frames=frames), "idle": {"g": "noise"}}
    findings = judged_by(quality_findings, held_out=SimpleNamespace(part="held-out"), **given)
    assert [(finding.code, finding.doubt, finding.place.channels) for finding in findings] == [
        ("residual_above_signal", True, ("d",)),
        ("unexplained_channels", False, ("c",)),
        ("poor_prediction", False, ("b", "e")),
    ]
    assert findings[2].values == {"ratios": {"b": 0.6, "e": 0.61}, "part": "held-out"}


@pytest.mark.parametrize(
    "measured_on, distance, doubted", [("link1", 0.2, True), ("link2", 0.2, False), ("link1", 2.3, False)]
)
def test_a_contact_left_out_is_on_a_body_and_is_not_measured(measured_on, distance, doubted):
    recording, motion = SimpleNamespace(sensors={"tip": Sensor(measured_on)}), Motion(*np.zeros((3, 4, 2)))
    evidence = SimpleNamespace(
        checks=SimpleNamespace(contact=ContactCheck("link2", np.array([0, 0, distance]), 0.8, 0.0)),
        ratios=dict.fromkeys(range(6), 0.5),
        mechanism=PENDULUM,
        prepared=SimpleNamespace(recording=recording, samples=SimpleNamespace(motion=motion)),
    )
    assert [finding.doubt for finding in contact_findings(evidence)] == [True] * doubted


@pytest.mark.parametrize("drift", [0.015, 0.025, -0.015, -0.025])
def test_the_weight_may_not_drift_either_way(drift, monkeypatch):
    monkeypatch.setattr(mass_findings, "estimated_mass", lambda evidence: None)
    findings = judged_by(mass_findings.weight_findings, checks=SimpleNamespace(weight=Weight(50, 50, 50 * drift)))
    assert [finding.doubt for finding in findings] == [True] * (abs(drift) > 0.02)
    assert all(each.code == "weight_drifts" and each.values == {"drift": 50 * drift} for each in findings)


@pytest.mark.parametrize("drift", [0.0, 0.1, -0.1])
def test_a_drifting_sensor_is_weighed(drift):
    """By so much of the model's mass over the recording, part of which is fitted."""
    right = faulty()
    wrench = wrench_of(right)
    wrench[:, 2] += drift * PENDULUM.mass * 9.81 * (right.time - right.time.mean()) / np.ptp(right.time)
    recording = angles_and_wrench(right.time, right.of_joints(JOINTS, "position"), wrench)
    estimate = ident.identify(PENDULUM, recording, estimator="weighted", cutoff=8.0)
    weight, part = estimate.checks.weight, estimate.prepared.recording.time[estimate.prepared.taken(estimate.part)]
    assert weight.drift / PENDULUM.mass == pytest.approx(drift * np.ptp(part) / np.ptp(right.time), abs=0.01)
    assert weight.measured == pytest.approx(PENDULUM.mass, rel=0.02) and weight.model == PENDULUM.mass


def test_the_mass_of_an_estimate_is_that_of_all_bodies():
    estimate = estimated()
    mass = mass_findings.estimated_mass(estimate)
    assert mass.value == pytest.approx(estimate.psi[0]) and mass.std == pytest.approx(estimate.std[0])
    assert mass.std_setup == pytest.approx(estimate.std_setup[0])
    assert not coded(estimate, "mass_by_setup", "mass_or_common_gain")


def test_it_is_a_doubt_where_the_wrenches_and_the_model_agree():
    """The model is as wrong as the channel."""
    model = replace(PENDULUM, prior=1.1 * PENDULUM.known)
    (finding,) = coded(ident.identify(model, faulty(gains=(1, 1, 1.1, 1, 1, 1))), "mass_by_setup")
    assert finding.doubt


def test_a_gain_of_all_channels_is_one_with_the_mass():
    estimate = estimated(gains=(1.08,) * 6)
    (finding,) = coded(estimate, "mass_or_common_gain")
    assert not finding.doubt and finding.values["mass"] == pytest.approx(22.67, abs=0.005)
    assert finding.values["mass"] / finding.values["model"] == pytest.approx(1.08, abs=0.0005)
    assert abs(estimate.psi[0] - 1.08 * TRUTH[0]) < 0.1
    assert (np.abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
