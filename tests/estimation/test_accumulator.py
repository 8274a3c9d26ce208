"""Sums of equations: accuracy, order and memory; entries left out are zero for all motions."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from fits import equations, fitted, sampled
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, random_tree, tilted_axis
from scipy import linalg

from ident.estimation.accumulator import accumulate, chunks, remembered_sums
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples, joined
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model import compiled
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
    wrench = base_wrench_regressor(tree, q, dq, ddq, gravity=GRAVITY) @ random_phi(rng, 3)
    return sampled(q, dq, ddq, wrench + noise * rng.normal(size=wrench.shape))


def by_householder(rows, target):
    """Householder's QR decomposition, in extended precision."""
    A, rank = np.column_stack([rows, target]).astype(np.longdouble), rows.shape[1]
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
    [(STRAIGHT, 0.5, 4e1), (STRAIGHT, 1e-4, 3e5), (TILTED, 0.3, 1.7e3), (TILTED, 5e-5, 1e7)],
)
def test_as_accurate_as_householder_in_extended_precision(tree, size, condition):
    """The error of one problem varies by factors of ten at random; the sum over several does not."""
    base, errors = find_base_parameters(tree, gravity=GRAVITY), []
    for seed in range(8):
        samples = moved_by(size, 250, tree=tree, noise=1e-6, seed=seed)
        Y = base_wrench_regressor(tree, *samples.motion.states, gravity=GRAVITY, columns=base.kept)
        rows, target = np.ascontiguousarray(Y).reshape(-1, base.rank), samples.measured.ravel()
        exact, (Q, R) = by_householder(rows, target), linalg.qr(rows, mode="economic")
        solutions = [linalg.solve_triangular(R, Q.T @ target)]
        for source in (samples, [samples[k : k + 50] for k in range(0, 250, 50)]):
            fit = fitted(tree, source, gravity=GRAVITY, parameters=base)
            assert condition / 8 < fit.condition_number < condition * 8
            solutions.append(fit.psi)
        errors.append([np.linalg.norm(psi - exact) / np.linalg.norm(exact) for psi in solutions])
    lapacks, whole, in_pieces = np.sum(errors, axis=0)
    assert max(whole, in_pieces) <= max(2 * lapacks, 5e-14)


