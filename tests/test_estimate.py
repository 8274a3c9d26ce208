"""Numbers of an estimate for comparison with published ones."""

from functools import cache

import numpy as np
from recorded_faults import PENDULUM, estimated, faulty

import ident
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters


@cache
def ordinary():
    return ident.identify(PENDULUM, faulty(), estimator="ordinary", cutoff=5.0)


def test_what_is_open_of_the_setup_adds_to_the_variance_of_every_combination():
    """Also if the set-up makes errors of parameters anticorrelated."""
    estimate = estimated()
    noise, both = (
        x[: estimate.base.rank, : estimate.base.rank] for x in (estimate.fit.covariance, estimate.covariance_setup)
    )
    unit = np.outer(*2 * [np.sqrt(np.diag(both))])
    assert np.linalg.eigvalsh((both - noise) / unit).min() > -1e-9
    assert ((both - noise) / unit).min() < -0.1
    np.testing.assert_allclose(np.sqrt(np.diag(both)), estimate.std_setup)


def test_condition_numbers_are_those_of_the_regressor_as_it_is_and_with_unit_norm():
    prepared, part = ordinary().logs[0]
    base = find_base_parameters(PENDULUM)
    Y = base_wrench_regressor(PENDULUM.tree, *prepared.samples[part].motion.states, gravity=PENDULUM.gravity)
    Y = base.reduce(Y).reshape(-1, base.rank)
    numbers = ordinary().condition_numbers
    np.testing.assert_allclose(numbers["raw"], np.linalg.cond(Y), rtol=1e-9)
    np.testing.assert_allclose(numbers["unit_norm"], np.linalg.cond(Y / np.linalg.norm(Y, axis=0)), rtol=1e-9)
    assert numbers["weighted"] == ordinary().condition_number
