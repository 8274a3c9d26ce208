"""Uncertainty of the set-up in the covariance of a trajectory estimate, against that of all parameters together."""

from types import SimpleNamespace

import numpy as np
import pytest

from ident.estimation.setup_parameters import SetupParameter
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.setup_search import Search

NAMES = ("a", "b", "delay", "tilt of log 2")
FREE, HELD = slice(0, 2), slice(2, 4)
KNOWN = np.diag([0, 0, 4.0, 25.0])
SETUP = SetupParameter("delay", "ground", None, 0.5), SetupParameter("gravity", "", 0, 0.2)


def data(rng, of=NAMES):
    rows = rng.normal(size=(9, len(of))) * np.geomspace(1, 5, len(of))
    return rows.T @ rows


def joint(information, *, scatter=None, gradient=0.0, weight=0.3, setup=SETUP):
    """Trajectory estimate with the set-up held, whose prior had a weight in the fit.

    Args:
        information: Precision from the data (4, 4).
        scatter: Covariance of the data's right side; by default `information`, as for the assumed noise (4, 4).
        gradient: Precision times the step of the set-up that the data ask for (4,).
        weight: Weight of the prior.
        setup: The two parameters of the set-up.
    """
    fit = SimpleNamespace(
        names=NAMES,
        free=np.array([True, True, False, False]),
        counted=np.array([True, True, False, False]),
        precision=information + weight * KNOWN,
        scatter=(information if scatter is None else scatter) + weight**2 * KNOWN,
        gradient=np.zeros(4) + gradient,
        prior=SimpleNamespace(known=KNOWN, weight=weight),
    )
    return TrajectoryEstimate(None, Search(fit), (1,), 0.1, False, setup=dict(enumerate(setup, 2)))


@pytest.mark.parametrize("weight", [0.3, 1.0])
def test_it_is_what_the_set_up_would_add_were_it_fitted_as_well(weight):
    information = data(np.random.default_rng(0))
    added = joint(information, weight=weight).covariance_of_setup
    expected = np.linalg.inv(information + KNOWN)[FREE, FREE] - np.linalg.inv(information[FREE, FREE])
    np.testing.assert_allclose(added[FREE, FREE], expected, rtol=1e-6)
    assert not added[HELD].any() and not added[:, HELD].any()


@pytest.mark.parametrize(("of", "common"), [(("Fx", "Mz"), True), (("Fx", "elbow"), False), (("hip", "elbow"), True)])
def test_gains_of_one_instrument_share_an_error(of, common):
    """It is as uncertain as each one's own; a plate and the joint torques are two instruments."""
    gains = [SetupParameter("gain", each, None, 1, None, {"channels": (each,)}) for each in of]
    information = data(np.random.default_rng(4))
    covariance = np.diag([0.25, 0.04]) + common * np.outer([0.5, 0.2], [0.5, 0.2])
    known = np.zeros((4, 4))
    known[HELD, HELD] = np.linalg.inv(covariance)
    expected = np.linalg.inv(information + known)[FREE, FREE] - np.linalg.inv(information[FREE, FREE])
    added = joint(information, setup=gains).covariance_of_setup
    np.testing.assert_allclose(added[FREE, FREE], expected, rtol=1e-6)
