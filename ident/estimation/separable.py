"""Columns of drives and offsets that a motion separates from those before them."""

from dataclasses import replace

import numpy as np

from ident.estimation.accumulator import accumulate
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.tolerances import ZERO_COLUMN

INDEPENDENT = 1e-6
"""Distance of a unit-norm column from the span of others below which it depends on them."""


def separable(equations: Equations, samples: Samples) -> Equations:
    """Equations without the drives and offsets whose columns depend on those before them.

    Raises:
        InputError: Samples do not fit the equations.
    """
    columns = accumulate(equations, samples).root[:, : len(equations.names)]
    kept = dict(zip(equations.names, independent(columns), strict=True))
    return replace(
        equations,
        drives=tuple(name for name in equations.drives if kept[name]),
        offsets=tuple(k for k in equations.offsets if kept[f"offset({equations.channels[k]})"]),
    )


def independent(columns: np.ndarray) -> np.ndarray:
    """Mask of the columns of a matrix (m, k) that are independent of those before them (k,)."""
    # Not by the diagonal of a triangular factor, which lacks a part of the columns after a dependent one.
    sizes, basis = np.linalg.norm(columns, axis=0), np.zeros_like(columns)
    stick_out = np.zeros(len(sizes), bool)
    for k, (column, size) in enumerate(zip(columns.T, sizes, strict=True)):
        out = column
        for _ in range(2):  # One pass leaves rounding errors along the others.
            out = out - basis @ (basis.T @ out)
        stick_out[k] = size > ZERO_COLUMN * sizes.max() and np.linalg.norm(out) > INDEPENDENT * size
        if stick_out[k]:
            basis[:, k] = out / np.linalg.norm(out)
    return stick_out
