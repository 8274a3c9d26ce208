"""Findings on contacts to leave out, similar noise of sensors, and weight."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import JOINTS, PENDULUM, angles_and_wrench, faulty, wrench_of

import ident
from ident.judgement.checks import Weight
from ident.judgement.diagnosis import ContactCheck
from ident.judgement.weighing import weight_findings
from ident.judgement.wrench_findings import contact_findings
from ident.mechanism.motion import Motion
from ident.recordings.wrench import Sensor


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


def weighed(*weight):
    """Findings on a weight; its arguments are measured and modelled mass, and drift."""
    return list(weight_findings(SimpleNamespace(checks=SimpleNamespace(weight=Weight(*weight)))))


@pytest.mark.parametrize("drift", [0.015, 0.025, -0.015, -0.025])
def test_the_weight_may_not_drift_either_way(drift):
    findings = weighed(50, 50, 50 * drift)
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
