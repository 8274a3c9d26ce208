from dataclasses import replace

import numpy as np
import pytest
from bodies import bodies, forms, regrouping, unphysical
from mechanisms import GRAVITY, random_phi, random_states, random_tree
from scipy.linalg import block_diag
from scipy.optimize import brentq, minimize

from ident.geometry.inertia import PARAMETERS, parameters_from_pseudo_inertia, pseudo_inertia
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.consistency import consistent_parameters, physical_prior

SEEDS = range(8)
EXACT = 1e-12
"""Factor on a covariance at which ψ is practically exact."""


def mechanism(seed, bodies=None):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, bodies)
    base, count = find_base_parameters(tree), len(tree.inertial)
    root = rng.normal(size=(base.rank, base.rank))
    covariance = 1e-4 * (root @ root.T + np.eye(base.rank))
    return rng, tree, base, random_phi(rng, count), random_phi(rng, count), covariance


def assert_physical(phi):
    assert (np.linalg.eigvalsh(bodies(phi)) > 0).all()


@pytest.mark.parametrize("count", [2, 3, 8, 15, 30])
def test_base_parameters_of_physical_bodies_are_kept_and_so_is_the_wrench(count):
    rng, tree, base, truth, prior, covariance = mechanism(count, count)
    psi = base.regroup(truth)
    consistent = consistent_parameters(psi, EXACT * covariance, base, prior)
    assert consistent.attainable and not consistent.moved() and consistent.raised == ()
    np.testing.assert_allclose(base.regroup(consistent.phi), psi, atol=1e-9 * abs(psi).max())
    np.testing.assert_array_equal(consistent.psi, base.regroup(consistent.phi))
    assert_physical(consistent.phi)
    Y = base_wrench_regressor(tree, *random_states(rng, tree, 50), gravity=GRAVITY)
    np.testing.assert_allclose(Y @ consistent.phi, Y @ truth, atol=1e-9 * abs(Y @ truth).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_no_other_physical_bodies_with_these_base_parameters_are_closer_to_the_prior(seed):
    """The gradient `P⁻¹ - J⁻¹` of the convex divergence is zero in all directions that keep ψ."""
    _, _, base, truth, prior, covariance = mechanism(seed)
    consistent = consistent_parameters(base.regroup(truth), covariance, base, prior)
    gradient = np.linalg.inv(bodies(prior)) - np.linalg.inv(bodies(consistent.phi))
    along = np.einsum("bij,kij->bk", gradient, pseudo_inertia(np.eye(10))).ravel()
    A = regrouping(base)
    np.testing.assert_allclose(A.T @ np.linalg.lstsq(A.T, along, rcond=None)[0], along, atol=1e-7 * abs(gradient).max())
    ratio = np.linalg.solve(bodies(prior), bodies(consistent.phi))
    divergence = np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - 4
    np.testing.assert_allclose(consistent.divergence, divergence, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS[::2])
def test_base_parameters_that_no_bodies_have_move_to_the_nearest_that_some_have(seed):
    """Compared with a search over all `J = L Lᵀ` that starts at the solution."""
    rng, _, base, truth, prior, covariance = mechanism(seed, 3)
    psi = base.regroup(truth)
    psi = psi - abs(psi) * rng.uniform(2, 4, size=len(psi))
    consistent = consistent_parameters(psi, covariance, base, prior)
    assert not consistent.attainable
    assert_physical(consistent.phi)
    np.testing.assert_allclose(consistent.shift, (consistent.psi - psi) / np.sqrt(np.diag(covariance)))
    moves = [abs(by) for _, by in consistent.moved()]
    assert moves == sorted(moves, reverse=True) and moves[0] == abs(consistent.shift).max()
    root, P = np.linalg.cholesky(covariance), np.linalg.cholesky(bodies(prior))

    def square(L):
        L = P @ L.reshape(-1, 4, 4)
        off = np.linalg.solve(
            root, base.regroup(parameters_from_pseudo_inertia(L @ np.swapaxes(L, 1, 2)).ravel()) - psi
        )
        slope = forms(regrouping(base).T @ np.linalg.solve(root.T, off))
        return off @ off, (4 * np.swapaxes(P, 1, 2) @ slope @ L).ravel()

    start = np.linalg.cholesky(np.linalg.solve(P, np.swapaxes(np.linalg.solve(P, bodies(consistent.phi)), 1, 2)))
    np.testing.assert_allclose(square(start.ravel())[0], consistent.distance**2, rtol=1e-9)
    best = minimize(square, start.ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 200})
    larger = np.sum(best.x**2) / (4 * len(P))
    assert consistent.distance**2 <= (1 + 1e-3 * max(1, larger / 10)) * best.fun