def test_accumulators_add_in_any_order():
    known, sizes = equations(TILTED), (1.0, 1e-6, 0.1, 2.0)
    a, b, c, d = (accumulate(known, moved_by(size, 90, seed=k, tree=TILTED)) for k, size in enumerate(sizes))
    first, *others = (solve(each, known) for each in ((a + b) + (c + d), ((d + b) + a) + c, a + (c + (d + b))))
    for fit in others:
        np.testing.assert_allclose(fit.psi, first.psi, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(fit.covariance, first.covariance, rtol=1e-8, atol=1e-13)
        np.testing.assert_allclose(fit.residual_norms, first.residual_norms, rtol=1e-9)


def test_a_motion_after_a_long_rest_is_as_accurate_as_alone():
    """Coordinates of samples at rest are renewed where joints move, in later chunks and in later pieces."""
    base, posture = find_base_parameters(STRAIGHT, gravity=GRAVITY), np.zeros((2 * CHUNK, 2))
    rest = sampled(posture, posture, posture, np.zeros((2 * CHUNK, 6)))
    motion = moved_by(1.0, 2 * CHUNK, noise=1e-6)
    alone = fitted(STRAIGHT, motion, parameters=base)
    Y = base_wrench_regressor(STRAIGHT, *rest.motion.states, gravity=GRAVITY, columns=base.kept)
    still = replace(rest, measured=Y @ alone.psi)
    for on, source in ((False, joined([still, motion])), (True, [still, motion])):
        with compiled.switched(on):
            fit = fitted(STRAIGHT, source, parameters=base)
        assert fit.samples == 4 * CHUNK
        np.testing.assert_allclose(fit.psi, alone.psi, rtol=1e-10, atol=1e-11)
        np.testing.assert_allclose(fit.residual_norms, alone.residual_norms, rtol=1e-6)


def test_what_does_not_belong_together_does_not_add():
    samples, one = moved_by(1.0, 100), equations(STRAIGHT)
    apart = STRAIGHT.with_twists([[0, 0, 0, *tilted_axis(5, 120)], [0, 0, 0, *tilted_axis(9, 30)]])
    a, b = (accumulate(each, samples) for each in (one, equations(apart)))
    with pytest.raises(ValueError, match="same base parameters and weighting"):
        a + b
    with pytest.raises(ValueError, match=r"weighted: False\) and .* \(True\)"):
        a + accumulate(one, replace(samples, covariance=np.eye(6)))
    with pytest.raises(ValueError, match=r"accumulated for m1, .*, not for m1, "):
        solve(b, one)
    with pytest.raises(ValueError, match="a row for each of 0 samples"):
        accumulate(one, samples[:0])


def test_memory_is_flat(monkeypatch):
    """Memory above the inputs, and with inputs in pieces; also in a second pass."""

    def peak(work, *given, **options):
        tracemalloc.start()
        work(*given, **options)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most / 1e6

    long = moved_by(1.0, 40 * CHUNK)
    few, many = (peak(fitted, STRAIGHT, each) for each in (long[: 12 * CHUNK], long))
    assert many < 1.1 * few < 10
    assert peak(fitted, STRAIGHT, (moved_by(1.0, CHUNK, seed=k) for k in range(20))) < 10
    monkeypatch.setattr("ident.regression.ordinary.PIECE", 2 * CHUNK)
    peaks = []
    for count in (4, 20):
        parts = [long[k * 1000 : (k + 1) * 1000] for k in range(count * CHUNK // 1000)]
        peaks.append(peak(huber_white, fitted(STRAIGHT, parts), iter(parts)))
    assert peaks[1] < 1.1 * peaks[0] < 25


SAMPLES = 300


def random_equations(seed):
    """Equations of some or all wrench components, of joint torques with drives, or of both; and random samples."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, kinds=("revolute", "prismatic", "ball", "welded"))
    mechanism = Mechanism(tree, rng.normal(size=3))
    parameters, freedoms = Equations.of_wrench(mechanism).parameters, len(tree.freedoms)
    torques = tuple(range(freedoms)) if seed % 3 and freedoms else ()
    wrench = (None, np.eye(6)[:4], rng.normal(size=(2, 6)), np.zeros((0, 6)) if torques else None)[seed % 4]
    channels = tuple(f"c{k}" for k in range((6 if wrench is None else len(wrench)) + len(torques)))
    drives = tuple(f"Fv({tree.freedoms[k]})" for k in torques)
    equations = Equations(mechanism, parameters, wrench, torques, channels, drives, tuple(range(0, len(channels), 2)))
    motion = Motion(*random_states(rng, tree, SAMPLES))
    return equations, Samples(motion, rng.normal(size=(SAMPLES, len(channels)))), rng


@pytest.mark.parametrize("seed", range(4))
def test_gram_matrices_are_those_of_all_rows(seed):
    equations, samples, rng = random_equations(seed)
    order, _ = equations.order(samples)
    factor = np.triu(rng.normal(size=(len(order), len(order)))) + 5 * np.eye(len(order))
    factors = rng.uniform(0.5, 2, size=samples.measured.shape)
    rows = np.concatenate([chunk.copy() for chunk in equations.rows(samples, factors, order=order)], axis=2)
    Z = np.linalg.solve(factor.T, np.moveaxis(rows, 1, 0))
    expected = Z @ np.swapaxes(Z, 1, 2)
    for on in (False, True):
        with compiled.switched(on):
            grams = sum(chunk.grams(factor, None) for chunk in chunks(equations, samples, factors))
        np.testing.assert_allclose(grams, expected, rtol=0, atol=1e-11 * abs(expected).max())


@pytest.mark.parametrize(("seed", "samples"), list(enumerate([1, 63, 64, 130, 300, 65])))
def test_remembered_columns_are_recursions_over_all_samples(seed, samples):
    """By compiled code and by numpy, and in two parts."""
    equations, every, rng = random_equations(seed)
    some, channels, columns = every[:samples], len(equations.channels), len(equations.names)
    decay = rng.uniform(0, 0.99, channels) * (rng.uniform(size=channels) < 0.8)
    last = start = rng.normal(size=(channels, columns)) * equations._nonzero(moving=False)[:-1].T
    rows = np.concatenate([chunk[:-1].copy() for chunk in equations.rows(some)], axis=2)
    z = np.empty_like(rows)
    for n in range(samples):
        z[..., n] = rows[..., n] + (decay[:, None] * last).T
        last = z[..., n].T
    expected = np.einsum("kcn,lcn->ckl", z, z)
    for on in (False, True):
        with compiled.switched(on):
            for parts in ([some], [some[: samples // 3], some[samples // 3 :]]):
                left = start.copy()
                grams = sum(remembered_sums(equations, part, decay, left) for part in parts if len(part))
                np.testing.assert_allclose(grams, expected, rtol=0, atol=1e-11 * abs(expected).max(initial=1e-300))
                np.testing.assert_allclose(left, last, rtol=0, atol=1e-11 * max(abs(z).max(), 1e-300))
