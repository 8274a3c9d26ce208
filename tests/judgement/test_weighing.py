"""Mass of an estimate compared with the wrenches' weight and with the model's."""

from dataclasses import replace

import pytest
from recorded_faults import PENDULUM, TRUTH, faulty

import ident
from ident.judgement.weighing import estimated_mass


def said(estimate, words):
    return [finding for finding in estimate.findings if words in finding.text]


def test_the_mass_of_an_estimate_is_that_of_all_bodies():
    estimate = ident.identify(PENDULUM, faulty())
    mass = estimated_mass(estimate)
    assert mass.value == pytest.approx(estimate.psi[0]) and mass.std == pytest.approx(estimate.std[0])
    assert mass.std_setup == pytest.approx(estimate.std_setup[0])
    assert not said(estimate, "Weigh it") and not said(estimate, "common to all channels")


def test_a_gain_that_was_found_is_held_against_the_weight():
    """Fz reads a tenth too much: the estimate has the model's weight, the wrenches a larger one."""
    (finding,) = said(ident.identify(PENDULUM, faulty(gains=(1, 1, 1.1, 1, 1, 1))), "Weigh it")
    assert "the wrenches weigh 23.10 kg, the model 20.99 kg" in finding.text and not finding.doubt


def test_it_is_a_doubt_where_the_wrenches_and_the_model_agree():
    """The model is as wrong as the channel."""
    model = replace(PENDULUM, prior=1.1 * PENDULUM.known)
    (finding,) = said(ident.identify(model, faulty(gains=(1, 1, 1.1, 1, 1, 1))), "Weigh it")
    assert finding.doubt


def test_a_gain_of_all_channels_is_one_with_the_mass():
    estimate = ident.identify(PENDULUM, faulty(gains=(1.08,) * 6))
    (finding,) = said(estimate, "A gain common to all channels is one with the mass")
    assert "22.67 ± 0.4 kg, is 8.0% more than the model's" in finding.text and not finding.doubt
    assert abs(estimate.psi[0] - 1.08 * TRUTH[0]) < 0.1
