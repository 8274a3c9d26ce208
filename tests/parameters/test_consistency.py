"""Physical bodies near a prior against duality and a conic solver; their intervals by closed forms and by coverage."""

from dataclasses import replace

import numpy as np
import pytest
from mechanisms import GRAVITY, SCREWS, random_phi, random_states, random_tree
from scipy.optimize import minimize

from ident import BaseParameters, Body, Mechanism, Sensors, base_wrench_regressor, find_base_parameters
from ident.display.brief import QUANTITIES
from ident.geometry import inertia
from ident.geometry.inertia import parameters_from_com, pseudo_inertia
from ident.mechanism.tree import BASE, Tree
from ident.parameters import extremes
from ident.parameters.consistency import consistent_parameters, physical_prior
from ident.parameters.prior import body_covariance, guessed
from ident.payload import GUESSED


def bodies(phi):
    return pseudo_inertia(np.reshape(phi, (-1, 10)))


def regrouping(base):
    """Matrix A with `A φ = ψ`."""
    return base.regroup(np.eye(len(base.parameters))).T


def forms(rows):
    """Symmetric matrices (…, b, 4, 4) whose products with the pseudo-inertias are rows (…, 10 b) times φ."""
    # φ = Σ φ_k e_k and J is linear in φ: least squares on its ten entries gives the matrix.
    J = pseudo_inertia(np.eye(10)).reshape(10, 16)
    return (rows.reshape(*rows.shape[:-1], -1, 10) @ np.linalg.pinv(J).T).reshape(*rows.shape[:-1], -1, 4, 4)


def weighed(tree, base, phi, rng, noise=0.05, samples=300):
    """Covariance of base parameters from wrenches with noise of a fraction of their size."""
    Y = base.reduce(base_wrench_regressor(tree, *random_states(rng, tree, samples), gravity=GRAVITY))
    size = np.sqrt(np.mean((Y @ base.regroup(phi)) ** 2, axis=0))
    rows = Y / (noise * np.maximum(size, 0.1 * size.max()))[:, None]
    return np.linalg.inv(np.einsum("nci,ncj->ij", rows, rows))


def measured(rng, psi, covariance):
    return psi + np.linalg.cholesky(covariance) @ rng.normal(size=len(psi))


