import numpy as np
import pytest
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states

from ident.base_parameters import find_base_parameters
from ident.estimate import ExcitationError, check_excitation, identify
from ident.inertia import parameter_names
from ident.regressor import base_wrench_regressor

STD = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
CONSTANT = np.diag(STD**2)
LEVER = np.random.default_rng(5).normal(size=(200, 6, 6)) * 0.3
MOVING = CONSTANT + LEVER @ CONSTANT @ LEVER.transpose(0, 2, 1)
TREE = double_pendulum()


def regressor_of(states):
    return base_wrench_regressor(TREE, *states, gravity=GRAVITY)


@pytest.fixture
def case():
    rng = np.random.default_rng(0)
    Y = regressor_of(random_states(rng, TREE, 200))
    return rng, Y, find_base_parameters(Y, parameter_names(3)), random_phi(rng, 3)


@pytest.mark.parametrize("covariance", [None, CONSTANT, MOVING])
def test_without_noise_the_truth_comes_back(case, covariance):
    _, Y, base, phi = case
    estimate = identify(Y, Y @ phi, base, covariance=covariance)
    np.testing.assert_allclose(estimate.psi, base.regroup(phi), atol=1e-11)
    assert estimate.rows == 5 * 200
    assert estimate.epsilon < 1e-9


def test_ordinary_least_squares_is_numpys(case):
    rng, Y, base, phi = case
    wrench = Y @ phi + STD * rng.normal(size=(200, 6))
    estimate = identify(Y, wrench, base)
    rows = base.reduce(Y).reshape(-1, 13)
    psi, squares, _, s = np.linalg.lstsq(rows, wrench.ravel(), rcond=None)
    np.testing.assert_allclose(estimate.psi, psi, atol=1e-10)
    assert np.isclose(estimate.epsilon**2, squares[0])
    assert np.isclose(estimate.condition_number, s[0] / s[-1])
    np.testing.assert_allclose(estimate.predicted + estimate.residual, wrench, atol=1e-12)


def test_weighted_least_squares_is_ordinary_on_whitened_rows(case):
    rng, Y, base, phi = case
    wrench = Y @ phi + STD * rng.normal(size=(200, 6))
    rows = (base.reduce(Y) / STD[:, None]).reshape(-1, 13)
    estimate = identify(Y, wrench, base, covariance=CONSTANT)
    np.testing.assert_allclose(estimate.psi, np.linalg.lstsq(rows, (wrench / STD).ravel(), rcond=None)[0], atol=1e-10)
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("noise", [np.tile(CONSTANT, (200, 1, 1)), MOVING], ids=["constant", "moving"])
@pytest.mark.parametrize("weighted", [False, True])
def test_standard_deviations_are_the_spread_of_the_estimates(case, noise, weighted):
    rng, Y, base, phi = case
    root = np.linalg.cholesky(noise)
    trials = []
    for _ in range(600):
        wrench = Y @ phi + (root @ rng.normal(size=(200, 6, 1)))[..., 0]
        trials.append(identify(Y, wrench, base, covariance=noise if weighted else None))
    spread = np.std([trial.psi for trial in trials], axis=0)
    # 600 trials know a standard deviation to 3 %; 13 of them stay within 4 standard errors.
    np.testing.assert_allclose(np.mean([trial.std for trial in trials], axis=0), spread, rtol=0.12)
    bias = np.mean([trial.psi for trial in trials], axis=0) - base.regroup(phi)
    assert (abs(bias) < 4.5 * spread / np.sqrt(600)).all()


def test_a_covariance_must_be_one(case):
    _, Y, base, phi = case
    with pytest.raises(ValueError, match="positive definite"):
        identify(Y, Y @ phi, base, covariance=np.zeros((6, 6)))


def test_weights_reduce_the_uncertainty(case):
    rng, Y, base, phi = case
    wrench = Y @ phi + STD * rng.normal(size=(200, 6))
    ratio = identify(Y, wrench, base, covariance=CONSTANT).std / identify(Y, wrench, base).std
    # Ten times less noise on the moments is worth most where they say most; residuals know a std to some 10 %.
    assert ratio.max() < 1.4
    assert ratio.min() < 0.5


def test_bad_numbers_are_refused(case):
    _, Y, base, phi = case
    wrench = Y @ phi
    with pytest.raises(ValueError, match=r"wrenches \(N, 6\), got \(200, 6, 30\) and \(199, 6\)"):
        identify(Y, wrench[1:], base)
    wrench[3, 2] = np.nan
    with pytest.raises(ValueError, match="finite numbers, got NaN"):
        identify(Y, wrench, base)


def test_a_joint_at_rest_is_named(case):
    rng, _, base, phi = case
    states = np.stack(random_states(rng, TREE, 200))
    states[:, :, 1] = 0
    Y = regressor_of(states)
    with pytest.raises(ExcitationError, match=r"200 samples.*m2rz2.*m3rz3.* combinations"):
        identify(Y, Y @ phi, base)


def test_noise_alone_is_not_excitation(case):
    rng, _, base, _ = case
    noise = np.array([0.001, 0.01, 0.05])[:, None, None]
    states = np.stack(random_states(rng, TREE, 200))
    states[:, :, 1] = 0
    measured, disturbed = (regressor_of(states + noise * rng.normal(size=states.shape)) for _ in range(2))
    check_excitation(measured, base)
    with pytest.raises(ExcitationError):
        check_excitation(measured, base, disturbed - measured)
    moving = np.stack(random_states(rng, TREE, 200))
    measured, disturbed = (regressor_of(moving + noise * rng.normal(size=moving.shape)) for _ in range(2))
    check_excitation(measured, base, disturbed - measured)


def test_too_few_samples_are_not_enough(case):
    rng, _, base, phi = case
    Y = regressor_of(random_states(rng, TREE, 2))
    with pytest.raises(ExcitationError, match="2 samples"):
        identify(Y, Y @ phi, base)
