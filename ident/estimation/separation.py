"""Excitation of base parameters, drives and offsets by a motion: checks, and the columns that it separates."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.errors import ExcitationError
from ident.estimation.accumulator import accumulate, triangle_of
from ident.estimation.equations import Equations
from ident.estimation.noise import channel_scales
from ident.estimation.samples import Samples
from ident.files.table import listed
from ident.mechanism.motion import Motion
from ident.tolerances import CONDITION_LIMIT, SINGULAR, ZERO_COLUMN

ABOVE_NOISE = 1.5
"""Norm of a column combination over that of its noise above which it counts as excited."""

FEW_SAMPLES = 1000
"""Number of samples by which the noise of the regressor is estimated."""

INDEPENDENT = 1e-6
"""Distance of a unit-norm column from the span of others below which it depends on them."""

MIXED = 1e-3
"""Coefficient of a unit-norm column in another from which the one takes up the other."""

MOSTLY = 0.5
"""Share of a parameter in combinations that the motion does not separate from which it is not determined."""


def noise_rows(
    equations: Equations, samples: Samples, state_noise: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> np.ndarray:
    """Errors of some rows of the equations due to the noise of the joint states.

    Args:
        equations: Equations to fit.
        samples: Measured joint states, of which a few are used.
        state_noise: Standard deviations of the noise on the columns of q, dq and ddq.

    Returns:
        Rows at states with the noise added once more, less rows at the measured states, whitened where the samples are
        weighted (rows, columns).
    """
    few = samples[:: max(1, len(samples) // FEW_SAMPLES)]
    rng = np.random.default_rng(0)
    q, dq, ddq = (x + std * rng.normal(size=x.shape) for x, std in zip(few.motion.states, state_noise, strict=True))
    noisy = replace(few, motion=Motion(q, dq, ddq, few.motion.base))

    def rows(part: Samples) -> np.ndarray:
        return np.concatenate([chunk[:-1].reshape(len(chunk) - 1, -1).copy() for chunk in equations.rows(part)], axis=1)

    return (rows(noisy) - rows(few)).T


def check_excitation(root: np.ndarray, names: Sequence[str], samples: int, noise: np.ndarray | None = None) -> None:
    """Raises unless the motion separates all parameters.

    The norms of combinations of unit-norm base columns (the singular values) must exceed rounding and, if the
    regressor's noise is given, `ABOVE_NOISE` times their norm from noise alone: otherwise a joint at rest with noisy
    sensors would pass for excited.

    Args:
        root: Square matrix R with `Yᵀ Y = Rᵀ R` for the base regressor Y (r, r).
        names: Names of its columns (r,).
        samples: Number of samples N.
        noise: Difference between the base regressor at measured states and at states with the sensors' noise added
            once more, for some samples, 6 rows each (rows, r).

    Raises:
        ExcitationError: Some combinations are not excited; it names the base parameters in them.
    """
    norms = np.linalg.norm(root, axis=0)
    still = norms <= ZERO_COLUMN * norms.max(initial=0)
    norms = np.where(still, 1, norms)
    _, lengths, directions = np.linalg.svd(root / norms)
    floor = np.full(len(norms), SINGULAR * lengths.max(initial=0))
    if noise is not None:
        of_noise = np.linalg.norm(noise / norms @ directions.T, axis=0) * np.sqrt(6 * samples / len(noise))
        floor = np.maximum(floor, ABOVE_NOISE * of_noise)
    hidden = directions[lengths <= floor]
    if len(hidden):
        names = contributing(hidden, names)
        raise ExcitationError(
            f"The motion of {samples} samples does not separate the base parameters {listed(names)}: "
            f"{len(norms) - len(hidden)} of {len(norms)} combinations show above the noise. Record longer, or move the "
            "joints further.",
            names,
        )


def excited(equations: Equations, samples: Samples) -> tuple[np.ndarray, ExcitationError | None]:
    """Singular values of the unit-norm columns, each channel divided by its scale, and an error if some are too small.

    The error names the parameters in combinations that the motion does not separate.
    """
    s, directions = _decomposed(equations, samples)
    hidden = directions[s <= s[0] / CONDITION_LIMIT]
    if not len(hidden):
        return s, None
    names = contributing(hidden, equations.names)
    return s, ExcitationError(
        f"In {listed(equations.channels)} the recorded motion excites {len(s) - len(hidden)} of {len(s)} "
        f"parameters; it does not separate {listed(names)}. Move the joints further (`multicontact excite` "
        "designs a motion), measure more, or put in what the model knows (--prior on).",
        names,
    )


def undetermined(equations: Equations, samples: Samples) -> tuple[str, ...]:
    """Names of the base parameters that lie mostly in combinations which the motion does not separate."""
    s, directions = _decomposed(equations, samples)
    hidden = (directions[s <= s[0] / CONDITION_LIMIT] ** 2).sum(axis=0)[: equations.parameters.rank]
    return tuple(name for name, share in zip(equations.names, hidden, strict=False) if share > MOSTLY)


def _decomposed(equations: Equations, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Singular values and right singular vectors of the unit-norm columns, each channel divided by its scale."""
    scales = channel_scales([samples.measured], equations.channels)
    weights = np.broadcast_to(1 / scales, samples.measured.shape)
    columns = accumulate(equations, samples, factors=weights).root[:, : len(equations.names)]
    norms = np.linalg.norm(columns, axis=0)
    # A decomposition of the triangle is faster than one of all rows, and less likely to fail to converge.
    _, s, directions = np.linalg.svd(triangle_of(columns / np.where(norms > 0, norms, 1)))
    return s, directions


def contributing(hidden: np.ndarray, names: Sequence[str]) -> list[str]:
    """Names of the columns that contribute notably to combinations that are not excited (k, r)."""
    size = np.linalg.norm(hidden, axis=0)
    return [name for name, share in zip(names, size, strict=True) if share > 0.1 * size.max()]


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
    rank, count = equations.parameters.rank, equations.parameters.rank + len(equations.drives)
    stays = mask[:count] | (np.arange(count) < rank)
    if stays.all():
        return without
    sizes = np.maximum(np.linalg.norm(columns[:, :count], axis=0), 1e-300)
    unit, names = columns[:, :count] / sizes, np.array(equations.names[:count])
    combined = np.linalg.lstsq(unit[:, stays], unit[:, ~stays], rcond=INDEPENDENT)[0]
    units = combined.T * sizes[~stays, None] / sizes[stays]
    absorbed = {name: each[stays] + each[~stays] @ units for name, each in equations.absorbed.items()}
    absorbed |= dict(zip(names[~stays].tolist(), units, strict=True))
    takes = {*names[stays][(np.abs(combined) > MIXED).any(axis=1)].tolist(), *equations.mixed}
    of_motors = tuple(f"({motor})" for motor in equations.axes.motors)
    mixed = (name for name in without.drives if name in takes and name.endswith(of_motors))
    return replace(without, absorbed=absorbed, mixed=tuple(mixed))


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
