"""Numbers of an estimate that are compared with published ones, and logs that disagree."""

from dataclasses import replace
from functools import cache

import numpy as np
from recorded_faults import PENDULUM, faulty, shortened

import ident
from ident.estimation.setup import PRIORS
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters


@cache
def ordinary():
    return ident.identify(PENDULUM, faulty(), estimator="ordinary", cutoff=5.0)


def test_condition_numbers_are_those_of_the_regressor_as_it_is_and_with_unit_norm():
    prepared, part = ordinary().logs[0]
    base = find_base_parameters(PENDULUM)
    Y = base_wrench_regressor(PENDULUM.tree, *prepared.samples[part].motion.states, gravity=PENDULUM.gravity)
    Y = base.reduce(Y).reshape(-1, base.rank)
    numbers = ordinary().condition_numbers
    np.testing.assert_allclose(numbers["raw"], np.linalg.cond(Y), rtol=1e-9)
    np.testing.assert_allclose(numbers["unit_norm"], np.linalg.cond(Y / np.linalg.norm(Y, axis=0)), rtol=1e-9)
    assert numbers["weighted"] == ordinary().condition_number


def test_relative_rms_is_over_the_signal_with_its_mean():
    held = ordinary().held_out
    residual, signal = (np.linalg.norm(x, axis=0) for x in (held.residual, held.samples.measured))
    np.testing.assert_allclose(held.relative_rms, residual / signal, rtol=1e-12)
    told = ordinary().to_dict()["held_out"]["Fz"]
    assert told["relative_rms"] < 0.1 * told["ratio"], "most of Fz is weight"


def loaded(seed, mass):
    """A trial of the pendulum whose second link carries more than the others, as its wrench shows."""
    log = shortened(faulty(seed), 250)
    return replace(log, measured={**log.measured, "ground_force": mass * log["ground_force"]})


def test_the_trial_that_disagrees_is_named_and_all_are_fitted_as_one():
    """Five trials, in one of which everything is 15 % heavier."""
    exact = {"setup": dict.fromkeys(PRIORS, 0.0)}
    trials = [loaded(seed, 1.15 if seed == 3 else 1.0) for seed in range(5)]
    estimate = ident.identify(PENDULUM, trials, **exact)
    assert len(estimate.logs) == len(estimate.disagreements) == 5
    assert int(np.argmax(estimate.disagreements)) == 3 and estimate.disagreements[3] > 5
    (found,) = [finding for finding in estimate.findings if finding.text.startswith("Logs disagree")]
    assert "log" in found.text and "4 (" in found.text and found.doubt
    # Which of the logs it is shows beside the others.
    assert max(np.delete(estimate.disagreements, 3)) < 0.5 * estimate.disagreements[3]
