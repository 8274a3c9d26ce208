"""Matrices of bodies and base parameters, and base parameters that no bodies have, for the tests."""

import numpy as np
from mechanisms import GRAVITY, SCREWS, random_phi, random_states, random_tree

from ident import base_wrench_regressor, find_base_parameters
from ident.geometry.inertia import pseudo_inertia


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
