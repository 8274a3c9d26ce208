"""Least squares in one pass, and covariances by a second one."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from fits import fitted, sampled
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, random_tree, sines
from scipy.signal import lfilter

from ident.errors import ExcitationError
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.consistency import consistent_parameters
from ident.regression import ordinary as module
from ident.regression.ordinary import check_excitation, huber_white

STD = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
CONSTANT = np.diag(STD**2)
EACH = np.tile(CONSTANT, (200, 1, 1))
LEVER = np.random.default_rng(5).normal(size=(200, 6, 6)) * 0.3
MOVING = CONSTANT + LEVER @ CONSTANT @ LEVER.transpose(0, 2, 1)
TREE = double_pendulum()
BASE = find_base_parameters(TREE, gravity=GRAVITY)
PHI = random_phi(np.random.default_rng(0), 3)
TRUTH = BASE.regroup(PHI)
STATES = random_states(np.random.default_rng(0), TREE, 200)
Y = base_wrench_regressor(TREE, *STATES, gravity=GRAVITY)


def identified(wrench, covariance=None):
    return fitted(TREE, sampled(*STATES, wrench, covariance=covariance), parameters=BASE)


@pytest.mark.parametrize("weights", [None, STD])
def test_least_squares_are_numpys_weighted_ones_on_whitened_rows(weights):
    wrench = Y @ PHI + STD * np.random.default_rng(1).normal(size=(200, 6))
    scale = np.ones(6) if weights is None else weights
    rows = (BASE.reduce(Y) / scale[:, None]).reshape(-1, 13)
    estimate = identified(wrench, None if weights is None else CONSTANT)
    psi, squares, _, s = np.linalg.lstsq(rows, (wrench / scale).ravel(), rcond=None)
    np.testing.assert_allclose(estimate.psi, psi, atol=1e-11)
    np.testing.assert_allclose(estimate.singular_values, s, rtol=1e-11)
    assert np.isclose(estimate.condition_number, s[0] / s[-1], rtol=1e-11)
    assert np.isclose(estimate.epsilon**2, squares[0], rtol=1e-11)
    if weights is None:
        residual = wrench - estimate.predicted(Motion(*STATES))
        np.testing.assert_allclose(estimate.residual_norms, np.linalg.norm(residual, axis=0), rtol=1e-11)
    else:
        np.testing.assert_allclose(estimate.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(identified(wrench, EACH).psi, psi, atol=1e-11)


@pytest.mark.parametrize("noise", [EACH, MOVING], ids=["constant", "moving"])
def test_standard_deviations_are_the_spread_of_the_estimates(noise):
    """One pass knows each component's own noise, two passes and a covariance also its correlation and changes."""
    rng, root, trials = np.random.default_rng(0), np.linalg.cholesky(noise), []
    for _ in range(100):
        wrench = Y @ PHI + (root @ rng.normal(size=(200, 6, 1)))[..., 0]
        trials.append([*both_passes(sampled(*STATES, wrench)), identified(wrench, noise)])
    for way, estimates in zip(("one pass", "two passes", "weighted"), zip(*trials, strict=True), strict=True):
        psi, std = (np.array([getattr(estimate, name) for estimate in estimates]) for name in ("psi", "std"))
        # 100 trials determine a standard deviation to 7 %.
        off = 0.6 if (way, noise is MOVING) == ("one pass", True) else 0.25
        np.testing.assert_allclose(std.mean(axis=0), psi.std(axis=0), rtol=off)
        assert (abs(psi.mean(axis=0) - TRUTH) < 4.5 * psi.std(axis=0) / np.sqrt(100)).all()