@pytest.mark.parametrize(("seed", "attainable"), [*((k, True) for k in SEEDS[::2]), (0, False), (4, False)])
def test_units_do_not_matter(seed, attainable):
    """Tonnes and millimetres give the same bodies."""
    _, _, base, truth, prior, covariance = mechanism(seed)
    psi = base.regroup(truth) if attainable else -base.regroup(truth)
    mass, length = 1e-3, 1e3
    power = [0 if name == "m" else 1 if name.startswith("mr") else 2 for name in PARAMETERS]
    scale = np.tile(mass * length ** np.array(power, float), len(prior) // 10)
    kept, dependent = scale[list(base.kept)], scale[list(base.dependent)]
    scaled = replace(base, beta=kept[:, None] * base.beta / dependent)
    consistent = consistent_parameters(psi, covariance, base, prior)
    again = consistent_parameters(kept * psi, np.outer(kept, kept) * covariance, scaled, scale * prior)
    assert again.attainable == consistent.attainable == attainable
    np.testing.assert_allclose(again.distance, consistent.distance, rtol=1e-2, atol=1e-6)
    if attainable:
        np.testing.assert_allclose(again.phi / scale, consistent.phi, atol=1e-9 * abs(consistent.phi).max())


def test_a_prior_without_mass_or_extent_is_raised_to_a_minimum():
    _, _, base, truth, prior, covariance = mechanism(4, 4)
    prior[:10] = 0
    prior[14:20] = 0
    prior[11:14] = 0
    prior[34] = -1
    consistent = consistent_parameters(base.regroup(truth), covariance, base, prior)
    assert consistent.raised == (0, 1, 3)
    assert_physical(consistent.prior)
    assert_physical(consistent.phi)
    np.testing.assert_allclose(consistent.prior[20:30], prior[20:30], atol=1e-12)
    np.testing.assert_allclose(consistent.prior[0], 1e-6 * prior[[0, 10, 20, 30]].sum())
    larger, raised = physical_prior(prior, minimum=0.1)
    assert {0, 1, 3} <= set(raised)
    assert larger[0] > consistent.prior[0]


def test_duality_proves_that_no_bodies_as_near_to_psi_are_closer_to_the_prior():
    """A multiplier λ bounds the divergence of all J with ψ within d: `λᵀψ - d |λ| + Σ log det(P⁻¹ - A*λ) P`."""
    unattainable = 0
    for seed in range(20):
        base, prior, psi, covariance = unphysical(seed, 2 + seed % 5)
        consistent = consistent_parameters(psi, covariance, base, prior)
        unattainable += not consistent.attainable
        A, inverse = forms(regrouping(base)), np.linalg.inv(bodies(prior))
        gradient = inverse - np.linalg.inv(bodies(consistent.phi))
        multiplier = np.linalg.lstsq(A.reshape(len(psi), -1).T, gradient.ravel(), rcond=None)[0]
        room = consistent.distance * np.sqrt(multiplier @ covariance @ multiplier)
        sign, volume = np.linalg.slogdet((inverse - np.tensordot(multiplier, A, 1)) @ bodies(prior))
        assert (sign > 0).all()
        assert consistent.divergence.sum() <= 1.001 * (multiplier @ psi - room + volume.sum())
    assert unattainable >= 8


def everything(base):
    """A regrouping in which all parameters are base parameters."""
    count = len(base.parameters)
    return replace(base, kept=tuple(range(count)), dependent=(), beta=np.zeros((count, 0)))


@pytest.mark.parametrize("excess", [1.2, 2.0, 10.0])
def test_the_prior_counts_as_the_likelihood_of_its_width_says(excess):
    """All parameters equally well known: `r log u + d₀²/u` with `u = 1 + w²/σ²` determines the end of the interval."""
    rng, _, base, _, prior, _ = mechanism(5, 4)
    r, L, unit = len(prior), np.linalg.cholesky(bodies(prior)), np.eye(16).reshape(16, 4, 4)
    moves = parameters_from_pseudo_inertia(
        L[:, None] @ ((unit + np.swapaxes(unit, 1, 2)) / 2) @ np.swapaxes(L, 1, 2)[:, None]
    )
    metric = block_diag(*(m.T @ m for m in moves))
    z = rng.normal(size=r)
    z *= np.sqrt(excess * r) / np.linalg.norm(z)
    consistent = consistent_parameters(
        prior + 1e-6 * np.linalg.cholesky(metric) @ z, 1e-12 * metric, everything(base), prior
    )
    limit = r * np.log(excess) + r + 3.84
    if r * excess <= limit:
        assert not consistent.divergence.any()
    else:
        u = brentq(lambda u: r * np.log(u) + r * excess / u - limit, excess, 100 * excess)
        np.testing.assert_allclose(consistent.distance, np.sqrt(r * excess) / u, rtol=0.02)


def test_what_makes_no_sense_is_refused_in_a_sentence():
    _, _, base, truth, prior, covariance = mechanism(0)
    psi, b = base.regroup(truth), len(prior) // 10
    negative, empty, infinite = prior.copy(), 0 * prior, prior.copy()
    negative[10], infinite[3] = -1, np.inf
    skew, still = covariance.copy(), covariance.copy()
    skew[0, 1] += 1
    still[0] = still[:, 0] = 0
    odd = replace(base, parameters=(*base.parameters, "Ia(u)"))
    names = [f"link{k}" for k in range(b)]
    for args, message in [
        ((psi[1:], covariance, base, prior), "This regrouping needs ψ"),
        ((psi, covariance[1:], base, prior), "This regrouping needs ψ"),
        ((psi, covariance, base, prior[:-1]), "This regrouping needs ψ"),
        ((psi, covariance, odd, prior), "leave drives out of it"),
        ((psi * np.nan, covariance, base, prior), "finite numbers"),
        ((psi, covariance, base, infinite), "finite numbers"),
        ((psi, skew, base, prior), "symmetric and positive definite"),
        ((psi, still, base, prior), "positive variance; it is not for m1"),
        ((psi, covariance, base, negative), "at least zero; negative: link1"),
        ((psi, covariance, base, empty), "A prior needs mass and extent"),
    ]:
        with pytest.raises(ValueError, match=message):
            consistent_parameters(*args, bodies=names)
