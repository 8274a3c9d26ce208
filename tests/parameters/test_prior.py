"""Priors on bodies: against random bodies, in other frames, and for all parameters of a tree."""

import numpy as np
import pytest
from scipy.linalg import block_diag

import scenes
import sim
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.parameters.base_parameters import find_base_parameters, structural_base_parameters
from ident.parameters.prior import (
    KNOWN,
    body_covariance,
    conditioned,
    known_covariance,
    known_covariances,
    parameters_identified,
)
from sim.models.model_mechanism import mechanism

CENTRAL = np.array([[0.06, 0.01, -0.005], [0.01, 0.05, 0.002], [-0.005, 0.002, 0.03]])
BODIES = {
    "far from its frame": parameters_from_com(3.0, [0.1, -0.05, 0.3], CENTRAL),
    "around its frame": parameters_from_com(3.0, np.zeros(3), CENTRAL),
    "a point": parameters_from_com(0.5, np.zeros(3), np.zeros((3, 3))),
}


def drawn(phi, known, count, rng):
    """φ of bodies with errors of mass, centre of mass and central inertia (count, 10)."""
    mass, center, inertia = com_from_parameters(phi)
    values, axes = np.linalg.eigh(inertia)
    root = (axes * np.sqrt(np.maximum(values, 0))) @ axes.T
    m = mass * (1 + known["mass"] * rng.normal(size=count))
    c = center + known["center"] * rng.normal(size=(count, 3))
    # (G + Gᵀ) / 2 has variance 1 on the diagonal and 1/2 off it.
    G = rng.normal(size=(count, 3, 3))
    tensor = inertia + known["inertia"] * root @ ((G + G.swapaxes(1, 2)) / 2) @ root
    squares = np.sum(c**2, axis=1)[:, None, None] * np.eye(3) - c[:, :, None] * c[:, None, :]
    tensor += m[:, None, None] * squares
    return np.column_stack(
        [m, m[:, None] * c, *(tensor[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))]
    )


@pytest.mark.parametrize("known", [KNOWN, {"mass": 0.4, "center": 0.02, "inertia": 0.1}], ids=["usual", "other"])
@pytest.mark.parametrize("body", BODIES)
def test_bodies_that_are_drawn_deviate_as_is_known(body, known):
    phi, count = BODIES[body], 50_000
    off = drawn(phi, known, count, np.random.default_rng(0)) - phi
    products = off[:, :, None] * off[:, None, :]
    error = products.std(axis=0) / np.sqrt(count)
    assert (abs(products.mean(axis=0) - body_covariance(phi, known)) <= 5 * error + 1e-12).all()


def test_all_parameters_follow_from_an_estimate_of_base_parameters():
    arm, rng = sim.mechanism(scenes.load("humanoid"), base="pelvis"), np.random.default_rng(0)
    base = structural_base_parameters(arm)
    S, prior = block_diag(*known_covariances(arm)), base.regroup(arm.known)
    B = base.regroup(np.eye(len(S))).T
    before = known_covariance(arm, base)
    np.testing.assert_allclose(B @ S @ B.T, before, atol=1e-6 * np.diag(before).max())
    # Observed base parameters, and the estimate with their prior.
    noise = np.diag(rng.uniform(0.1, 2, size=len(prior)) * np.diag(before))
    measured = prior + rng.normal(size=len(prior)) * np.sqrt(np.diag(before + noise))
    phi, std = conditioned(arm, base, measured, noise, included=False)
    direct = S @ B.T @ np.linalg.inv(before + noise)
    np.testing.assert_allclose(phi, arm.known + direct @ (measured - prior), rtol=1e-5, atol=1e-8)
    variance = np.diag(S - direct @ B @ S)
    np.testing.assert_allclose(std, np.sqrt(variance), rtol=1e-4, atol=1e-9)


@pytest.fixture(scope="module")
def arm():
    return mechanism(scenes.load("double_pendulum"), "base")


def test_the_variances_that_bayes_rule_leaves(arm):
    base = find_base_parameters(arm)
    L = np.random.default_rng(0).normal(size=(base.rank, base.rank))
    covariance = 1e-3 * L @ L.T
    S = block_diag(*known_covariances(arm))
    B = base.regroup(np.eye(len(S))).T
    information = B.T @ np.linalg.inv(covariance) @ B
    after = np.linalg.inv(np.linalg.inv(S) + information)
    expected = (1 - np.diag(np.linalg.solve(S, after))).reshape(-1, 10).sum(axis=1)
    identified = parameters_identified(arm, base, covariance)
    np.testing.assert_allclose(identified, expected, atol=1e-4)
    # The same with the prior included in the estimate.
    both = np.linalg.inv(np.linalg.inv(covariance) + np.linalg.inv(B @ S @ B.T))
    np.testing.assert_allclose(parameters_identified(arm, base, both, included=True), identified, atol=1e-4)


def test_nothing_is_told_by_noise_and_no_more_than_the_rank_by_perfect_data(arm):
    base = find_base_parameters(arm)
    assert parameters_identified(arm, base, 1e12 * np.eye(base.rank)).max() < 1e-6
    perfect = parameters_identified(arm, base, 1e-12 * np.eye(base.rank))
    assert perfect.sum() == pytest.approx(base.rank, abs=0.01) and perfect.max() <= 10
