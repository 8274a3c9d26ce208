"""Which combinations of φ a regressor can see: rank, selection of independent columns, and regrouping (Eq. 4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

ZERO_COLUMN = 1e-11
"""A column below this fraction of the largest column's norm is zero but for rounding."""

SINGULAR = 1e-10
"""Singular values of the unit-norm columns below this fraction of the largest are zero but for rounding."""

THRESHOLDS = 10.0 ** -np.arange(3, 11)
"""Fractions of a column that must stick out of the span of the kept ones, tried in turn until those span all columns.
Starting high keeps the choice well-conditioned where columns are nearly dependent."""


@dataclass(frozen=True, eq=False)
class BaseParameters:
    """A regrouping `ψ = φ[kept] + beta φ[dependent]` with `Y φ = Y[:, kept] ψ`.

    Attributes:
        parameters: Names of all P entries of φ.
        kept: Indices of the r columns kept.
        dependent: Indices of the other P - r columns.
        beta: How each dependent column is made of the kept ones, `Y[:, dependent] = Y[:, kept] beta` (r, P - r).
    """

    parameters: tuple[str, ...]
    kept: tuple[int, ...]
    dependent: tuple[int, ...]
    beta: np.ndarray

    @property
    def rank(self) -> int:
        """Number of base parameters r."""
        return len(self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, those of the kept columns."""
        return tuple(self.parameters[k] for k in self.kept)

    @property
    def unseen(self) -> tuple[str, ...]:
        """Names of the parameters with no effect on the wrench."""
        return tuple(
            self.parameters[d] for d, column in zip(self.dependent, self.beta.T, strict=True) if not column.any()
        )

    def reduce(self, Y: np.ndarray) -> np.ndarray:
        """The kept columns of a regressor (…, P) -> (…, r)."""
        return Y[..., list(self.kept)]

    def regroup(self, phi: np.ndarray) -> np.ndarray:
        """Base parameters ψ of a stacked φ (…, P) -> (…, r)."""
        phi = np.asarray(phi)
        return phi[..., list(self.kept)] + phi[..., list(self.dependent)] @ self.beta.T

    def expressions(self, digits: int = 6) -> tuple[str, ...]:
        """Base parameters as readable sums, `m2rz2 + 0.425 m3`.

        Args:
            digits: Significant digits of the coefficients.
        """
        return tuple(
            "".join([self.parameters[k], *(_term(c, self.parameters[d], digits) for c, d in self._terms(row))])
            for k, row in zip(self.kept, self.beta, strict=True)
        )

    def _terms(self, row: np.ndarray) -> list[tuple[float, int]]:
        return [(c, d) for c, d in zip(row, self.dependent, strict=True) if c != 0]


def find_base_parameters(
    Y: np.ndarray, parameters: Sequence[str], *, kept: Sequence[str] | None = None
) -> BaseParameters:
    """Rank and regrouping of a regressor.

    The rank is that of the unit-norm columns, by singular values. Columns are then taken from left to right and kept
    while they are independent of those kept before, the rule behind the names in the paper's tables.

    Args:
        Y: Regressor at well-spread states (…, P), at least as many rows as its rank.
        parameters: Names of the P columns.
        kept: Names to use as base parameters instead of the first independent ones, so that two models can be
            compared on the same set.

    Returns:
        The regrouping. Coefficients below 1e-9 are rounding and set to zero.

    Raises:
        ValueError: A pinned name is unknown, or the pinned set is not a basis of the columns.
    """
    parameters = tuple(parameters)
    columns = Y.reshape(-1, Y.shape[-1])
    if columns.shape[1] != len(parameters):
        raise ValueError(f"A regressor of {columns.shape[1]} columns needs as many names, got {len(parameters)}.")
    # Dependencies between columns survive the QR's rotation of the rows, which leaves at most P of them.
    triangle = linalg.qr(columns, mode="r")[0][: columns.shape[1]]
    norms = np.linalg.norm(triangle, axis=0)
    seen = norms > ZERO_COLUMN * norms.max(initial=0)
    unit = np.where(seen, triangle / np.where(seen, norms, 1), 0)

    rank = _rank(unit)
    first = _first_independent(unit, rank)
    chosen = first if kept is None else _indices(kept, parameters)
    others = [k for k in range(len(parameters)) if k not in chosen]
    if not _rank(unit[:, chosen]) == len(chosen) == rank:
        raise ValueError(
            f"The pinned base parameters {', '.join(parameters[k] for k in chosen)} are no basis: {len(chosen)} names "
            f"of rank {_rank(unit[:, chosen])}, where the regressor has rank {rank}; its first independent columns are "
            f"{', '.join(parameters[k] for k in first)}."
        )
    scaled = linalg.lstsq(unit[:, chosen], unit[:, others])[0]
    beta = np.where(seen[others], scaled * norms[others] / norms[chosen][:, None], 0)
    beta[np.abs(beta) < 1e-9] = 0
    return BaseParameters(parameters, tuple(chosen), tuple(others), beta)


def _rank(unit: np.ndarray) -> int:
    """Rank of unit (or zero) columns."""
    s = np.linalg.svd(unit, compute_uv=False)
    return int(np.sum(s > SINGULAR * s.max(initial=0)))


def _first_independent(unit: np.ndarray, rank: int) -> list[int]:
    """Indices of the first `rank` independent ones of unit (or zero) columns, left to right."""
    for threshold in THRESHOLDS:
        kept: list[int] = []
        basis = np.zeros((len(unit), 0))
        for k, column in enumerate(unit.T):
            rest = column - basis @ (basis.T @ column)
            rest = rest - basis @ (basis.T @ rest)
            size = np.linalg.norm(rest)
            if size > threshold and len(kept) < rank:
                kept.append(k)
                basis = np.column_stack([basis, rest / size])
        if len(kept) == rank:
            break
    return kept


def _indices(names: Sequence[str], parameters: tuple[str, ...]) -> list[int]:
    unknown = [name for name in names if name not in parameters]
    if unknown:
        raise ValueError(f"No parameter is named {', '.join(unknown)}; the names are {', '.join(parameters)}.")
    return [parameters.index(name) for name in names]


def _term(coefficient: float, name: str, digits: int) -> str:
    size = f"{abs(coefficient):.{digits}g}"
    return (" - " if coefficient < 0 else " + ") + (name if size == "1" else f"{size} {name}")
