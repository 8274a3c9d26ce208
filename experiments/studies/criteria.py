"""How well a motion determines the base parameters of a mechanism: predicted standard deviations, and criteria.

M = Σ Y_bᵀ C⁻¹ Y_b     information of a motion, C the covariance of the noise on a sample
σ = √diag M⁻¹          standard deviations of ψ by least squares, weighted by C
P = B S Bᵀ             covariance of ψ as known beforehand, S that of φ, and ψ = B φ the regrouping

Noise is white from sample to sample, and joint states are accurate.
"""

import numpy as np

from experiments.studies.excitation import Problem
from ident.errors import ModelError
from ident.mechanism.motion import Motion
from ident.model.regressor import CHUNK
from ident.parameters.prior import known_deviations
from sim.motion.excitation_design import Cost

INVISIBLE = 1e-14
"""Eigenvalues of the information below this fraction of the largest are rounding."""


def known_root(problem: Problem) -> np.ndarray:
    """A root L of what is known of ψ beforehand, `P = Lᵀ L` (r, r); its columns are as long as the standard deviations.

    Raises:
        ModelError: No body has a mass.
    """
    if problem.mechanism.prior is None:
        raise ModelError(
            "Deviations relative to what the model knows need a mass, and no body has one; choose --criterion "
            "determinant or condition."
        )
    return np.linalg.qr(problem.parameters.regroup(np.diag(known_deviations(problem.mechanism.prior))))[1]


def predicted_deviations(problem: Problem, motion: Motion) -> np.ndarray:
    """Standard deviations σ of ψ that a motion leaves, by weighted least squares and nothing known before.

    Args:
        problem: What is excited.
        motion: A sampled motion.

    Returns:
        σ in kg, kg m and kg m² (r,).
    """
    rows = (problem.whitening @ problem.regressor(*motion.states)).reshape(-1, problem.parameters.rank)
    _, s, Vt = np.linalg.svd(rows, full_matrices=False)
    return np.linalg.norm(Vt.T / np.maximum(s, np.finfo(float).eps * s[0]), axis=1)


def geometric_mean(deviations: np.ndarray) -> float:
    """The geometric mean of standard deviations, of which no unit matters to a comparison."""
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(deviations).mean()))


def mean_deviation(problem: Problem, motion: Motion) -> float:
    """The geometric mean of the standard deviations of ψ that a motion leaves."""
    return geometric_mean(predicted_deviations(problem, motion))


def quality(problem: Problem, motion: Motion) -> dict[str, float]:
    """What a sampled motion makes of every criterion, by its name; without masses nothing is relative to them."""
    Y = problem.regressor(*motion.states)
    columns, weighted = (x.reshape(-1, Y.shape[2]) for x in (Y, problem.whitening @ Y))
    norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    s = np.linalg.svd(columns, compute_uv=False)
    relative = {}
    if problem.mechanism.prior is not None:
        (logarithm,) = _relative_deviation((weighted.T @ weighted)[None], known_root(problem))
        relative = {"geometric_mean_of_relative_deviations": float(np.exp(logarithm))}
    return {
        "condition_number": _ratio(s),
        "condition_number_of_unit_columns": _ratio(np.linalg.svd(columns / norms, compute_uv=False)),
        **relative,
        "log_det_information": 2 * float(np.log(np.linalg.svd(weighted, compute_uv=False)).sum()),
        "smallest_singular_value": float(s[-1]),
    }


def cost(problem: Problem, criterion: str, samples: int) -> Cost:
    """What a criterion of `defaults.CRITERIA` makes small, as a logarithm.

    Args:
        problem: What is to be excited.
        criterion: `deviations`: the geometric mean of the standard deviations of ψ relative to those known beforehand.
            What is known counts as one more measurement (Chaloner and Verdinelli, Bayesian experimental design,
            Stat. Sci. 1995, doi:10.1214/ss/1177009939), so that bodies too small to be seen do not rule the motion. The
            mean of squares instead, the trace of A-optimality, leaves the motion to the parameter that is seen least:
            within the paper's limits it gets an eighth smaller, and the geometric mean an eighth larger.
            `determinant`: det M to the power of -1/2r, D-optimality. `condition`: the condition number of Y_b.
        samples: Number of samples N that the motion will be recorded with.

    Raises:
        ModelError: No body has a mass that deviations could be relative to.
    """
    W = problem.whitening if criterion != "condition" else np.eye(len(problem.whitening))
    L = known_root(problem) if criterion == "deviations" else None

    def logarithm(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        M = samples / q.shape[1] * _information(problem, W, q, dq, ddq)
        if L is not None:
            return _relative_deviation(M, L)
        s = np.linalg.eigvalsh(M)
        s = np.log(np.maximum(s, INVISIBLE * s[:, -1:]))
        return -np.mean(s, axis=1) / 2 if criterion == "determinant" else (s[:, -1] - s[:, 0]) / 2

    return logarithm


def _information(problem: Problem, W: np.ndarray, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Information `Σ (W Y_b)ᵀ W Y_b` of P motions of G samples: arrays (P, G, n) give (P, r, r)."""
    out = np.empty((len(q), problem.parameters.rank, problem.parameters.rank))
    at_once = max(1, CHUNK // q.shape[1])
    for start in range(0, len(q), at_once):
        part = slice(start, start + at_once)
        Y = W @ problem.regressor(*(x[part].reshape(-1, x.shape[2]) for x in (q, dq, ddq)))
        rows = Y.reshape(len(q[part]), -1, Y.shape[2])
        out[part] = np.swapaxes(rows, 1, 2) @ rows
    return out


def _relative_deviation(M: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Logarithm of the geometric mean of √(diag (M + P⁻¹)⁻¹ / diag P), of each information (k, r, r) -> (k,).

    P = Lᵀ L may be singular: (M + P⁻¹)⁻¹ = Lᵀ (1 + L M Lᵀ)⁻¹ L.
    """
    eigenvalues, V = np.linalg.eigh(np.eye(len(L)) + L @ M @ L.T)
    known = np.linalg.norm(L, axis=0)
    relative = np.swapaxes(V, 1, 2) @ (L[:, known > 0] / known[known > 0])
    variances = np.sum(relative**2 / np.maximum(eigenvalues, 1)[:, :, None], axis=1)
    return np.log(variances).mean(axis=1) / 2


def _ratio(singular_values: np.ndarray) -> float:
    return float(singular_values[0] / max(singular_values[-1], np.finfo(float).tiny))
