"""Columns of drives and offsets that a motion separates from those before them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ident.estimation.accumulator import accumulate
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.model.stated import column_place
from ident.tolerances import ZERO_COLUMN

INDEPENDENT = 1e-6
"""Distance of a unit-norm column from the span of others below which it depends on them."""

MIXED = 1e-3
"""Coefficient of a unit-norm column in another from which the one takes up the other."""


def separable(equations: Equations, samples: Samples) -> Equations:
    """Equations without the drives and offsets whose columns depend on those before them.

    Drives that are left out add to the coefficients that take them up (`absorbed`).

    Raises:
        InputError: Samples do not fit the equations.
    """
    columns = accumulate(equations, samples).root[:, : len(equations.names)]
    mask = independent(columns)
    kept = dict(zip(equations.names, mask, strict=True))
    without = replace(
        equations,
        drives=tuple(name for name in equations.drives if kept[name]),
        offsets=tuple(k for k in equations.offsets if kept[f"offset({equations.channels[k]})"]),
    )
    count = equations.parameters.rank + len(equations.drives)
    without = replace(without, absorbed=_absorbed(columns[:, :count], mask[:count], equations))
    return replace(without, mixed=_mixed(columns[:, :count], kept, equations)) if equations.axes.motors else without


def _mixed(columns: np.ndarray, kept: Mapping[str, bool], before: Equations) -> tuple[str, ...]:
    """`mixed` of equations that lack some of the columns of base parameters and drives (m, r + d) of others."""
    names = before.names[: columns.shape[1]]
    stays = np.array([kept[name] or name not in before.drives for name in names])
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    combined = np.linalg.lstsq(unit[:, stays], unit[:, ~stays], rcond=INDEPENDENT)[0]
    takes = dict(zip(np.array(names)[stays].tolist(), (np.abs(combined) > MIXED).any(axis=1), strict=True))
    of_motors = [name for name in before.drives if column_place(name)[1] in before.axes.motors]
    return tuple(name for name in of_motors if takes.get(name) or (name in before.mixed and kept[name]))


def _absorbed(columns: np.ndarray, kept: np.ndarray, before: Equations) -> dict[str, np.ndarray]:
    """`absorbed` of equations that lack some of the columns of base parameters and drives that others had before.

    Args:
        columns: Those columns (m, r + d).
        kept: Mask of the independent ones (r + d,); base parameters are kept in any case.
        before: Equations with all drives.
    """
    kept = kept | (np.arange(len(kept)) < before.parameters.rank)
    sizes = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    combined = np.linalg.lstsq(columns[:, kept] / sizes[kept], columns[:, ~kept], rcond=INDEPENDENT)[0]
    units = combined.T / sizes[kept]
    lost = (name for name, stays in zip(before.names, kept, strict=False) if not stays)
    earlier = {name: each[kept] + each[~kept] @ units for name, each in before.absorbed.items()}
    return earlier | dict(zip(lost, units, strict=True))


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
