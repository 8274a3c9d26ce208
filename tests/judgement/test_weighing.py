"""Mass of an estimate compared with the wrenches' weight and with the model's."""

from dataclasses import replace

import numpy as np
import pytest
from coded import coded
from recorded_faults import PENDULUM, TRUTH, estimated, faulty

import ident
from ident.judgement.weighing import estimated_mass


def test_the_mass_of_an_estimate_is_that_of_all_bodies():
    estimate = estimated()
    mass = estimated_mass(estimate)
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
