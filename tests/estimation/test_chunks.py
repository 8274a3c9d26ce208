"""Entries left out of products are exactly those that are zero for all motions."""

import numpy as np
import pytest
from mechanisms import random_states, random_tree

from ident.estimation.accumulator import chunks, remembered_sums
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model import compiled

SAMPLES = 300


def random_equations(seed):
    """Equations of some or all wrench components, of joint torques with drives, or of both; and random samples."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, kinds=("revolute", "prismatic", "ball", "welded"))
    mechanism = Mechanism(tree, rng.normal(size=3))
    parameters, freedoms = Equations.of_wrench(mechanism).parameters, len(tree.freedoms)
    wrench = (None, np.eye(6)[:4], rng.normal(size=(2, 6)), np.zeros((0, 6)))[seed % 4]
    torques = tuple(range(freedoms)) if seed % 3 and freedoms else ()
    number = 6 if wrench is None else len(wrench)
    if not number + len(torques):
        wrench, number = None, 6
    channels = tuple(f"c{k}" for k in range(number + len(torques)))
    drives = tuple(f"Fv({tree.freedoms[k]})" for k in torques)
    equations = Equations(mechanism, parameters, wrench, torques, channels, drives, tuple(range(0, len(channels), 2)))
    motion = Motion(*random_states(rng, tree, SAMPLES))
    return equations, Samples(motion, rng.normal(size=(SAMPLES, len(channels))))


@pytest.mark.parametrize("seed", range(6))
def test_gram_matrices_are_those_of_all_rows(seed):
    equations, samples = random_equations(seed)
    order, _ = equations.order(samples)
    rng = np.random.default_rng(seed)
    factor = np.triu(rng.normal(size=(len(order), len(order)))) + 5 * np.eye(len(order))
    factors = rng.uniform(0.5, 2, size=samples.measured.shape)
    rows = np.concatenate([chunk.copy() for chunk in equations.rows(samples, factors, order=order)], axis=2)
    Z = np.linalg.solve(factor.T, np.moveaxis(rows, 1, 0))
    for on in (False, True):
        with compiled.switched(on):
            grams = sum(chunk.grams(factor, None) for chunk in chunks(equations, samples, factors))
        expected = Z @ np.swapaxes(Z, 1, 2)
        np.testing.assert_allclose(grams, expected, rtol=0, atol=1e-11 * abs(expected).max())


@pytest.mark.parametrize(("seed", "samples"), list(enumerate([1, 63, 64, 130, 300, 1, 63, 64, 130, 300, 65, 299])))
def test_remembered_columns_are_recursions_over_all_samples(seed, samples):
    """By compiled code and by numpy, and in two parts."""
    equations, every = random_equations(seed)
    rng, some = np.random.default_rng(seed), every[:samples]
    channels, columns = len(equations.channels), len(equations.names)
    decay = rng.uniform(0, 0.99, channels) * (rng.uniform(size=channels) < 0.8)
    start = rng.normal(size=(channels, columns)) * equations._nonzero(moving=False)[:-1].T
    rows = np.concatenate([chunk[:-1].copy() for chunk in equations.rows(some)], axis=2)
    z = np.empty_like(rows)
    last = start
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
                np.testing.assert_allclose(left, z[..., -1].T, rtol=0, atol=1e-11 * max(abs(z).max(), 1e-300))
