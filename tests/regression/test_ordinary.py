from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from itertools import pairwise

import numpy as np
import pytest
from fits import fitted, sampled
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, random_tree
from scipy.signal import lfilter

from ident.errors import ExcitationError
from ident.estimation.separation import check_excitation
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.regression import ordinary as module
from ident.regression.ordinary import huber_white

STD = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
CONSTANT = np.diag(STD**2)
LEVER = np.random.default_rng(5).normal(size=(200, 6, 6)) * 0.3
MOVING = CONSTANT + LEVER @ CONSTANT @ LEVER.transpose(0, 2, 1)
TREE = double_pendulum()
BASE = find_base_parameters(TREE, gravity=GRAVITY)
PHI = random_phi(np.random.default_rng(0), 3)
STATES = random_states(np.random.default_rng(0), TREE, 200)
Y = base_wrench_regressor(TREE, *STATES, gravity=GRAVITY)
ROWS = BASE.reduce(Y).reshape(-1, 13)


def identified(wrench, states=STATES, **options):
    covariance = options.pop("covariance", None)
    return fitted(TREE, sampled(*states, wrench, covariance=covariance), gravity=GRAVITY, **options)


def noisy(seed=1):
    return Y @ PHI + STD * np.random.default_rng(seed).normal(size=(200, 6))


@pytest.mark.parametrize("covariance", [None, CONSTANT, MOVING])
def test_without_noise_the_truth_comes_back(covariance):
    estimate = identified(Y @ PHI, covariance=covariance)
    np.testing.assert_allclose(estimate.psi, BASE.regroup(PHI), atol=1e-11)
    assert estimate.epsilon < 1e-9
    if covariance is None:
        assert estimate.rows == 5 * 200


def test_ordinary_least_squares_is_numpys():
    wrench = noisy()
    estimate = identified(wrench)
    psi, squares, _, s = np.linalg.lstsq(ROWS, wrench.ravel(), rcond=None)
    np.testing.assert_allclose(estimate.psi, psi, atol=1e-12)
    np.testing.assert_allclose(estimate.singular_values, s, rtol=1e-12)
    residual = wrench - estimate.predicted(Motion(*STATES))
    np.testing.assert_allclose(estimate.residual_norms, np.linalg.norm(residual, axis=0), rtol=1e-11)
    assert np.isclose(estimate.epsilon**2, squares[0], rtol=1e-12)
    assert np.isclose(estimate.condition_number, s[0] / s[-1], rtol=1e-12)


def test_weighted_least_squares_is_ordinary_on_whitened_rows():
    wrench = noisy()
    rows = (BASE.reduce(Y) / STD[:, None]).reshape(-1, 13)
    estimate = identified(wrench, covariance=CONSTANT)
    np.testing.assert_allclose(estimate.psi, np.linalg.lstsq(rows, (wrench / STD).ravel(), rcond=None)[0], atol=1e-11)
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(rows.T @ rows), rtol=1e-9, atol=1e-18)
    each = identified(wrench, covariance=np.tile(CONSTANT, (200, 1, 1)))
    np.testing.assert_allclose(each.psi, estimate.psi, atol=1e-12)


@pytest.mark.parametrize("noise", [np.tile(CONSTANT, (200, 1, 1)), MOVING], ids=["constant", "moving"])
def test_standard_deviations_are_the_spread_of_the_estimates(noise):
    """One pass knows each component's own noise, two passes and a covariance also its correlation and changes."""
    rng, root = np.random.default_rng(0), np.linalg.cholesky(noise)
    trials = []
    for _ in range(100):
        wrench = Y @ PHI + (root @ rng.normal(size=(200, 6, 1)))[..., 0]
        trials.append([*both_passes(sampled(*STATES, wrench)), identified(wrench, covariance=noise, parameters=BASE)])
    for way, estimates in zip(("one pass", "two passes", "weighted"), zip(*trials, strict=True), strict=True):
        spread = np.std([estimate.psi for estimate in estimates], axis=0)
        # 100 trials determine a standard deviation to 7 %.
        off = 0.6 if (way, noise is MOVING) == ("one pass", True) else 0.25
        np.testing.assert_allclose(np.mean([estimate.std for estimate in estimates], axis=0), spread, rtol=off)
        bias = np.mean([estimate.psi for estimate in estimates], axis=0) - BASE.regroup(PHI)
        assert (abs(bias) < 4.5 * spread / np.sqrt(100)).all()


