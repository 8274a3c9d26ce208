"""Prior knowledge of bodies, uncertainty of the set-up, and pieces left out."""

from dataclasses import replace
from types import SimpleNamespace

import driven_arm
import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from docs.tools.noise_conditions import CONDITIONS, SUBJECTS
from docs.tools.noise_recordings import noisy_recording
from ident.estimation.preparation import prepared
from ident.estimation.setup_parameters import SetupParameter
from ident.identification import identified
from ident.parameters.prior import known_covariance
from ident.trajectory.corrected import _root_of_inverse
from ident.trajectory.fit.fitted import Prior, TrajectoryFit
from ident.trajectory.fit.piece import Noise
from ident.trajectory.left_out import clearly_better, clearly_less, gains, without
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.setup_search import Search

FREE, HELD = slice(0, 2), slice(2, 4)
DELAY_AND_TILT = SetupParameter("delay", "ground", None, 0.5), SetupParameter("gravity", "", 0, 0.2)


def gains_of(*channels):
    return [SetupParameter("gain", each, None, 1, None, {"channels": (each,)}) for each in channels]


@pytest.mark.parametrize(
    ("setup", "weight", "covariance"),
    [
        (DELAY_AND_TILT, 0.3, np.diag([0.25, 0.04])),
        (DELAY_AND_TILT, 1.0, np.diag([0.25, 0.04])),
        (gains_of("Fx", "Mz"), 0.3, np.diag([0.25, 0.04]) + np.outer([0.5, 0.2], [0.5, 0.2])),
        (gains_of("Fx", "elbow"), 0.3, np.diag([0.25, 0.04])),
        (gains_of("hip", "elbow"), 0.3, np.diag([0.25, 0.04]) + np.outer([0.5, 0.2], [0.5, 0.2])),
    ],
)
def test_uncertainty_of_the_set_up_is_what_it_would_add_were_it_fitted_as_well(setup, weight, covariance):
    """Whatever weight the prior has in the fit; gains of one instrument share an error as large as each one's own."""
    rows, known, both = np.random.default_rng(0).normal(size=(9, 4)) * np.geomspace(1, 5, 4), *np.zeros((2, 4, 4))
    information = rows.T @ rows
    known[HELD, HELD], both[HELD, HELD] = np.diag([4.0, 25.0]), np.linalg.inv(covariance)
    free = np.arange(4) < 2
    fit = SimpleNamespace(
        names=("a", "b", "delay", "tilt of log 2"),
        free=free,
        counted=free,
        precision=information + weight * known,
        scatter=information + weight**2 * known,
        gradient=np.zeros(4),
        prior=SimpleNamespace(known=known, weight=weight),
    )
    estimate = TrajectoryEstimate(None, Search(fit), (0.1,), False, setup=dict(enumerate(setup, 2)))
    added = estimate.covariance_of_setup
    expected = np.linalg.inv(information + both)[FREE, FREE] - np.linalg.inv(information[FREE, FREE])
    np.testing.assert_allclose(added[FREE, FREE], expected, rtol=1e-6)
    assert not added[HELD].any() and not added[:, HELD].any()


@pytest.mark.parametrize("seed", range(2))
def test_the_root_is_that_of_the_inverse_however_different_units_are(seed):
    """A direction without variance does not change the others, and weighs as much as rounding allows."""
    rng = np.random.default_rng(seed)
    rows, scale = rng.normal(size=(30, 5)), 10.0 ** rng.uniform(-6, 6, 5)
    precision = rows.T @ rows
    root = _root_of_inverse(np.linalg.inv(precision) * np.outer(scale, scale))
    np.testing.assert_allclose(root.T @ root * np.outer(scale, scale), precision, rtol=1e-7, atol=1e-9)
    root = _root_of_inverse(np.diag([4.0, 0.0, 9.0]))
    precision = root.T @ root
    assert np.isfinite(root).all() and precision[1, 1] > 1e10
    np.testing.assert_allclose(precision[[0, 2]], [[1 / 4, 0, 0], [0, 0, 1 / 9]], atol=1e-12)


