"""Least-squares base parameters with their uncertainty, and the two checks of Section III.A."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.base_parameters import ZERO_COLUMN, BaseParameters

SINGULAR = 1e-10
"""A unit-norm column combination shorter than this fraction of the longest carries rounding only."""

ABOVE_NOISE = 1.5
"""How many times longer than its noise a column combination must be to count as excited."""


class ExcitationError(ValueError):
    """The motion does not separate some of the base parameters."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated base parameters of one regressor and wrench.

    Attributes:
        names: Names of the r base parameters.
        psi: Their estimates ψ, SI units (r,).
        std: Standard deviation of each estimate due to noise on the wrench (r,).
        covariance: Covariance behind `std` (r, r).
        condition_number: Condition number of the base regressor, neither scaled nor weighted (Section III.A).
        rows: Rows of the base regressor; wrench components that no parameter can produce are left out.
        predicted: Wrench that ψ predicts, `Y_b ψ` (N, 6).
        residual: Measured minus predicted wrench (N, 6).
        epsilon: `‖Γ - Y_b ψ‖₂` over all components (Eq. 5).
    """

    names: tuple[str, ...]
    psi: np.ndarray
    std: np.ndarray
    covariance: np.ndarray
    condition_number: float
    rows: int
    predicted: np.ndarray
    residual: np.ndarray
    epsilon: float


def identify(
    Y: np.ndarray,
    wrench: np.ndarray,
    base: BaseParameters,
    *,
    covariance: np.ndarray | None = None,
    Y_noise: np.ndarray | None = None,
) -> Estimate:
    """Least-squares solution of `Y_b ψ = Γ` (Eq. 4).

    Without `covariance` this is the ordinary least squares of the paper. Its standard deviations come from the
    residuals of each sample, whatever the noise of the components and the correlation between them (Huber and White's
    sandwich). With `covariance` the rows are whitened, which weights them, and the noise is taken as known. Noise on
    the joint states (errors in variables) is in neither: it biases ψ.

    Args:
        Y: Regressor (N, 6, P).
        wrench: Total measured wrench Γ `[F; τ]`, N and N m (N, 6).
        base: Regrouping that fits Y.
        covariance: Covariance of the wrench, one for all samples (6, 6) or one for each (N, 6, 6).
        Y_noise: The regressor's own noise, as `check_excitation` takes it (N, 6, P).

    Returns:
        The estimate.

    Raises:
        ValueError: Shapes that do not match, values that are not finite, or a covariance that is not positive definite.
        ExcitationError: The motion does not separate the base parameters (`check_excitation`).
    """
    wrench = np.asarray(wrench, float)
    if Y.ndim != 3 or Y.shape[1:] != (6, len(base.parameters)) or wrench.shape != Y.shape[:2]:
        raise ValueError(
            f"A regressor (N, 6, {len(base.parameters)}) needs wrenches (N, 6), got {Y.shape} and {wrench.shape}."
        )
    if not (np.isfinite(Y).all() and np.isfinite(wrench).all()):
        raise ValueError("Regressor and wrench need finite numbers, got NaN or infinity.")
    check_excitation(Y, base, Y_noise)

    Y_b = base.reduce(Y)
    alive = np.abs(Y_b).max(axis=(0, 2)) > ZERO_COLUMN * np.abs(Y_b).max()
    rows, target = Y_b[:, alive], wrench[:, alive, None]
    if covariance is not None:
        whiten = _inverse_root(covariance, alive)
        rows, target = whiten @ rows, whiten @ target
    count = rows.shape[0] * rows.shape[1]
    Q, R = linalg.qr(rows.reshape(count, base.rank), mode="economic")
    psi = linalg.solve_triangular(R, Q.T @ target.ravel())
    if covariance is None:
        # Each sample moves ψ by R⁻¹ Qᵀ times its noise; the fit has used up some of the residual.
        noise = (target[..., 0] - rows @ psi) * np.sqrt(count / max(count - base.rank, 1))
        root = linalg.solve_triangular(R, np.einsum("nir,ni->rn", Q.reshape(rows.shape), noise))
    else:
        root = linalg.solve_triangular(R, np.eye(base.rank))
    predicted = Y_b @ psi
    return Estimate(
        names=base.names,
        psi=psi,
        std=np.linalg.norm(root, axis=1),
        covariance=root @ root.T,
        condition_number=float(np.linalg.cond(R if covariance is None else _triangle(Y_b[:, alive]))),
        rows=count,
        predicted=predicted,
        residual=wrench - predicted,
        epsilon=float(np.linalg.norm(wrench - predicted)),
    )


def _triangle(rows: np.ndarray) -> np.ndarray:
    """Triangular factor of stacked rows (…, r), which has their singular values (r, r)."""
    tall = rows.reshape(-1, rows.shape[-1])
    return linalg.qr(tall, mode="r")[0][: tall.shape[1]]


def _inverse_root(covariance: np.ndarray, alive: np.ndarray) -> np.ndarray:
    """Matrices W with `W C Wᵀ = 1` for the living components' covariance C (…, k, k)."""
    C = np.asarray(covariance, float)
    if C.shape[-2:] != (6, 6) or not np.allclose(C, np.swapaxes(C, -1, -2)):
        raise ValueError(f"The wrench's covariance needs to be symmetric, (6, 6) or (N, 6, 6), got shape {C.shape}.")
    try:
        return np.linalg.inv(np.linalg.cholesky(C[..., alive, :][..., alive]))
    except np.linalg.LinAlgError:
        raise ValueError("The wrench's covariance needs to be positive definite.") from None


def check_excitation(Y: np.ndarray, base: BaseParameters, Y_noise: np.ndarray | None = None) -> None:
    """Raises unless the motion separates all base parameters.

    Combinations of unit-norm base columns (the right singular vectors) must be longer than rounding and, when the
    regressor's own noise is given, half as long again as noise alone makes them: a joint that rests but whose sensors
    are noisy would otherwise pass for excited.

    Args:
        Y: Regressor at the measured joint states (N, 6, P).
        base: Structural regrouping of the same columns.
        Y_noise: Difference between the regressor at measured states and at states with the sensors' noise added
            once more (N, 6, P).

    Raises:
        ExcitationError: Names the base parameters that cannot be told apart.
    """
    Y_b = base.reduce(Y).reshape(-1, base.rank)
    norms = np.linalg.norm(Y_b, axis=0)
    still = norms <= ZERO_COLUMN * norms.max(initial=0)
    norms = np.where(still, 1, norms)
    triangle = _triangle(Y_b / norms)
    _, _, directions = np.linalg.svd(triangle)
    lengths = np.linalg.norm(triangle @ directions.T, axis=0)
    floor = np.full(base.rank, SINGULAR * lengths.max(initial=0))
    if Y_noise is not None:
        noise = base.reduce(Y_noise).reshape(-1, base.rank) / norms
        floor = np.maximum(floor, ABOVE_NOISE * np.linalg.norm(noise @ directions.T, axis=0))
    hidden = directions[lengths <= floor]
    if len(hidden):
        size = np.linalg.norm(hidden, axis=0)
        names = [name for name, s in zip(base.names, size, strict=True) if s > 0.1 * size.max()]
        raise ExcitationError(
            f"The motion of {len(Y)} samples does not separate the base parameters {', '.join(names)}: "
            f"{base.rank - len(hidden)} of {base.rank} combinations show above the noise. Record longer, or move the "
            "joints further."
        )
