"""Two models side by side: quantities of their bodies and of the drives of their joints."""

from collections.abc import Iterator, Sequence
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
        size: Size in the first model: of a centre of mass its distance from the body's frame, of an inertia its largest
            principal moment, else of the value itself.
    """

    of: str
    quantity: str
    unit: str
    first: float
    second: float
    size: float

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
        """Difference in % of the first's size, zero if it is rounding; None where only the second has a size."""
        if not self.differs:
            return 0.0
        return 100 * self.difference / self.size if self.size else None


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
            Pair(name, quantity, unit, a, b, size)
            for name in first
            if name in second
            for (quantity, unit), a, b, size in zip(
                OF_BODIES, first[name], second[name], _sizes(first[name]), strict=True
            )
        ]

    @property
    def drives(self) -> list[Pair]:
        """Quantities of the drives of the freedoms that move alike in both, where one of the models states them."""
        first, second = (_turns(each) for each in self.mechanisms)
        units = {kind: DRIVE_UNITS[DRIVE[kind]] for kind in FIELDS} | OF_SERVOS | {"spring reference": ("rad", "m")}
        pairs = []
        for freedom in (name for name, turns in first.items() if second.get(name) == turns):
            values = [dict(_of_drive(each, freedom)) for each in self.mechanisms]
            for quantity, unit in units.items():
                one, other = (each[quantity] for each in values)
                if one or other:
                    pairs.append(Pair(freedom, quantity, unit[not first[freedom]], one, other, abs(one)))
        return pairs

    @property
    def unlike(self) -> list[str]:
        """Joints of both models that move in another way in each, so that their drives have no common unit."""
        first, second = (_motions(each) for each in self.mechanisms)
        return [joint for joint, motion in first.items() if joint in second and second[joint] != motion]

    @property
    def alone(self) -> list[str]:
        """Sentences on the bodies with mass and joints that only one has, and on joints that move differently."""
        sentences = []
        bodies, joints = [_with_mass(each) for each in self.mechanisms], [each.joints for each in self.mechanisms]
        for this, other in ((0, 1), (1, 0)):
            for what, names in (("bodies", bodies), ("joints", joints)):
                if missing := [name for name in names[this] if name not in getattr(self.mechanisms[other], what)]:
                    sentences.append(f"Only {self.names[this]} has the {what} {', '.join(missing)}.")
        if self.unlike:
            both, unlike = " and ".join(self.names), ", ".join(self.unlike)
            sentences.append(f"Drives of joints that move in another way in {both} are not compared: {unlike}.")
        return sentences


def _of_bodies(mechanism: Mechanism) -> dict[str, list[float]]:
    """Values of `OF_BODIES` by the names of the bodies."""
    out = {}
    for name, phi in zip(mechanism.bodies, mechanism.known.reshape(-1, 10), strict=True):
        mass, center, inertia = com_from_parameters(phi) if phi[0] else (0.0, np.zeros(3), np.zeros((3, 3)))
        entries = inertia[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
        out[name] = [float(mass), *center.tolist(), *entries.tolist()]
    return out


def _with_mass(mechanism: Mechanism) -> list[str]:
    """Names of the bodies with mass; others, as a URDF file's root, are mere frames."""
    masses = mechanism.known[::10]
    return [name for name, mass in zip(mechanism.bodies, masses, strict=True) if mass]


def _sizes(values: Sequence[float]) -> list[float]:
    """Sizes of the values of `OF_BODIES`, each of its kind."""
    mass, *rest = values
    xx, yy, zz, xy, xz, yz = rest[3:]
    inertia = np.linalg.norm([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], 2)
    return [abs(mass), *[float(np.linalg.norm(rest[:3]))] * 3, *[float(inertia)] * 6]


def _of_drive(mechanism: Mechanism, freedom: str) -> Iterator[tuple[str, float]]:
    """Yields the quantities of the drive of a freedom."""
    drive = mechanism.drives.get(freedom, Drive())
    yield from ((kind, drive.value(kind)) for kind in FIELDS)
    yield "spring reference", drive.springref
    for gain in OF_SERVOS:
        yield gain, sum(each.gear**2 * getattr(each, gain) for each in drive.actuators)


def _motions(mechanism: Mechanism) -> dict[str, dict[str, bool]]:
    """Freedoms of each joint by its name, with True for those that turn."""
    return {
        body.joint: {
            name: bool(motion[3:].any())
            for name, motion in zip(body.freedom_names, np.transpose(body.motions), strict=True)
        }
        for body in mechanism.tree.bodies
        if body.freedoms
    }


def _turns(mechanism: Mechanism) -> dict[str, bool]:
    """True for each freedom that turns, by name."""
    return {name: turns for joint in _motions(mechanism).values() for name, turns in joint.items()}


def pairs(names: Sequence[str], mechanisms: Sequence[Mechanism]) -> list[ModelPair]:
    """The first of several models with each of the others."""
    others = zip(names[1:], mechanisms[1:], strict=True)
    return [ModelPair((names[0], name), (mechanisms[0], each)) for name, each in others]
