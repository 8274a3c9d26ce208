"""Covariances from precisions, scaled to unit diagonal first because parameters differ by orders of magnitude."""

from collections.abc import Sequence

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from ident.errors import ExcitationError
from ident.trajectory.fit.restricted_likelihood import TINIEST

LEAST_SCATTER = 0.05
"""Least variance over that of the working model, in any direction: smaller estimates of the noise are chance."""

UNDETERMINED = (
    "recording does not determine all parameters. Move all joints further, take their angles as they were measured, "
    "hold those that rest (--fix), or fit what the model knows as well (--prior on)."
)
"""End of messages on parameters that a recording does not determine."""


def inverse_of_precision(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Inverse of a precision matrix.

    Raises:
        ExcitationError: It is not positive definite; the error carries the names.
    """
    root = root_of_inverse(precision, names)
    return root @ root.T


def sandwich(precision: np.ndarray, scatter: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Covariance `P⁻¹ M P⁻¹` from a precision P and the covariance M of the right side (k, k).

    Raises:
        ExcitationError: The precision is not positive definite; the error carries the names.
    """
    root = root_of_inverse(precision, names)
    values, vectors = np.linalg.eigh(root.T @ scatter @ root)
    wider = root @ vectors * np.sqrt(np.maximum(values, LEAST_SCATTER))
    return np.asarray(wider @ wider.T)


def root_of_inverse(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Root R of the inverse `R Rᵀ` of a precision matrix, which is scaled to unit diagonal first.

    Raises:
        ExcitationError: It is not positive definite or not finite; the error carries the names.
    """
    if not np.isfinite(precision).all():
        raise ExcitationError(f"The fit diverges: the {UNDETERMINED}", tuple(names))
    scale = np.sqrt(np.maximum(np.diag(precision), TINIEST))
    try:
        factor = linalg.cholesky(precision / np.outer(scale, scale))
    except linalg.LinAlgError:
        raise ExcitationError(f"The {UNDETERMINED}", tuple(names)) from None
    # LAPACK complains of matrices without rows.
    inverse = lapack.dtrtri(factor)[0] if len(factor) else factor
    return np.asarray(inverse) / scale[:, None]


def embedded(matrix: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Matrix over some entries of θ embedded in zeros (p, p)."""
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = matrix
    return out
