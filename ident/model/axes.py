"""Axes on which drives act: joints, motors that move several joints together, and joints that loops make dependent.

    q_motor = R q,    τ = Rᵀ τ_motor

Rotors and friction belong to what turns: where motors are coupled, as in the wrists of arms and in differential drives,
to the motors instead of the joints that they move.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from ident.geometry.se3 import applied
from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.tolerances import DRIVE

Couplings = Mapping[str, Mapping[str, float]]
"""Rows of R: by the motors' names, the numbers other than zero by the names of the joints."""

UNCOUPLED: Couplings = MappingProxyType({})
"""No coupled motors."""

OF_JOINTS = ("spring",)
"""Kinds of drives that belong to the joints in any case."""


@dataclass(frozen=True, eq=False)
class Axes:
    """The n freedoms of a mechanism, k motors that move several of them together, and d dependent joints of loops.

    Attributes:
        freedoms: Names of the freedoms.
        motors: Names of the motors.
        rows: Numbers R of the motors' rows (k, n).
        dependent: Names of the dependent joints.
        nominal: Their velocities over those of the freedoms in the model's posture, for weights alone (d, n).
    """

    freedoms: tuple[str, ...]
    motors: tuple[str, ...]
    rows: np.ndarray
    dependent: tuple[str, ...]
    nominal: np.ndarray

    @classmethod
    def of(cls, tree: Tree, couplings: Couplings = UNCOUPLED) -> "Axes":
        """Axes of a tree; motors of joints that it does not have are left out."""
        freedoms = tree.freedoms
        own = {motor: row for motor, row in couplings.items() if all(joint in freedoms for joint in row)}
        rows = [[row.get(freedom, 0.0) for freedom in freedoms] for row in own.values()]
        motors = np.array(rows, float).reshape(len(own), len(freedoms))
        return cls(freedoms, tuple(own), motors, tree.dependent, tree.slopes_in_posture)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all axes: the freedoms, the motors and the dependent joints."""
        return (*self.freedoms, *self.motors, *self.dependent)

    @cached_property
    def matrix(self) -> np.ndarray:
        """Matrix M of the axes' velocities M q̇ and of the freedoms' torques Mᵀ τ, nominal at last (n + k + d, n)."""
        return np.vstack([np.eye(len(self.freedoms)), self.rows, self.nominal])

    @cached_property
    def gears(self) -> np.ndarray:
        """Largest factor from a freedom's velocity to each axis', 1 for the joints themselves (n + k + d,)."""
        motors = np.abs(self.rows).max(axis=1, initial=0.0)
        return np.concatenate([np.ones(len(self.freedoms)), motors, np.ones(len(self.dependent))])

    @cached_property
    def driven(self) -> np.ndarray:
        """Mask of the axes that have rotors and friction: all but freedoms that motors move (n + k + d,)."""
        return np.append(~self.rows.any(axis=0), np.ones(len(self.motors) + len(self.dependent), bool))

    def acting(self, kind: str, freedom: int) -> tuple[str, ...]:
        """Names of the freedoms and motors to which the drives of a kind that act on a freedom belong."""
        if kind in OF_JOINTS:
            return (self.freedoms[freedom],)
        actuated = np.arange(len(self.names)) < len(self.freedoms) + len(self.motors)
        return tuple(self.names[a] for a in np.flatnonzero(actuated & self.driven & (self.matrix[:, freedom] != 0)))

    def joints_of(self, name: str) -> tuple[str, ...]:
        """Names of the freedoms that an axis moves, by its name; the name itself for one that is no motor's."""
        if name not in self.motors:
            return (name,)
        row = self.rows[self.motors.index(name)]
        return tuple(freedom for freedom, factor in zip(self.freedoms, row, strict=True) if factor)

    def moved(self, x: np.ndarray, dependent: np.ndarray | None = None) -> np.ndarray:
        """Quantity of the axes, such as their velocities, from that of the freedoms, numbers or signals (…, n).

        Args:
            x: Quantity of the freedoms.
            dependent: That of the dependent joints (…, d), by default a nominal one.
        """
        if len(self.names) == len(self.freedoms):
            return x
        others = self.rows if dependent is not None else np.vstack([self.rows, self.nominal])
        moved = [sum((x[..., k] * row[k] for k in np.flatnonzero(row)), 0 * x[..., 0]) for row in others]
        parts = [x, *(each[..., None] for each in map(np.asarray, moved))]
        return np.concatenate(parts if dependent is None else [*parts, dependent], axis=-1)

    def felt(self, tree: Tree, q: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Torques of the freedoms (…, n) from those of the axes (…, m), at joint coordinates (…, n_q)."""
        actuated = len(self.freedoms) + len(self.motors)
        out = torques[..., :actuated] @ self.matrix[:actuated]
        if self.dependent:
            out = out + applied(np.swapaxes(tree.slopes(q), -1, -2), torques[..., actuated:])
        return np.asarray(out)


def stated_values(mechanism: Mechanism, names: Sequence[str]) -> np.ndarray:
    """Values that the model states for columns such as `Fv(elbow)`, zero where it states none (d,)."""
    places = map(column_place, names)
    return np.array([mechanism.drives.get(freedom, NO_DRIVE).value(kind) for kind, freedom in places], float)


def with_values(mechanism: Mechanism, values: Mapping[str, float]) -> dict[str, Drive]:
    """Drives with other values of some columns, of the freedoms that these are of, by name."""
    drives = dict[str, Drive]()
    for name, value in values.items():
        kind, freedom = column_place(name)
        before = drives.get(freedom, mechanism.drives.get(freedom, NO_DRIVE))
        drives[freedom] = before.with_value(kind, value)
    return drives


def column_place(name: str) -> tuple[str, str]:
    """Kind and freedom of a column such as `Fv(elbow)`."""
    column, _, freedom = name.removesuffix(")").partition("(")
    return next(kind for kind, own in DRIVE.items() if own == column), freedom