@pytest.mark.parametrize("seed", range(4))
def test_any_split_gives_the_same_answer(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, 4, kinds=("revolute", "ball"))
    states = random_states(rng, tree, 500)
    wrench = base_wrench_regressor(tree, *states, gravity=GRAVITY) @ rng.normal(size=10 * len(tree.inertial))
    whole = sampled(*states, wrench + rng.normal(size=wrench.shape))
    cuts = [0, *np.sort(rng.integers(1, 500, size=6)).tolist(), 500]
    parts = [whole[a:b] for a, b in pairwise(cuts) if a < b]
    rng.shuffle(parts)
    first = fitted(tree, whole, gravity=GRAVITY)
    with ThreadPoolExecutor(2) as pool:
        for source, executor in ((parts, None), (iter(parts), pool)):
            fit = fitted(tree, source, gravity=GRAVITY, executor=executor)
            np.testing.assert_allclose(fit.psi, first.psi, rtol=1e-9, atol=1e-11)
            np.testing.assert_allclose(fit.covariance, first.covariance, rtol=1e-8, atol=1e-12)
            np.testing.assert_allclose(fit.residual_norms, first.residual_norms, rtol=1e-9)
            np.testing.assert_allclose(fit.singular_values, first.singular_values, rtol=1e-9)


def test_what_counts_as_excited_and_who_is_named():
    """Columns at a small angle exceed rounding errors, and columns half as long again as their noise exceed it."""
    names = ("a", "b", "c")
    for ratio, excited in ((2e-10, True), (0.5e-10, False)):
        triangle = np.eye(3)
        triangle[:2, 1] = 1, 2 * ratio
        with nullcontext() if excited else pytest.raises(ExcitationError, match="parameters a, b: 2 of 3"):
            check_excitation(triangle, names, 10)
    for level, excited in ((0.65, True), (0.68, False)):
        # Ten rows of noise represent those of ten samples, six times as many.
        noise = np.tile([level / np.sqrt(60), 0, 0], (10, 1))
        with nullcontext() if excited else pytest.raises(ExcitationError, match="parameters a: 2 of 3"):
            check_excitation(np.eye(3), names, 10, noise)
    # Unit columns with a + b + share c = 0, in which c is named from a share of a tenth on.
    for share, named in ((0.05, "a, b"), (0.2, "a, b, c")):
        b = np.array([-share / 2, np.sqrt(1 - share**2 / 4), 0])
        triangle = np.column_stack([-b - [share, 0, 0], b, [1, 0, 0]])
        with pytest.raises(ExcitationError, match=f"parameters {named}: 2 of 3"):
            check_excitation(triangle, names, 10)
    with pytest.raises(ExcitationError, match="parameters a, b, c: 0 of 3"):
        check_excitation(np.zeros((3, 3)), names, 10)


def smooth_states(samples=600):
    """A double pendulum that swings, recorded at 100 Hz."""
    t = np.arange(samples)[:, None] / 100
    waves = [(0.8, 2 * np.pi * np.array([0.31, 0.47])), (0.5, 2 * np.pi * np.array([0.83, 1.1]))]
    q = sum(size * np.sin(rate * t + rate) for size, rate in waves)
    dq = sum(size * rate * np.cos(rate * t + rate) for size, rate in waves)
    return q, dq, -sum(size * rate**2 * np.sin(rate * t + rate) for size, rate in waves)


def autoregressive(rng, correlation, samples=600):
    """Noise of the levels above with an autocorrelation at a lag of one sample."""
    u = rng.normal(size=(samples + 300, 6))
    return STD * np.sqrt(1 - correlation**2) * lfilter([1], [1, -correlation], u, axis=0)[300:]


SMOOTH = smooth_states()
SWING = base_wrench_regressor(TREE, *SMOOTH, gravity=GRAVITY) @ PHI


