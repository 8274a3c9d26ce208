"""Covariances from precisions, brought to unit diagonal first: parameters differ in size by many orders."""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from ident.errors import ExcitationError
from ident.estimation.restricted_likelihood import TINIEST

LEAST_SCATTER = 0.05
"""Least variance over that of the working model, in any direction: where noise is found to be less it is by chance."""


def inverse_of_precision(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Inverse of a precision matrix.

    Raises:
        ExcitationError: It is not positive definite; the error has the names.
    """
    root = root_of_inverse(precision, names)
    return root @ root.T


def sandwich(precision: np.ndarray, scatter: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Covariance `P⁻¹ M P⁻¹` by a precision P and the scatter M of the right side (k, k).

    Raises:
        ExcitationError: The precision is not positive definite; the error has the names.
    """
    root = root_of_inverse(precision, names)
    values, vectors = np.linalg.eigh(root.T @ scatter @ root)
    wider = root @ vectors * np.sqrt(np.maximum(values, LEAST_SCATTER))
    return np.asarray(wider @ wider.T)


def root_of_inverse(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """A root R of the inverse of a precision matrix, R Rᵀ; the matrix is brought to unit diagonal first.

    Raises:
        ExcitationError: It is not positive definite; the error has the names.
    """
    scale = np.sqrt(np.maximum(np.diag(precision), TINIEST))
    try:
        factor = linalg.cholesky(precision / np.outer(scale, scale))
    except linalg.LinAlgError:
        raise ExcitationError("The recording does not determine all parameters.", tuple(names)) from None
    return np.asarray(linalg.solve_triangular(factor, np.eye(len(scale)))) / scale[:, None]


def embedded(matrix: np.ndarray, free: np.ndarray) -> np.ndarray:
    """A matrix over some entries of θ, zero elsewhere (p, p)."""
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = matrix
    return out
