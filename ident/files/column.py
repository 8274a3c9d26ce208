"""Units of columns, and quantities computed from columns by gains, constants and the matrices of coupled motors."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import LogError

KINDS = {
    "position": ("{}_position", "q_{}", "{}"),
    "velocity": ("{}_velocity", "dq_{}"),
    "acceleration": ("{}_acceleration", "ddq_{}"),
    "torque": ("{}_torque", "tau_{}"),
}
"""Quantities of a joint and the names of their columns; for a ball, before the suffixes `.w`, `.x` and so on."""

COMMAND = "{}_command"
"""Name of the column of a hinge's or slide's commanded position."""

BALL = {"position": "wxyz", "velocity": "xyz", "acceleration": "xyz", "torque": "xyz"}
"""Suffixes of a ball's columns: a quaternion, and vectors in the body's frame."""

_DEG = np.pi / 180
_SQUARED = ("^2", "2", "²")
_ANGLE = {"rad": 1.0, "deg": _DEG}
_RATE = {f"{u}/s": f for u, f in _ANGLE.items()}
_ACCELERATION = {f"{u}/s{s}": f for u, f in _ANGLE.items() for s in _SQUARED}
_LENGTH = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORCE = {"N": 1.0, "mN": 1e-3, "kN": 1e3}
_MOMENT = {"N m": 1.0, "Nm": 1.0, "N mm": 1e-3, "Nmm": 1e-3, "mN m": 1e-3, "mNm": 1e-3, "kN m": 1e3, "kNm": 1e3}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "hinge position": _ANGLE,
    "hinge velocity": _RATE | {"rpm": np.pi / 30},
    "hinge acceleration": _ACCELERATION,
    "hinge torque": _MOMENT,
    "hinge command": _ANGLE,
    "ball position": {"1": 1.0},
    "ball velocity": _RATE,
    "ball acceleration": _ACCELERATION,
    "ball torque": _MOMENT,
    "slide position": _LENGTH,
    "slide velocity": {f"{u}/s": f for u, f in _LENGTH.items()},
    "slide acceleration": {f"{u}/s{s}": f for u, f in _LENGTH.items() for s in _SQUARED},
    "slide torque": _FORCE,
    "slide command": _LENGTH,
    "force": _FORCE,
    "torque": _MOMENT,
    "length": _LENGTH,
}
"""Units of every quantity, as factors to SI; the first is the default."""

CURRENT = {"A": 1.0, "mA": 1e-3}
"""Units of a motor's current; a gain turns it into a torque in N m or a force in N."""

SINGULAR = 1e6
"""Condition number from which a coupling's matrix counts as singular."""


@dataclass(frozen=True)
class Sum:
    """A column computed from others: Σ weight · column + constant, or a constant alone.

    Attributes:
        columns: Names of the columns in the sum, each once.
        weights: Weight of each column.
        constant: Constant that is added.
    """

    columns: tuple[str, ...]
    weights: tuple[float, ...]
    constant: float = 0.0

    @property
    def name(self) -> str:
        """Name in messages and in a mapping, such as `0.5*qm5 + 0.5*qm6 - 3`."""
        terms = [f"{w:+.9g}*{name}" for w, name in zip(self.weights, self.columns, strict=True)]
        terms += [f"{self.constant:+.9g}"] if self.constant else []
        text = " ".join(terms).removeprefix("+").replace(" +", " + ").replace(" -", " - ")
        return text if self.columns else f"constant {self.constant:.9g}"

    def of(self, columns: Sequence[np.ndarray], samples: int) -> np.ndarray:
        """Values of the sum from those of its columns (N,), NaN where one of them is missing (N,)."""
        constant = np.full(samples, self.constant)
        return np.tensordot(self.weights, np.stack(columns), axes=1) + constant if columns else constant


@dataclass(frozen=True)
class Columns:
    """Columns that make one quantity.

    Attributes:
        names: Their names, "" for those that are missing.
        factor: Their unit as a factor to the SI's.
        unit: The SI's unit, "" unless a unit is stated.
        sums: Those of them that are computed; `names` has their names.
    """

    names: tuple[str, ...]
    factor: float = 1.0
    unit: str = ""
    sums: tuple[Sum, ...] = ()

    @property
    def read(self) -> tuple[str, ...]:
        """Names of the columns of the file that are read."""
        computed = {each.name: each.columns for each in self.sums}
        return tuple(column for name in filter(None, self.names) for column in computed.get(name, (name,)))

    @property
    def alone(self) -> tuple[str, ...]:
        """Names of the columns, no constants; a sum of one column counts as that column, of several by its own name."""
        single = {each.name: each.columns for each in self.sums if len(each.columns) < 2}
        return tuple(own for name in filter(None, self.names) for own in single.get(name, (name,)))

    @property
    def line(self) -> tuple[float, float]:
        """Factor and constant of a single quantity from one column, in SI units."""
        (term,) = self.sums or (Sum(self.names, (1.0,)),)
        return self.factor * term.weights[0], self.factor * term.constant


def joints_behind_motors(matrix: np.ndarray, kind: str, motors: Sequence[Columns]) -> list[Columns]:
    """Columns of joints driven by coupled motors: q_motor = R q, so q = R⁻¹ q_motor and τ = Rᵀ τ_motor.

    Args:
        matrix: R, of motors by joints (n, n).
        kind: Quantity of the columns, `position`, `velocity`, `acceleration` or `torque`.
        motors: A column of each motor.

    Returns:
        A column of each joint, in SI units; the caller sets `unit`.

    Raises:
        LogError: R has no inverse.
    """
    if not np.linalg.cond(matrix) < SINGULAR:
        raise LogError(f"needs a matrix that can be inverted, got {matrix.tolist()}.")
    weights = matrix.T if kind == "torque" else np.linalg.inv(matrix)
    weights[np.abs(weights) < np.finfo(float).eps * np.abs(weights).max() * len(weights)] = 0
    return [combined(row, motors) for row in weights]


def combined(weights: Iterable[float], motors: Sequence[Columns]) -> Columns:
    """Σ weight · motor in SI units, with motors that may be sums themselves expanded into one sum of columns."""
    terms: dict[str, float] = {}
    constant = 0.0
    for weight, motor in zip(weights, motors, strict=True):
        if not weight:
            continue
        (name,) = motor.names
        (inner,) = motor.sums or (Sum((name,), (1.0,)),)
        scale = float(weight) * motor.factor
        constant += scale * inner.constant
        for column, share in zip(inner.columns, inner.weights, strict=True):
            terms[column] = terms.get(column, 0.0) + scale * share
    total = Sum(tuple(terms), tuple(terms.values()), constant)
    return Columns((total.name,), sums=(total,))