def unphysical(seed, count):
    """Base parameters that no bodies have, most of them by far: some moments of inertia are negative."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, count, SCREWS)
    base, prior, truth = find_base_parameters(tree), random_phi(rng, count), random_phi(rng, count)
    covariance = weighed(tree, base, truth, rng)
    truth.reshape(-1, 10)[:, 4:7] *= -0.5
    return base, prior, measured(rng, base.regroup(truth), covariance), covariance


def problem(seed, number=None):
    """Base parameters of random bodies, the bodies, other ones as a prior, and a covariance."""
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, number)
    base, count = find_base_parameters(tree), len(tree.inertial)
    root = rng.normal(size=(base.rank, base.rank))
    return base, random_phi(rng, count), random_phi(rng, count), 1e-4 * (root @ root.T + np.eye(base.rank))


@pytest.mark.parametrize("seed", range(2))
def test_no_other_physical_bodies_with_these_base_parameters_are_closer_to_the_prior(seed):
    """The gradient `P⁻¹ - J⁻¹` of the convex divergence is zero in all directions that keep ψ."""
    base, truth, prior, covariance = problem(seed)
    consistent = consistent_parameters(base.regroup(truth), covariance, base, prior)
    gradient = np.linalg.inv(bodies(prior)) - np.linalg.inv(bodies(consistent.phi))
    along, A = np.einsum("bij,kij->bk", gradient, pseudo_inertia(np.eye(10))).ravel(), regrouping(base)
    np.testing.assert_allclose(A.T @ np.linalg.lstsq(A.T, along, rcond=None)[0], along, atol=1e-7 * abs(gradient).max())
    ratio = np.linalg.solve(bodies(prior), bodies(consistent.phi))
    divergence = np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - 4
    np.testing.assert_allclose(consistent.divergence, divergence, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(("seed", "attainable"), [(0, True), (4, False)])
def test_units_do_not_matter(seed, attainable):
    """Tonnes and millimetres give the same bodies."""
    base, truth, prior, covariance = problem(seed, 3)
    psi = base.regroup(truth) if attainable else -base.regroup(truth)
    power = [0 if name == "m" else 1 if name.startswith("mr") else 2 for name in inertia.PARAMETERS]
    scale = np.tile(1e-3 * 1e3 ** np.array(power, float), len(prior) // 10)
    kept, dependent = scale[list(base.kept)], scale[list(base.dependent)]
    scaled = replace(base, beta=kept[:, None] * base.beta / dependent)
    consistent = consistent_parameters(psi, covariance, base, prior)
    again = consistent_parameters(kept * psi, np.outer(kept, kept) * covariance, scaled, scale * prior)
    assert again.attainable == consistent.attainable == attainable
    np.testing.assert_allclose(again.distance, consistent.distance, rtol=1e-2, atol=1e-6)
    if attainable:
        np.testing.assert_allclose(again.phi / scale, consistent.phi, atol=1e-9 * abs(consistent.phi).max())


def test_a_prior_without_mass_or_extent_is_raised_to_a_minimum():
    base, truth, prior, covariance = problem(4, 4)
    prior[:10] = prior[11:20] = 0
    prior[34] = -1
    physical = physical_prior(prior)
    for phi in (physical, consistent_parameters(base.regroup(truth), covariance, base, prior).phi):
        assert (np.linalg.eigvalsh(bodies(phi)) > 0).all()
    np.testing.assert_allclose(physical[20:30], prior[20:30], atol=1e-12)
    np.testing.assert_allclose(physical[0], 1e-6 * prior[[0, 10, 20, 30]].sum())
    assert physical[10] == prior[10] and physical[30] == prior[30] and (physical[14:17] > 0).all()


def test_duality_proves_that_no_bodies_are_nearer_to_psi_and_none_as_near_are_closer_to_the_prior():
    """A multiplier λ bounds the divergence of all J with ψ within d: `λᵀψ - d |λ| + Σ log det(P⁻¹ - A*λ) P`.

    Where no bodies have ψ, `A*λ` of the multiplier of the distance itself is positive but for rounding.
    """
    unattainable = 0
    for seed in range(12):
        base, prior, psi, covariance = unphysical(seed, 2 + seed % 5)
        consistent = consistent_parameters(psi, covariance, base, prior)
        if not consistent.attainable:
            unattainable += 1
            np.testing.assert_allclose(consistent.shift, (consistent.psi - psi) / np.sqrt(np.diag(covariance)))
            moves = [abs(by) for _, by in consistent.moved()]
            assert moves == sorted(moves, reverse=True) and moves[0] == abs(consistent.shift).max()
            multiplier = np.linalg.solve(covariance, consistent.psi - psi) / consistent.distance
            away = forms(regrouping(base).T @ multiplier)
            assert np.linalg.eigvalsh(away).min() > -0.02 * abs(away).max()
            assert consistent.distance == pytest.approx(-multiplier @ psi, rel=0.04)
        assert (np.linalg.eigvalsh(bodies(consistent.phi)) > 0).all()
        A, inverse = forms(regrouping(base)), np.linalg.inv(bodies(prior))
        gradient = inverse - np.linalg.inv(bodies(consistent.phi))
        multiplier = np.linalg.lstsq(A.reshape(len(psi), -1).T, gradient.ravel(), rcond=None)[0]
        room = consistent.distance * np.sqrt(multiplier @ covariance @ multiplier)
        sign, volume = np.linalg.slogdet((inverse - np.tensordot(multiplier, A, 1)) @ bodies(prior))
        assert (sign > 0).all()
        assert consistent.divergence.sum() <= 1.001 * (multiplier @ psi - room + volume.sum())
    assert unattainable >= 5


def test_what_makes_no_sense_is_refused_in_a_sentence():
    base, truth, prior, covariance = problem(0)
    psi, unit, names = base.regroup(truth), np.eye(len(prior)), [f"link{k}" for k in range(len(prior) // 10)]
    skew, still = covariance + np.eye(base.rank, k=1), covariance.copy()
    still[0] = still[:, 0] = 0
    odd = replace(base, parameters=(*base.parameters, "Ia(u)"))
    for args, message in [
        ((psi[1:], covariance, base, prior), "This regrouping needs ψ"),
        ((psi, covariance, odd, prior), "leave drives out of it"),
        ((psi, covariance, base, np.where(unit[3], np.inf, prior)), "finite numbers"),
        ((psi, skew, base, prior), "symmetric and positive definite"),
        ((psi, still, base, prior), "positive variance; it is not for m1"),
        ((psi, covariance, base, np.where(unit[10], -1, prior)), "at least zero; negative: link1"),
        ((psi, covariance, base, 0 * prior), "A prior needs mass and extent"),
    ]:
        with pytest.raises(ValueError, match=message):
            consistent_parameters(*args, bodies=names)


EVERY = BaseParameters(inertia.parameter_names(1), tuple(range(10)), (), np.zeros((10, 0)), (1.0, 0.0))
"""All ten parameters of one body as base parameters."""

ROD = parameters_from_com(0.675, [0, 0, -0.434], np.diag([0.003, 0.003, 0.0005]))
ARM = Mechanism(Tree((Body("rod", BASE, np.eye(4), np.array([0.0, 0, 0, 0, 1, 0]), "hinge"),)), GRAVITY, ROD)
OF_TORQUE = find_base_parameters(ARM, sensors=Sensors(base_wrench=False, joint_torques=True))
"""The base parameters of the torque of a rod on a hinge: `m rx`, `m rz` and `Iyy`."""

STD = np.array([1e-3, 3e-3, 6e-4])


def estimated(psi, **given):
    return consistent_parameters(psi, np.diag(STD**2), OF_TORQUE, guessed(ARM), bodies=ARM.bodies, **given)


def test_bounds_of_a_pendulum_are_those_of_its_cone():
    """The mass has a lower limit alone, `(m rz)²/Iyy` at its least within 3.84 of the estimate."""
    assert OF_TORQUE.names == ("m1rx1", "m1rz1", "Iyy1")
    psi = np.array([0, -0.1012, 0.0182])
    full = estimated(psi)
    least = minimize(
        lambda x: (psi[1] + x[0] * STD[1]) ** 2 / (psi[2] + x[1] * STD[2]),
        [0, 0],
        constraints={"type": "ineq", "fun": lambda x: 3.84 - x @ x},
    ).fun
    lower, upper = full.intervals[0, 0]
    assert lower == pytest.approx(least, rel=5e-3) and upper == np.inf
    np.testing.assert_allclose(full.intervals[0, 5], psi[2] + np.array([-1.96, 1.96]) * STD[2], rtol=2e-3)
    expected = 1 / (1 + (STD[2] / np.sqrt(body_covariance(full.phi)[5, 5])) ** 2)
    assert full.share[0, 5] == pytest.approx(expected, rel=1e-3) and expected < 0.999
    mass, height = full.rows[0], full.rows[QUANTITIES.index("centre y")]
    assert mass.words == f"not determined (more than {lower:.3g})" and mass.share == 0
    assert height.words == "not determined" and not np.isfinite(height.upper)


def inside(full, truth):
    limits, own = full.intervals, inertia.with_centers(truth)
    return (limits[..., 0] <= own) & (own <= limits[..., 1])


@pytest.mark.slow
def test_intervals_of_a_body_have_the_truth_in_95_of_100_cases():
    count = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        truth, root = random_phi(rng, 1), rng.normal(size=(10, 10))
        C = 0.03**2 * (root @ root.T + 0.1 * np.eye(10)) * np.outer(abs(truth), abs(truth))
        full = consistent_parameters(measured(rng, truth, C), C, EVERY, random_phi(rng, 1), width=1.0)
        count += inside(full, truth)[0]
    assert 0.93 <= np.sum(count) / 1000 <= 0.97 and np.min(count) >= 88


def test_intervals_of_links_have_the_truth_in_95_of_100_cases_or_more():
    """Links of which base parameters are known alone, whose intervals are those of the set."""
    shares = []
    for seed in range(4):
        rng, count = np.random.default_rng(seed), 3 + seed % 3
        tree = random_tree(rng, count, ("revolute",), chain=True)
        base, truth = find_base_parameters(tree), random_phi(rng, count)
        C = weighed(tree, base, truth, rng, 0.02)
        full = consistent_parameters(measured(rng, base.regroup(truth), C), C, base, random_phi(rng, count))
        shares.append(inside(full, truth).mean())
    assert np.mean(shares) >= 0.95


def chain(seed):
    """Estimated base parameters of some links, and a prior."""
    rng, count = np.random.default_rng(seed), 3 + seed % 3
    tree = random_tree(rng, count, ("revolute",), chain=True)
    base, truth = find_base_parameters(tree), random_phi(rng, count)
    C = weighed(tree, base, truth, rng, 0.02)
    return measured(rng, base.regroup(truth), C), C, base, random_phi(rng, count)


@pytest.mark.parametrize("seed", range(4))
def test_what_nothing_bounds_has_no_bounds(seed):
    """The first link's first moments are regrouped, and its inertia may be that of a light ring of any size."""
    full = consistent_parameters(*chain(seed))
    (mass, _), *centre = full.intervals[0, :4]
    assert mass == 0 and not np.isfinite(centre).any()


