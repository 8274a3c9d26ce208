"""A person on two force plates alone: intervals cover the truth, errors of the prior are corrected."""

import numpy as np
import pytest
from persons import briefly

pytestmark = pytest.mark.slow


def test_two_feet_on_plates_tell_what_unseen_motions_need():
    person = briefly()
    assert person.coverage > 0.85 and person.determined.sum() >= 9
    assert np.sqrt(np.mean(person.distances[1] ** 2)) < 1.4
    (late,) = (each for each in person.estimate.setup if each.name.startswith("delay"))
    assert abs(late.value - 0.02) < 3 * late.std
    prior, joint = (person.errors[name] for name in ("prior", "trajectory estimate"))
    assert joint.sum() < 0.6 * prior.sum()
