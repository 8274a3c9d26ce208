import tracemalloc
from dataclasses import replace
from functools import partial, reduce
from operator import add

import numpy as np
import pytest
from fits import equations, fitted, sampled
from mechanisms import GRAVITY, double_pendulum, random_phi, tilted_axis
from scipy import linalg

from ident.estimation.accumulator import accumulate
from ident.model.regressor import CHUNK, base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.regression.ordinary import huber_white, solve

STRAIGHT = double_pendulum()
TILTED = STRAIGHT.with_twists(np.tile([0, 0, 0, *tilted_axis(5, 120)], (2, 1)))


def moved_by(size, samples=3000, seed=0, tree=STRAIGHT, noise=1e-3):
    """Motions of some size about one posture: the smaller, the more alike are the columns of the regressor."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=2) + size * rng.normal(size=(samples, 2))
    dq, ddq = size * rng.normal(size=(2, samples, 2))
    phi = random_phi(rng, 3)
    wrench = base_wrench_regressor(tree, q, dq, ddq, gravity=GRAVITY) @ phi
    return sampled(q, dq, ddq, wrench + noise * rng.normal(size=wrench.shape))


def rows_of(tree, samples, base):
    Y = base_wrench_regressor(tree, *samples.motion.states, gravity=GRAVITY, columns=base.kept)
    return np.ascontiguousarray(Y).reshape(-1, base.rank)


def by_householder(rows, target):
    """Householder's QR decomposition, in the precision of its input."""
    A = np.column_stack([rows, target])
    rank = rows.shape[1]
    for k in range(rank):
        x = A[k:, k].copy()
        x[0] += np.copysign(np.sqrt((x * x).sum()), x[0])
        x /= np.sqrt((x * x).sum())
        A[k:, k:] -= 2 * np.outer(x, x @ A[k:, k:])
    psi = np.zeros(rank, A.dtype)
    for k in reversed(range(rank)):
        psi[k] = (A[k, rank] - A[k, k + 1 : rank] @ psi[k + 1 :]) / A[k, k]
    return psi


@pytest.mark.parametrize(
    ("tree", "size", "condition"),
    [
        (STRAIGHT, 0.5, 4e1),
        (STRAIGHT, 1e-2, 3e3),
        (STRAIGHT, 1e-4, 3e5),
        (TILTED, 0.3, 1.7e3),
        (TILTED, 1e-3, 3e5),
        (TILTED, 5e-5, 1e7),
    ],
)
def test_as_accurate_as_householder_in_extended_precision(tree, size, condition, noise=1e-6):
    """The error of one problem varies by factors of ten at random; the sum over several does not."""
    base, errors = find_base_parameters(tree, gravity=GRAVITY), []
    for seed in range(8):
        samples = moved_by(size, 250, tree=tree, noise=noise, seed=seed)
        rows, target = rows_of(tree, samples, base), samples.measured.ravel()
        exact = by_householder(rows.astype(np.longdouble), target.astype(np.longdouble))
        Q, R = linalg.qr(rows, mode="economic")
        solutions = [linalg.solve_triangular(R, Q.T @ target)]
        for source in (samples, [samples[k : k + 50] for k in range(0, 250, 50)]):
            fit = fitted(tree, source, gravity=GRAVITY, parameters=base)
            assert condition / 8 < fit.condition_number < condition * 8
            solutions.append(fit.psi)
        errors.append([np.linalg.norm(psi - exact) / np.linalg.norm(exact) for psi in solutions])
    lapacks, whole, in_pieces = np.sum(errors, axis=0)
    assert max(whole, in_pieces) <= max(2 * lapacks, 5e-14)


def test_accumulators_add_in_any_order():
    base = find_base_parameters(TILTED, gravity=GRAVITY)
    sizes = (1.0, 1e-6, 0.1, 2.0, 1e-3)
    parts = [moved_by(size, 50 + 40 * k, seed=k, tree=TILTED) for k, size in enumerate(sizes)]
    known = equations(TILTED, base)
    own = [accumulate(known, part) for part in parts]
    first = solve(reduce(add, own), known)
    for order in np.random.default_rng(0).permuted(np.tile(range(5), (6, 1)), axis=1):
        fit = solve(reduce(add, [own[k] for k in order]), known)
        np.testing.assert_allclose(fit.psi, first.psi, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(fit.covariance, first.covariance, rtol=1e-8, atol=1e-13)
        np.testing.assert_allclose(fit.residual_norms, first.residual_norms, rtol=1e-9)
    left = (own[0] + own[1]) + (own[2] + (own[3] + own[4]))
    np.testing.assert_allclose(solve(left, known).psi, first.psi, rtol=1e-9, atol=1e-10)
    assert left.samples == sum(map(len, parts)) and left.chunks == 5


def test_what_does_not_belong_together_does_not_add():
    samples = moved_by(1.0, 100)
    one = equations(STRAIGHT)
    a = accumulate(one, samples)
    apart = STRAIGHT.with_twists([[0, 0, 0, *tilted_axis(5, 120)], [0, 0, 0, *tilted_axis(9, 30)]])
    b = accumulate(equations(apart), samples)
    weighted = replace(samples, covariance=np.eye(6))
    with pytest.raises(ValueError, match="same base parameters and weighting"):
        a + b
    with pytest.raises(ValueError, match=r"weighted: False\) and .* \(True\)"):
        a + accumulate(one, weighted)
    with pytest.raises(ValueError, match=r"accumulated for m1, .*, not for m1, "):
        solve(b, one)
    with pytest.raises(ValueError, match="a row for each of 0 samples"):
        accumulate(one, samples[:0])


def test_memory_is_flat(monkeypatch):
    """Memory above the inputs, and with inputs in pieces; also in a second pass."""

    def peak(source, work=fitted):
        tracemalloc.start()
        work(STRAIGHT, source, gravity=GRAVITY)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most / 1e6

    long = moved_by(1.0, 20 * CHUNK)
    few, many = peak(long[: 6 * CHUNK]), peak(long)
    assert many < 1.1 * few < 10
    made = (moved_by(1.0, CHUNK, seed=k) for k in range(20))
    assert peak(made) < 10
    monkeypatch.setattr("ident.regression.ordinary.PIECE", 2 * CHUNK)
    peaks = []
    for count in (4, 20):
        parts = [long[k * 1000 : (k + 1) * 1000] for k in range(count * CHUNK // 1000)]
        second = partial(_second_pass, fitted(STRAIGHT, parts, gravity=GRAVITY))
        peaks.append(peak(iter(parts), second))
    assert peaks[1] < 1.1 * peaks[0] < 25


def _second_pass(fit, tree, source, *, gravity):
    huber_white(fit, source)
