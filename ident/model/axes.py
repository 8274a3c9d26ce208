"""Axes on which drives act: joints, and motors that move several joints together.

    q_motor = R q,    τ = Rᵀ τ_motor

Rotors and friction belong to what turns: where motors are coupled, as in the wrists of arms and in differential drives,
to the motors instead of the joints that they move.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from ident.mechanism.tree import Tree

Couplings = Mapping[str, Mapping[str, float]]
"""Rows of R: by the motors' names, the numbers other than zero by the names of the joints."""

UNCOUPLED: Couplings = MappingProxyType({})
"""No coupled motors."""

OF_JOINTS = ("spring",)
"""Kinds of drives that belong to the joints in any case."""


@dataclass(frozen=True, eq=False)
class Axes:
    """The n freedoms of a mechanism, and k motors that move several of them together.

    Attributes:
        freedoms: Names of the freedoms.
        motors: Names of the motors.
        rows: Numbers R of the motors' rows (k, n).
    """

    freedoms: tuple[str, ...]
    motors: tuple[str, ...]
    rows: np.ndarray

    @classmethod
    def of(cls, tree: Tree, couplings: Couplings = UNCOUPLED) -> "Axes":
        """Axes of a tree; motors of joints that it does not have are left out."""
        freedoms = tree.freedoms
        own = {motor: row for motor, row in couplings.items() if all(joint in freedoms for joint in row)}
        rows = [[row.get(freedom, 0.0) for freedom in freedoms] for row in own.values()]
        return cls(freedoms, tuple(own), np.array(rows, float).reshape(len(own), len(freedoms)))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all axes, the freedoms before the motors."""
        return (*self.freedoms, *self.motors)

    @cached_property
    def matrix(self) -> np.ndarray:
        """Matrix M of the axes' velocities M q̇ and of the freedoms' torques Mᵀ τ (n + k, n)."""
        return np.vstack([np.eye(len(self.freedoms)), self.rows])

    @cached_property
    def gears(self) -> np.ndarray:
        """Largest factor from a freedom's velocity to each axis', 1 for the freedoms themselves (n + k,)."""
        return np.asarray(np.abs(self.matrix).max(axis=1, initial=0.0))

    @cached_property
    def driven(self) -> np.ndarray:
        """Mask of the axes that have rotors and friction: motors, and freedoms that none of them moves (n + k,)."""
        return np.append(~self.rows.any(axis=0), np.ones(len(self.motors), bool))

    def acting(self, kind: str, freedom: int) -> tuple[str, ...]:
        """Names of the axes to which the drives of a kind that act on a freedom belong."""
        if kind in OF_JOINTS:
            return (self.freedoms[freedom],)
        return tuple(self.names[a] for a in np.flatnonzero(self.driven & (self.matrix[:, freedom] != 0)))

    def joints_of(self, name: str) -> tuple[str, ...]:
        """Names of the freedoms that an axis moves, by its name; the name itself for one that is no motor's."""
        if name not in self.motors:
            return (name,)
        row = self.rows[self.motors.index(name)]
        return tuple(freedom for freedom, factor in zip(self.freedoms, row, strict=True) if factor)

    def moved(self, x: np.ndarray) -> np.ndarray:
        """Quantity of the axes, such as their velocities, from that of the freedoms, numbers or signals (…, n)."""
        if not self.motors:
            return x
        of_motors = [sum(x[..., k] * row[k] for k in np.flatnonzero(row)) for row in self.rows]
        return np.concatenate([x, np.stack(of_motors, axis=-1)], axis=-1)
