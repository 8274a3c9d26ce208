"""Two models side by side: quantities of their bodies and of the drives of their joints."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.geometry.inertia import com_from_parameters
from ident.mechanism.drives import FIELDS, Drive
from ident.mechanism.mechanism import Mechanism
from ident.tolerances import DRIVE, DRIVE_UNITS

OF_BODIES = (
    ("mass", "kg"),
    *((f"centre of mass {axis}", "m") for axis in "xyz"),
    *((f"inertia {pair}", "kg m²") for pair in ("xx", "yy", "zz", "xy", "xz", "yz")),
)
"""Quantities of a body with their units: centre of mass in its frame, inertia about it."""

OF_SERVOS = {"kp": ("N m/rad", "N/m"), "kv": ("N m s", "N s/m")}
"""Gains of servos with their units, of joints that turn and of those that slide."""


ROUNDING = 1e-9
"""Relative difference that counts as rounding, below a thousandth of an SI unit as if of that."""


@dataclass(frozen=True)
class Pair:
    """One quantity in both models.

    Attributes:
        of: Name of the body or the joint.
        quantity: Its name.
        unit: Its unit.
        first: Value in the first model.
        second: Value in the second one.
    """

    of: str
    quantity: str
    unit: str
    first: float
    second: float

    @property
    def difference(self) -> float:
        """Second value less the first."""
        return self.second - self.first

    @property
    def differs(self) -> bool:
        """True if the difference is more than rounding."""
        return abs(self.difference) > ROUNDING * max(1e-3, abs(self.first), abs(self.second))

    @property
    def percent(self) -> float | None:
        """Difference in % of the first value, None where that is zero."""
        return 100 * self.difference / abs(self.first) if self.first else None


@dataclass(frozen=True, eq=False)
class ModelPair:
    """Two models.

    Attributes:
        names: Their names.
        mechanisms: Their mechanisms.
    """

    names: tuple[str, str]
    mechanisms: tuple[Mechanism, Mechanism]

    @property
    def bodies(self) -> list[Pair]:
        """Quantities of the bodies that both have."""
        first, second = (_of_bodies(each) for each in self.mechanisms)
        return [
            Pair(name, quantity, unit, a, b)
            for name in first
            if name in second
            for (quantity, unit), a, b in zip(OF_BODIES, first[name], second[name], strict=True)
        ]

    @property
    def drives(self) -> list[Pair]:
        """Quantities of the drives of the freedoms that both have, where one of the models states them."""
        (one, _), turns = self.mechanisms, _turns(self.mechanisms[0])
        values = [
            {freedom: dict(_of_drive(each, freedom)) for freedom in each.tree.freedoms} for each in self.mechanisms
        ]
        units = {kind: DRIVE_UNITS[DRIVE[kind]] for kind in FIELDS} | OF_SERVOS | {"spring reference": ("rad", "m")}
        return [
            Pair(freedom, quantity, units[quantity][not turns[freedom]], *both)
            for freedom in one.tree.freedoms
            if freedom in values[1]
            for quantity in units
            if any(both := [each[freedom][quantity] for each in values])
        ]

    @property
    def alone(self) -> list[str]:
        """Sentences on the bodies and joints that only one of the models has."""
        sentences = []
        for this, other in ((0, 1), (1, 0)):
            for what in ("bodies", "joints"):
                own, theirs = (getattr(self.mechanisms[k], what) for k in (this, other))
                if missing := [name for name in own if name not in theirs]:
                    sentences.append(f"Only {self.names[this]} has the {what} {', '.join(missing)}.")
        return sentences


def _of_bodies(mechanism: Mechanism) -> dict[str, list[float]]:
    """Values of `OF_BODIES` by the names of the bodies with mass."""
    out = {}
    for name, phi in zip(mechanism.bodies, mechanism.known.reshape(-1, 10), strict=True):
        mass, center, inertia = com_from_parameters(phi) if phi[0] else (0.0, np.zeros(3), np.zeros((3, 3)))
        entries = inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        out[name] = [float(mass), *center.tolist(), *entries.tolist()]
    return out


def _of_drives(mechanism: Mechanism) -> dict[str, dict[str, float]]:
    """Quantities of the drives by freedom."""
    return {freedom: dict(_of_drive(mechanism, freedom)) for freedom in mechanism.tree.freedoms}


def _of_drive(mechanism: Mechanism, freedom: str) -> Iterator[tuple[str, float]]:
    """Yields the quantities of the drive of a freedom."""
    drive = mechanism.drives.get(freedom, Drive())
    yield from ((kind, drive.value(kind)) for kind in FIELDS)
    yield "spring reference", drive.springref
    for gain in OF_SERVOS:
        yield gain, sum(each.gear**2 * getattr(each, gain) for each in drive.actuators)


def _turns(mechanism: Mechanism) -> Mapping[str, bool]:
    """True for each freedom that turns, by name."""
    motions = [(body.freedom_names, body.motions) for body in mechanism.tree.bodies if body.freedoms]
    return {
        name: bool(motion[3:].any())
        for names, columns in motions
        for name, motion in zip(names, np.transpose(columns), strict=True)
    }


def pairs(names: Sequence[str], mechanisms: Sequence[Mechanism]) -> list[ModelPair]:
    """The first of several models with each of the others."""
    others = zip(names[1:], mechanisms[1:], strict=True)
    return [ModelPair((names[0], name), (mechanisms[0], each)) for name, each in others]