def test_bounds_do_not_move_with_rounding():
    psi, *others = chain(1)
    near = psi * (1 + 1e-10 * np.random.default_rng(0).normal(size=len(psi)))
    one, other = (consistent_parameters(each, *others).intervals for each in (psi, near))
    np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-6)


def test_a_search_that_rounding_ends_leaves_the_others(monkeypatch):
    expected, step = consistent_parameters(*chain(1)).intervals, extremes._Search._step
    failing = 10 * 4 + 20  # The largest mass of the third body of four, after the least values of all.

    def step_or_fail(search, k):
        if failing in k:
            raise np.linalg.LinAlgError
        step(search, k)

    assert np.isfinite(expected[2, 0, 1])
    monkeypatch.setattr(extremes._Search, "_step", step_or_fail)
    expected[2, 0, 1] = np.inf
    np.testing.assert_allclose(consistent_parameters(*chain(1)).intervals, expected, rtol=1e-6, atol=1e-9)


def test_a_guess_of_the_same_mass_and_centre_leaves_an_inertia_where_data_have_it():
    """A measuring tape, guessed to be a ball of thrice its moments; a width from its mass would keep the ball."""
    std, z = np.repeat([1.5e-4, 1e-5, 2e-5], [1, 3, 6]), []
    tape, ball = (parameters_from_com(0.136, [0, 0, 0.027], np.diag(x)) for x in ([3.5e-5, 5.7e-5, 3.1e-5], 3 * [9e-5]))
    for seed in range(6):
        psi = tape + std * np.random.default_rng(seed).normal(size=10)
        full, kept = (consistent_parameters(psi, np.diag(std**2), EVERY, ball, **w) for w in ({"width": GUESSED}, {}))
        z.append((full.phi - tape) / std)
    assert np.sqrt(np.mean(np.square(z), axis=0)).max() < 1.6
    assert np.abs((kept.phi - tape) / std).max() > 2


