"""The bodies closest to a prior at a given distance from ψ, against a conic solver."""

import numpy as np
import pytest
from bodies import bodies, forms, regrouping, unphysical

from ident.parameters.consistency import consistent_parameters

cvxpy = pytest.importorskip("cvxpy", reason="cvxpy with Clarabel is an optional extra")

pytestmark = pytest.mark.extras


def least_divergence(psi, covariance, base, prior, distance):
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


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate", "ignore:.*nfeasible")
def test_where_psi_is_unattainable_no_bodies_as_near_to_it_are_closer_to_the_prior():
    compared = 0
    for seed in range(20):
        base, prior, psi, covariance = unphysical(seed, 2 + seed % 5)
        consistent = consistent_parameters(psi, covariance, base, prior)
        if not consistent.attainable:
            least = least_divergence(psi, covariance, base, prior, consistent.distance)
            if least is not None:
                np.testing.assert_allclose(consistent.divergence.sum(), least, rtol=1e-3)
                compared += 1
    assert compared >= 8
