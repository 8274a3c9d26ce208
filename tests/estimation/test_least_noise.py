"""Lower bounds on the noise of channels and coordinates: resolution, flat channels, coordinates at rest."""

import numpy as np
import pytest
from recorded_faults import PENDULUM, TRUTH
from slow_pendulum import recorded

import ident
from ident.estimation.channel_scales import LEAST, least_noise

T = np.arange(1000) / 100


def test_floors_are_those_of_spread_resolution_and_kind():
    rng = np.random.default_rng(0)
    flat, coarse, fine = np.full(1000, 3.0), 0.3 * np.round(np.sin(T) / 0.3), 30 * np.sin(T) + rng.normal(size=1000)
    every = np.stack([flat, fine, coarse, flat, fine], axis=1)
    every[::7, 2] = np.nan
    floor = least_noise([every[:600], every[600:]], ("Fx", "Fy", "Fz", "joint1", "joint2"))
    of_fine = LEAST * fine.std()
    np.testing.assert_allclose(floor, [of_fine, of_fine, 0.3 / np.sqrt(12), of_fine, of_fine], rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_at_rest_is_held_where_it_is(seed):
    """The angle of a joint at rest is one number, without noise."""
    estimate = ident.identify(PENDULUM, recorded(seed, speed=1.5, rests=0.7, noise=1))
    assert estimate.prepared.notes == ("'joint2' rests at 0.7.",)
    fit = estimate.trajectory.fit
    assert fit.status == "converged" and not estimate.trajectory.search.incredible
    for c in fit.coefficients:
        np.testing.assert_allclose(c[:, 1], 0.7, atol=1e-3)
    assert (abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
    assert (estimate.held_out.ratio[1:] < 1.05 * estimate.rivals["model"][1:] + 0.01).all()
