"""Contacts that may be left out: doubted, but for those that are measured, whose noise looks the same."""

from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import PENDULUM

from ident.judgement.diagnosis import ContactCheck
from ident.judgement.wrench_findings import contact_findings
from ident.mechanism.motion import Motion
from ident.recordings.wrench import Sensor


@pytest.mark.parametrize(
    "measured_on, distance, doubted", [("link1", 0.2, True), ("link2", 0.2, False), ("link1", 2.3, False)]
)
def test_a_contact_left_out_is_on_a_body_and_is_not_measured(measured_on, distance, doubted):
    recording, motion = SimpleNamespace(sensors={"tip": Sensor(measured_on)}), Motion(*np.zeros((3, 4, 2)))
    result = SimpleNamespace(
        checks=SimpleNamespace(contact=ContactCheck("link2", np.array([0, 0, distance]), 0.8, 0.0)),
        held_out=SimpleNamespace(ratio=np.full(6, 0.5)),
        prepared=SimpleNamespace(recording=recording, mechanism=PENDULUM, samples=SimpleNamespace(motion=motion)),
    )
    assert [finding.doubt for finding in contact_findings(result)] == [True] * doubted