def both_passes(samples, parameters=BASE):
    fit = fitted(TREE, samples, gravity=GRAVITY, parameters=parameters)
    return fit, huber_white(fit, samples)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("correlation", "weighted", "one_pass", "two_passes"),
    [
        (0, False, (0.93, 0.97), (0.93, 0.97)),
        (0.9, False, (0, 0.5), (0.92, 0.985)),
        (0.9, True, (0, 0.5), (0.92, 0.985)),
    ],
)
def test_intervals_hold_for_noise_that_is_correlated_over_time(correlation, weighted, one_pass, two_passes):
    """Two passes have full coverage for every parameter; one pass treats all noise as white."""
    rng, covered = np.random.default_rng(1), []
    covariance = CONSTANT if weighted else None
    for _ in range(200):
        wrench = SWING + autoregressive(rng, correlation)
        trials = both_passes(sampled(*SMOOTH, wrench, covariance=covariance))
        covered.append([abs(trial.psi - BASE.regroup(PHI)) < 1.96 * trial.std for trial in trials])
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
    with monkeypatch.context() as patched:
        patched.setattr(module, "PIECE", 300)
        in_parts = huber_white(first, sampled(*SMOOTH, wrench))
    for covariance in (fit.covariance, in_parts.covariance):
        np.testing.assert_allclose(covariance, usual, rtol=1e-8, atol=1e-16)
    # Only the proportions of a covariance matter.
    one, nine = (both_passes(sampled(*SMOOTH, wrench, covariance=scale * CONSTANT))[1] for scale in (1, 9))
    np.testing.assert_allclose(nine.std, one.std, rtol=1e-9)


@pytest.mark.parametrize("weighted", [False, True])
def test_a_second_pass_over_pieces_is_that_over_the_whole(monkeypatch, weighted):
    """Also if a part is longer than the pieces or shorter, with memory across the borders."""
    wrench = SWING + autoregressive(np.random.default_rng(0), 0.9)
    covariance = np.tile(CONSTANT, (600, 1, 1)) if weighted else None
    samples = sampled(*SMOOTH, wrench, covariance=covariance)
    first, whole = both_passes(samples)
    cuts = [0, *range(1, 60), 61, 300, 555, 600]
    parts = [samples[a:b] for a, b in pairwise(cuts)]
    ways = [huber_white(first, source) for source in (parts, iter(parts))]
    for chunk in (64, 599):
        with monkeypatch.context() as patched:
            patched.setattr("ident.estimation.equations.chunk", lambda program, size=chunk: size)
            ways.append(huber_white(first, iter(parts)))
    for fit in ways:
        np.testing.assert_allclose(fit.covariance, whole.covariance, rtol=1e-9, atol=1e-15)
    monkeypatch.setattr(module, "PIECE", 250)
    for source in (samples, parts):
        halves = huber_white(first, source)
        # Each half estimates its own correlation, and continues into the other.
        np.testing.assert_allclose(halves.std, whole.std, rtol=0.3)
    np.testing.assert_allclose(halves.std, huber_white(first, samples).std, rtol=1e-9)


def test_a_second_pass_takes_the_samples_of_the_first():
    samples = sampled(*SMOOTH, SWING)
    fit = fitted(TREE, samples, gravity=GRAVITY)
    for other in (samples[:599], [samples, samples[:1]]):
        with pytest.raises(ValueError, match=r"made of 600 samples, these are (599|601)"):
            huber_white(fit, other)
    with pytest.raises(ValueError, match="covariance; those of an ordinary one have none"):
        huber_white(fit, sampled(*SMOOTH, SWING, covariance=CONSTANT))


def test_an_estimate_says_what_its_standard_deviations_take_the_noise_for():
    one, two = both_passes(sampled(*SMOOTH, SWING + autoregressive(np.random.default_rng(0), 0.9)))
    assert (one.noise, two.noise) == ("white from sample to sample", "correlated over time or not")
    assert (two.std > 2 * one.std).all()
    np.testing.assert_array_equal(two.psi, one.psi)


def test_a_message_on_many_parameters_is_no_page_long():
    names = [f"m{k}" for k in range(130)]
    with pytest.raises(ExcitationError, match=r"does not separate the base parameters m0, .*, m39, \.\.\.: 0") as error:
        check_excitation(np.zeros((130, 130)), names, 20)
    assert error.value.parameters == tuple(names)
