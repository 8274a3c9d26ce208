"""Unmeasured contacts: found by the weight that they carry, named, and left out."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_faults import JOINTS, PENDULUM, angles_and_wrench, leaning, wrench_of

from ident.estimation.preparation import prepared
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


def test_nothing_is_found_where_the_weight_is_not_measured():
    recording = leaning([(1, 2.5)], FORCE)
    wrench = wrench_of(recording)
    wrench[:, 2] = np.nan
    level = angles_and_wrench(recording.time, recording.of_joints(JOINTS, "position"), wrench)
    assert not unmeasured_contacts(prepared(PENDULUM, level))