def test_set_up_deviations_have_the_size_of_the_estimate_whatever_the_unit_of_the_model():
    arm, log = driven_arm.mechanism(**driven_arm.NONE), driven_arm.log(6.0)
    bodies = arm.known.reshape(-1, 10) * np.r_[np.ones(4), np.full(6, 1e9)]
    right, wrong = (ident.identify(x, log, known=False) for x in (arm, replace(arm, prior=bodies.ravel())))
    factor = wrong.std_setup / right.std_setup
    assert factor.min() > 0.3 and factor.max() < 3


def test_slow_residuals_tell_less_than_a_fit_takes_them_for():
    """Of an arm from three seconds with the usual prior."""
    arm, condition = SUBJECTS["arm"].mechanism, replace(CONDITIONS["random_walk"], samples=300)
    estimate = ident.identify(arm, noisy_recording(condition, 0, 0), known=True)
    parameters = estimate.fit.equations.parameters
    assert estimate.trajectory.fit.prior.weight > 2
    assert (estimate.std <= np.sqrt(np.diag(known_covariance(arm, parameters))) * (1 + 1e-6)).all()
    assert (np.abs(estimate.psi - parameters.regroup(arm.known)) < 1.96 * estimate.std).mean() > 0.9


@pytest.mark.parametrize("seed", range(2))
def test_pieces_left_out_of_linear_equations(seed):
    """Parameters without a piece, and what left-out pieces cost less by the last one, which is held otherwise."""
    rng, none, pieces, p = np.random.default_rng(seed), np.zeros(0), 4, 5
    rows = rng.normal(size=(pieces, 12, p))
    y = rows @ rng.normal(size=p) + 0.1 * rng.normal(size=(pieces, 12))
    prior, usual, every = np.diag([0, 0, 0, 0.5, 4.0]), np.arange(p) < p - 1, np.ones(p, bool)

    def solved(pieces, free):
        A, out = rows[pieces][..., free].reshape(-1, free.sum()), np.zeros(p)
        out[free] = np.linalg.solve(A.T @ A + prior[np.ix_(free, free)], A.T @ y[pieces].ravel())
        return out

    theta = solved(slice(None), usual)
    shares = [(X.T @ X, X.T @ (z - X @ theta)) for X, z in zip(rows, y, strict=True)]
    noise = Noise(np.zeros((3, 0)), none, none, np.zeros((3, 0)), none, np.zeros((3, 0)), none)
    fit = TrajectoryFit([*"abcde"], [], Prior(np.zeros(p), prior), theta, usual, [noise], [], [], shares)
    gain = gains(fit, np.eye(p)[[4]] > 0)[0]
    assert clearly_better(gain) and not clearly_better(np.array([2.0, -1.0]))
    for k in range(pieces):
        others = np.arange(pieces) != k
        np.testing.assert_allclose(without(fit, slice(k, k + 1))[0], solved(others, usual), atol=1e-10)
        costs = [np.sum((y[k] - rows[k] @ solved(others, free)) ** 2) for free in (usual, every)]
        assert gain[k] == pytest.approx(costs[0] - costs[1])


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [2, 9, 12, 15])
def test_an_interrupt_ends_every_stage(rounds):
    """In the choice of knots, of weights and of the set-up alike."""
    calls = []

    def interrupt(*_):
        calls.append(1)
        if len(calls) == rounds:
            raise KeyboardInterrupt

    estimate = identified(prepared(PENDULUM, shortened(faulty(3, delay=0.03), 500)), report=interrupt)
    assert estimate.trajectory.fit.status == "interrupted" and len(calls) == rounds
    assert np.isfinite(estimate.std).all()


def test_white_weights_are_kept_unless_others_predict_clearly_better():
    """Channels that neither explains do not count."""
    white = np.array([0.2, 0.3, 1.0])
    assert not clearly_less(white, np.array([0.2, 0.295, 1.0]))
    assert clearly_less(white, np.array([0.15, 0.3, 1.0]))
    assert not clearly_less(np.ones(2), np.ones(2))
