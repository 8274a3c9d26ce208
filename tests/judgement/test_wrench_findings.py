"""Contacts that may be left out: doubted, but for those that are measured, whose noise looks the same."""

from types import SimpleNamespace

import numpy as np
import pytest

from ident.judgement.diagnosis import ContactCheck
from ident.judgement.wrench_findings import contact_findings
from ident.recordings.wrench import Sensor


@pytest.mark.parametrize("measured_on, doubted", [("link1", True), ("link2", False)])
def test_noise_of_a_measured_contact_is_no_contact_left_out(measured_on, doubted):
    recording = SimpleNamespace(sensors={"tip": Sensor(measured_on)})
    result = SimpleNamespace(
        checks=SimpleNamespace(contact=ContactCheck("link2", np.zeros(3), 0.8)),
        held_out=SimpleNamespace(ratio=np.full(6, 0.5)),
        prepared=SimpleNamespace(recording=recording),
    )
    assert [finding.doubt for finding in contact_findings(result)] == [True] * doubted
