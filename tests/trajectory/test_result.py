"""Prior knowledge of bodies, uncertainty of the set-up, and pieces left out."""

from dataclasses import replace
from types import SimpleNamespace

import driven_arm
import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from docs.tools.noise.conditions import CONDITIONS, SUBJECTS
from docs.tools.noise.recordings import noisy_recording
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

NAMES = ("a", "b", "delay", "tilt of log 2")
FREE, HELD = slice(0, 2), slice(2, 4)
KNOWN = np.diag([0, 0, 4.0, 25.0])
SETUP = SetupParameter("delay", "ground", None, 0.5), SetupParameter("gravity", "", 0, 0.2)


def data(rng, of=NAMES):
    rows = rng.normal(size=(9, len(of))) * np.geomspace(1, 5, len(of))
    return rows.T @ rows


def joint(information, *, scatter=None, gradient=0.0, weight=0.3, setup=SETUP):
    """Trajectory estimate of information from the data, with the set-up held and a weight of the prior in the fit."""
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


@pytest.mark.parametrize("seed", range(4))
def test_the_root_is_that_of_the_inverse_however_different_units_are(seed):
    rng = np.random.default_rng(seed)
    rows, scale = rng.normal(size=(30, 5)), 10.0 ** rng.uniform(-6, 6, 5)
    precision = rows.T @ rows
    root = _root_of_inverse(np.linalg.inv(precision) * np.outer(scale, scale))
    np.testing.assert_allclose(root.T @ root * np.outer(scale, scale), precision, rtol=1e-7, atol=1e-9)


def test_what_is_known_for_certain_weighs_as_much_as_rounding_tells():
    """A direction without variance does not change the other directions."""
    root = _root_of_inverse(np.diag([4.0, 0.0, 9.0]))
    precision = root.T @ root
    assert np.isfinite(root).all() and precision[1, 1] > 1e10
    np.testing.assert_allclose(precision[[0, 2]], [[1 / 4, 0, 0], [0, 0, 1 / 9]], atol=1e-12)


ARM = driven_arm.mechanism(**driven_arm.NONE)


def scaled(inertia, every=1.0):
    """The arm with factors on its inertias and on all of it."""
    return replace(ARM, prior=(every * ARM.known.reshape(-1, 10) * np.r_[np.ones(4), np.full(6, inertia)]).ravel())


def test_set_up_deviations_have_the_size_of_the_estimate_whatever_the_unit_of_the_model():
    log = driven_arm.log()
    right, wrong = (ident.identify(model, log, known=False) for model in (ARM, scaled(1e9)))
    factor = wrong.std_setup / right.std_setup
    assert factor.min() > 0.3 and factor.max() < 3


def estimated(name):
    """An estimate of an arm from three seconds with the usual prior; the prior standard deviations and truth (r,)."""
    arm = SUBJECTS["arm"].mechanism
    estimate = ident.identify(arm, noisy_recording(replace(CONDITIONS[name], samples=300), 0, 0), known=True)
    parameters = estimate.fit.equations.parameters
    return estimate, np.sqrt(np.diag(known_covariance(arm, parameters))), parameters.regroup(arm.known)


def test_slow_residuals_tell_less_than_a_fit_takes_them_for():
    estimate, known, true = estimated("random_walk")
    assert estimate.trajectory.fit.prior.weight > 2
    assert (estimate.std <= known * (1 + 1e-6)).all()
    assert (np.abs(estimate.psi - true) < 1.96 * estimate.std).mean() > 0.9


def test_a_prior_has_what_is_known_and_how_it_counts():
    prior = Prior(np.zeros(2), np.diag([4.0, 9.0]))
    np.testing.assert_array_equal(prior.known, prior.precision)
    thrice = prior.weighted(3.0)
    np.testing.assert_allclose(thrice.precision, 3 * prior.precision)
    np.testing.assert_allclose(thrice.known, prior.precision)
    assert thrice.weighted(1.0).precision == pytest.approx(prior.precision)


def quadratic(seed, pieces=4, p=5):
    """A fit of linear equations, with pieces that involve all parameters but the last, which is held."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(pieces, 12, p))
    y = rows @ rng.normal(size=p) + 0.1 * rng.normal(size=(pieces, 12))
    free, prior = np.arange(p) < p - 1, np.diag([0, 0, 0, 0.5, 4.0])
    theta = solved(rows, y, prior, free)
    shares = [(X.T @ X, X.T @ (z - X @ theta)) for X, z in zip(rows, y, strict=True)]
    none = np.zeros(0)
    noise = Noise(np.zeros((3, 0)), none, none, np.zeros((3, 0)), none, np.zeros((3, 0)), none)
    names = [f"x{k}" for k in range(p)]
    fit = TrajectoryFit(names, [], Prior(np.zeros(p), prior), theta, shares, free, [noise], [], [], (), "converged")
    return fit, rows, y


def solved(rows, y, prior, free):
    A = rows[..., free].reshape(-1, free.sum())
    out = np.zeros(len(free))
    out[free] = np.linalg.solve(A.T @ A + prior[np.ix_(free, free)], A.T @ y.ravel())
    return out


@pytest.mark.parametrize("seed", range(3))
def test_parameters_without_a_piece(seed):
    fit, rows, y = quadratic(seed)
    for k in range(len(rows)):
        others = np.arange(len(rows)) != k
        expected = solved(rows[others], y[others], fit.prior.precision, fit.free)
        np.testing.assert_allclose(without(fit, slice(k, k + 1))[0], expected, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_gains_are_what_left_out_pieces_cost_less(seed):
    fit, rows, y = quadratic(seed)
    more = np.ones(5, bool)
    for k, gain in enumerate(gains(fit, np.eye(5)[[4]] > 0)[0]):
        others = np.arange(len(rows)) != k
        left = [solved(rows[others], y[others], fit.prior.precision, free) for free in (fit.free, more)]
        usual, freed = (np.sum((y[k] - rows[k] @ theta) ** 2) for theta in left)
        assert gain == pytest.approx(usual - freed)
    assert clearly_better(gains(fit, np.eye(5)[[4]] > 0)[0])


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [2, 9, 12, 15])
def test_an_interrupt_ends_every_stage(rounds):
    """In the choice of knots, of weights and of the set-up alike."""
    calls = []

    def interrupt(*_):
        calls.append(1)
        if len(calls) == rounds:
            raise KeyboardInterrupt

    log = prepared(PENDULUM, shortened(faulty(3, delay=0.03), 500))
    estimate = identified(log, report=interrupt)
    assert estimate.trajectory.fit.status == "interrupted" and len(calls) == rounds
    assert np.isfinite(estimate.std).all()


def test_white_weights_are_kept_unless_others_predict_clearly_better():
    """Channels that neither explains do not count."""
    white = np.array([0.2, 0.3, 1.0])
    assert not clearly_less(white, np.array([0.2, 0.295, 1.0]))
    assert clearly_less(white, np.array([0.15, 0.3, 1.0]))
    assert not clearly_less(np.ones(2), np.ones(2))