@pytest.mark.parametrize("seed", range(2))
def test_any_split_gives_the_same_answer(seed):
    """In any order, by one process or several threads."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, 4, kinds=("revolute", "ball"))
    states = random_states(rng, tree, 500)
    wrench = base_wrench_regressor(tree, *states, gravity=GRAVITY) @ rng.normal(size=10 * len(tree.inertial))
    whole = sampled(*states, wrench + rng.normal(size=wrench.shape))
    cuts = [0, *np.sort(rng.integers(1, 500, size=6)).tolist(), 500]
    parts = [whole[a:b] for a, b in pairwise(cuts) if a < b]
    rng.shuffle(parts)
    first = fitted(tree, whole)
    with ThreadPoolExecutor(2) as pool:
        for fit in (fitted(tree, parts), fitted(tree, iter(parts), executor=pool)):
            for name in ("psi", "covariance", "residual_norms", "singular_values"):
                np.testing.assert_allclose(getattr(fit, name), getattr(first, name), rtol=1e-8, atol=1e-11)


def triangle_with(share):
    """Unit columns with a + b + share c = 0."""
    b = np.array([-share / 2, np.sqrt(1 - share**2 / 4), 0])
    return np.column_stack([-b - [share, 0, 0], b, [1, 0, 0]])


@pytest.mark.parametrize(
    ("triangle", "message"),
    [
        (np.array([[1, 1, 0], [0, 4e-10, 0], [0, 0, 1.0]]), None),
        (np.array([[1, 1, 0], [0, 1e-10, 0], [0, 0, 1.0]]), "parameters a, b: 2 of 3"),
        (triangle_with(0.05), "parameters a, b: 2 of 3"),
        (triangle_with(0.2), "parameters a, b, c: 2 of 3"),
        (np.zeros((3, 3)), "parameters a, b, c: 0 of 3"),
    ],
)
def test_what_counts_as_excited_and_who_is_named(triangle, message):
    """Columns at a small angle exceed rounding errors."""
    with pytest.raises(ExcitationError, match=message) if message else nullcontext():
        check_excitation(triangle, ("a", "b", "c"), 10)


def test_a_message_on_many_parameters_is_no_page_long():
    names = [f"m{k}" for k in range(130)]
    with pytest.raises(ExcitationError, match=r"does not separate the base parameters m0, .*, m39, \.\.\.: 0") as error:
        check_excitation(np.zeros((130, 130)), names, 20)
    assert error.value.parameters == tuple(names)


def autoregressive(rng, correlation, samples=600):
    """Noise of the levels above with an autocorrelation at a lag of one sample."""
    u = rng.normal(size=(samples + 300, 6))
    return STD * np.sqrt(1 - correlation**2) * lfilter([1], [1, -correlation], u, axis=0)[300:]


RATES = 2 * np.pi * np.array([[0.31, 0.83], [0.47, 1.1]])
SMOOTH = sines(np.arange(600) / 100, np.array([[0.8, 0.5]] * 2), RATES, RATES)
"""A double pendulum that swings, recorded at 100 Hz."""

SWING = base_wrench_regressor(TREE, *SMOOTH, gravity=GRAVITY) @ PHI


def both_passes(samples):
    fit = fitted(TREE, samples, parameters=BASE)
    return fit, huber_white(fit, samples)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("correlation", "covariance", "one_pass", "two_passes"),
    [
        (0, None, (0.93, 0.97), (0.93, 0.97)),
        (0.9, None, (0, 0.5), (0.92, 0.985)),
        (0.9, CONSTANT, (0, 0.5), (0.92, 0.985)),
    ],
)
def test_intervals_hold_for_noise_that_is_correlated_over_time(correlation, covariance, one_pass, two_passes):
    """Two passes have full coverage for every parameter; one pass treats all noise as white."""
    rng, covered = np.random.default_rng(1), []
    for _ in range(200):
        trials = both_passes(sampled(*SMOOTH, SWING + autoregressive(rng, correlation), covariance=covariance))
        covered.append([abs(trial.psi - TRUTH) < 1.96 * trial.std for trial in trials])
    for (low, high), share in zip((one_pass, two_passes), np.mean(covered, axis=0), strict=True):
        assert low < share.mean() < high, share
    # 200 trials determine a coverage of 0.95 to 0.015.
    assert share.min() >= 0.9, share


def test_white_noise_leaves_huber_and_whites_formula(monkeypatch):
    """To the last digit if no correlation is significant, also in parts; five of six components have rows."""
    wrench = SWING + autoregressive(np.random.default_rng(1), 0)
    first, fit = both_passes(sampled(*SMOOTH, wrench))
    columns = BASE.reduce(base_wrench_regressor(TREE, *SMOOTH, gravity=GRAVITY))
    rows, residual = columns.reshape(-1, 13), wrench - columns @ fit.psi
    pulls, bread = np.einsum("ncr,nc->nr", columns, residual), np.linalg.inv(rows.T @ rows)
    usual = bread @ pulls.T @ pulls @ bread * 3000 / (3000 - 13)
    # Only the proportions of a covariance matter.
    one, nine = (both_passes(sampled(*SMOOTH, wrench, covariance=scale * CONSTANT))[1] for scale in (1, 9))
    np.testing.assert_allclose(nine.std, one.std, rtol=1e-9)
    monkeypatch.setattr(module, "PIECE", 300)
    for each in (fit, huber_white(first, sampled(*SMOOTH, wrench))):
        np.testing.assert_allclose(each.covariance, usual, rtol=1e-8, atol=1e-16)


@pytest.mark.parametrize("covariance", [None, np.tile(CONSTANT, (600, 1, 1))])
def test_a_second_pass_over_pieces_is_that_over_the_whole(monkeypatch, covariance):
    """Also if a part is longer than the pieces or shorter, with memory across the borders."""
    samples = sampled(*SMOOTH, SWING + autoregressive(np.random.default_rng(0), 0.9), covariance=covariance)
    first, whole = both_passes(samples)
    assert (whole.std > 2 * first.std).all()
    np.testing.assert_array_equal(whole.psi, first.psi)
    parts = [samples[a:b] for a, b in pairwise([0, *range(1, 60), 61, 300, 555, 600])]
    ways = [huber_white(first, source) for source in (parts, iter(parts))]
    for chunk in (64, 599):
        with monkeypatch.context() as patched:
            patched.setattr("ident.estimation.equations.CHUNK", chunk)
            ways.append(huber_white(first, iter(parts)))
    for fit in ways:
        np.testing.assert_allclose(fit.covariance, whole.covariance, rtol=1e-9, atol=1e-15)
    monkeypatch.setattr(module, "PIECE", 250)
    halves, of_parts = (huber_white(first, source) for source in (samples, parts))
    # Each half estimates its own correlation, and continues into the other.
    np.testing.assert_allclose(halves.std, whole.std, rtol=0.3)
    np.testing.assert_allclose(of_parts.std, halves.std, rtol=1e-9)


@pytest.mark.parametrize("steady", [True, False])
def test_a_covariance_is_symmetric_where_columns_are_nearly_dependent(steady):
    """Bodies near such an estimate were refused, with correlations that differed by 1e-8 from those across."""
    q, dq, ddq = STATES
    states = 1e-3 * q, 1e-3 * dq, 1e-3 * ddq
    wrench = base_wrench_regressor(TREE, *states, gravity=GRAVITY) @ PHI
    samples = sampled(*states, wrench + 1e-6 * STD * np.random.default_rng(1).normal(size=(200, 6)))
    estimate = huber_white(fitted(TREE, samples, parameters=BASE), samples, steady=steady)
    assert estimate.condition_number > 1e4
    assert (estimate.covariance == estimate.covariance.T).all()
    assert "kg" in str(consistent_parameters(estimate.psi, estimate.covariance, BASE, PHI))


def test_a_second_pass_takes_the_samples_of_the_first():
    samples = sampled(*SMOOTH, SWING)
    fit = fitted(TREE, samples)
    for other in (samples[:599], [samples, samples[:1]]):
        with pytest.raises(ValueError, match=r"made of 600 samples, these are (599|601)"):
            huber_white(fit, other)
    with pytest.raises(ValueError, match="covariance; those of an ordinary one have none"):
        huber_white(fit, sampled(*SMOOTH, SWING, covariance=CONSTANT))