def least_divergence(cvxpy, psi, covariance, base, prior, distance):
    """Least divergence of bodies whose ψ is within a Mahalanobis distance; None if the solver is not sure."""
    L, std = np.linalg.cholesky(bodies(prior)), np.sqrt(np.diag(covariance))
    A = np.swapaxes(L, 1, 2) @ forms(regrouping(base)) @ L / std[:, None, None, None]
    root = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(std, std)))
    K = [cvxpy.Variable((4, 4), symmetric=True) for _ in L]
    reached = sum(A[:, i].reshape(len(psi), 16) @ cvxpy.vec(k, order="C") for i, k in enumerate(K))
    divergence = sum(cvxpy.trace(k) - cvxpy.log_det(k) - 4 for k in K)
    near = cvxpy.norm(root / distance @ (reached - psi / std)) <= 1
    problem = cvxpy.Problem(cvxpy.Minimize(divergence), [near])
    problem.solve(solver=cvxpy.CLARABEL)
    return problem.value if problem.status == "optimal" else None


@pytest.mark.extras
@pytest.mark.filterwarnings("ignore:Solution may be inaccurate", "ignore:.*nfeasible")
def test_bounds_of_masses_and_moments_are_those_of_a_conic_solver():
    cvxpy, compared = pytest.importorskip("cvxpy", reason="cvxpy with Clarabel is an optional extra"), 0
    for seed in range(3):
        psi, C, base, prior = chain(seed)
        full = consistent_parameters(psi, C, base, prior)
        L, root = np.linalg.cholesky(bodies(full.phi)), np.linalg.inv(np.linalg.cholesky(C))
        rows, values = (np.swapaxes(L, 1, 2) @ forms(x) @ L for x in (root @ regrouping(base), np.eye(len(prior))))
        K = [cvxpy.Variable((4, 4), PSD=True) for _ in L]
        vectors = [cvxpy.vec(k, order="C") for k in K]
        misfit = sum(rows[:, i].reshape(-1, 16) @ k for i, k in enumerate(vectors)) - root @ psi
        least = cvxpy.Problem(cvxpy.Minimize(cvxpy.norm(misfit))).solve(solver=cvxpy.CLARABEL)
        inside = [cvxpy.norm(misfit / np.sqrt(least**2 + 3.84)) <= 1]
        for i, j in np.argwhere(np.isfinite(full.intervals[:, :, 1])).tolist():
            if j in (0, 4, 7):
                value = values[10 * i + j, i].ravel() / full.intervals[i, j, 1] @ vectors[i]
                problem = cvxpy.Problem(cvxpy.Maximize(value), inside)
                problem.solve(solver=cvxpy.CLARABEL)
                if problem.status in ("optimal", "optimal_inaccurate"):
                    assert problem.value == pytest.approx(1, rel=5e-3)
                    compared += 1
    assert compared >= 10


@pytest.mark.extras
@pytest.mark.filterwarnings("ignore:Solution may be inaccurate", "ignore:.*nfeasible")
def test_where_psi_is_unattainable_no_bodies_as_near_to_it_are_closer_to_the_prior():
    cvxpy, compared = pytest.importorskip("cvxpy", reason="cvxpy with Clarabel is an optional extra"), 0
    for seed in range(20):
        base, prior, psi, covariance = unphysical(seed, 2 + seed % 5)
        consistent = consistent_parameters(psi, covariance, base, prior)
        if not consistent.attainable:
            least = least_divergence(cvxpy, psi, covariance, base, prior, consistent.distance)
            if least is not None:
                np.testing.assert_allclose(consistent.divergence.sum(), least, rtol=1e-3)
                compared += 1
    assert compared >= 8
