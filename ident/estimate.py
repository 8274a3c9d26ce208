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
        condition_number: Condition number of the base regressor as used, unscaled (Section III.A).
        rows: Rows of the base regressor as used; wrench components that no parameter can produce are left out.
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
    Y: np.ndarray, wrench: np.ndarray, base: BaseParameters, *, wrench_std: np.ndarray | None = None
) -> Estimate:
    """Least-squares solution of `Y_b ψ = Γ` (Eq. 4).

    Without `wrench_std` this is the ordinary least squares of the paper, and the noise of each wrench component is
    estimated from its residuals. With it, every row is divided by its component's standard deviation, and those
    values are taken as known. Noise on the joint states (errors in variables) is in neither: it biases ψ.

    Args:
        Y: Regressor (N, 6, P).
        wrench: Total measured wrench Γ `[F; τ]`, N and N m (N, 6).
        base: Regrouping that fits Y.
        wrench_std: Standard deviations of the wrench components, N and N m (6,).

    Returns:
        The estimate.

    Raises:
        ValueError: Shapes that do not match, or values that are not finite.
        ExcitationError: The base regressor is rank-deficient.
    """
    wrench = np.asarray(wrench, float)
    if Y.ndim != 3 or Y.shape[1:] != (6, len(base.parameters)) or wrench.shape != Y.shape[:2]:
        raise ValueError(
            f"A regressor (N, 6, {len(base.parameters)}) needs wrenches (N, 6), got {Y.shape} and {wrench.shape}."
        )
    if not (np.isfinite(Y).all() and np.isfinite(wrench).all()):
        raise ValueError("Regressor and wrench need finite numbers, got NaN or infinity.")
    check_excitation(Y, base)

    Y_b = base.reduce(Y)
    alive = np.abs(Y_b).max(axis=(0, 2)) > ZERO_COLUMN * np.abs(Y_b).max()
    weights = np.ones(6) if wrench_std is None else 1 / np.asarray(wrench_std, float)
    rows = (Y_b * weights[:, None])[:, alive].reshape(-1, base.rank)
    Q, R = linalg.qr(rows, mode="economic")
    psi = linalg.solve_triangular(R, Q.T @ (wrench * weights)[:, alive].ravel())

    predicted = Y_b @ psi
    residual = wrench - predicted
    if wrench_std is None:
        # The fit takes degrees of freedom from each component by the leverage of its rows.
        freedom = len(Y) - np.sum(Q**2, axis=1).reshape(len(Y), -1).sum(axis=0)
        variance = np.sum(residual[:, alive] ** 2, axis=0) / np.maximum(freedom, 1e-9)
    else:
        variance = np.ones(alive.sum())
    # Each row of Q carries the noise of its own component into ψ.
    noise = Q * np.sqrt(np.tile(variance, len(Y)))[:, None]
    half = linalg.solve_triangular(R, noise.T)
    covariance = half @ half.T
    return Estimate(
        names=base.names,
        psi=psi,
        std=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        condition_number=float(np.linalg.cond(R)),
        rows=rows.shape[0],
        predicted=predicted,
        residual=residual,
        epsilon=float(np.linalg.norm(residual)),
    )


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
    triangle = linalg.qr(Y_b / norms, mode="r")[0][: base.rank]
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
