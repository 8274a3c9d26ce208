"""Drives of joints as a model states them: friction, rotor inertia, springs and actuators."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np

from ident.errors import ModelError


@dataclass(frozen=True)
class Actuator:
    """An actuator that acts on one freedom through a gear.

    With its length `l = gear q` and its command u its force is `F = gain u - kp l - kv l' + bias`, limited to its
    range; the joint's torque is `gear F`. Rotor and damping turn with l, so that the joint has gear² times them,
    and |gear| times its Coulomb friction.

    Attributes:
        name: Its name.
        gear: Its length over the joint's coordinate, for a gearbox the reduction.
        gain: Force over command; zero, like its feedback, if its force is not linear.
        kp: Stiffness of its feedback of length; that of a position servo is its gain as well.
        kv: Damping of its feedback of velocity; that of a velocity servo is its gain as well.
        bias: Constant force.
        rotor: Inertia of its rotor.
        viscous: Viscous friction of its rotor.
        coulomb: Coulomb friction of its rotor.
        forcerange: Limits of its force, None without.
    """

    name: str
    gear: float = 1.0
    gain: float = 1.0
    kp: float = 0.0
    kv: float = 0.0
    bias: float = 0.0
    rotor: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0
    forcerange: tuple[float, float] | None = None

    @property
    def kind(self) -> str:
        """One of `motor`, `position`, `velocity` and, for any other feedback, `general`."""
        if self.bias or not self.gain:
            return "general"
        if not (self.kp or self.kv):
            return "motor"
        return "position" if self.gain == self.kp else "velocity" if not self.kp and self.gain == self.kv else "general"


@dataclass(frozen=True)
class Drive:
    """Drive of one freedom, whose torque is added to that of the links.

    It is `rotor q̈ + viscous q̇ + coulomb sign(q̇) + stiffness (q - springref)`. For the three freedoms of a ball
    q - springref are the components of the rotation vector from the spring's reference, whose own rotation vector from
    coordinate zero has the components springref.

    Attributes:
        viscous: Viscous friction (damping), N m s/rad or N s/m.
        coulomb: Coulomb friction, N m or N.
        rotor: Rotor inertia (armature) seen at the joint, kg m² or kg, without those of the actuators.
        stiffness: Stiffness of its spring, N m/rad or N/m.
        springref: Coordinate at which the spring is at rest, rad or m.
        actuators: Its actuators.
    """

    viscous: float = 0.0
    coulomb: float = 0.0
    rotor: float = 0.0
    stiffness: float = 0.0
    springref: float = 0.0
    actuators: tuple[Actuator, ...] = ()

    def value(self, kind: str) -> float:
        """The value that it and its actuators state for a column of a kind, out of `ident.tolerances.DRIVE`."""
        if kind not in FIELDS:
            return 0.0
        power = POWERS.get(kind)
        of_actuators = 0.0 if power is None else sum(abs(x.gear) ** power * getattr(x, kind) for x in self.actuators)
        return float(getattr(self, FIELDS[kind]) + of_actuators)

    def with_value(self, kind: str, value: float) -> "Drive":
        """The drive with another value of a kind, less its actuators' share; unchanged for kinds that it lacks."""
        if kind not in FIELDS:
            return self
        field = FIELDS[kind]
        of_actuators = self.value(kind) - getattr(self, field)
        return replace(self, **{field: max(0.0, value - of_actuators)})

    def with_servo(self, kp: float, kv: float) -> "Drive":
        """The drive with other gains of its position actuator; unchanged without one, or with several or a gear."""
        at = [k for k, each in enumerate(self.actuators) if each.kind == "position" and each.gear == 1]
        if len(at) != 1:
            return self
        new = replace(self.actuators[at[0]], gain=kp, kp=kp, kv=kv)
        return replace(self, actuators=(*self.actuators[: at[0]], new, *self.actuators[at[0] + 1 :]))


FIELDS = {"rotor": "rotor", "viscous": "viscous", "coulomb": "coulomb", "spring": "stiffness"}
"""Attributes of a drive by the kinds of columns, out of `ident.tolerances.DRIVE`."""

POWERS = {"rotor": 2, "viscous": 2, "coulomb": 1}
"""Powers of a gear by which kinds that actuators have too act on the joint."""

NO_DRIVE = Drive()
"""The drive of a freedom without one."""

_NAMES = {
    "viscous": "damping",
    "coulomb": "Coulomb friction",
    "rotor": "rotor inertia",
    "stiffness": "stiffness",
    "springref": "spring reference",
}
"""Names of the numbers of a drive in messages."""


def checked_drives(drives: Any, freedoms: Collection[str]) -> dict[str, Drive]:
    """Drives by the names of freedoms, checked.

    Raises:
        ModelError: It is no mapping of drives, there is no such freedom, or a number is not finite or negative.
    """
    if not isinstance(drives, Mapping) or not all(isinstance(drive, Drive) for drive in drives.values()):
        raise ModelError(f"drives needs a Drive by the name of each driven freedom, got {drives}.")
    if absent := [name for name in drives if name not in freedoms]:
        raise ModelError(f"drives names '{absent[0]}', which is none of {', '.join(freedoms) or 'no freedoms'}.")
    for name, drive in drives.items():
        for key, what in _NAMES.items():
            _check(f"Joint '{name}'", what, getattr(drive, key), signed=key == "springref")
        for actuator in drive.actuators:
            for key in ("gear", "gain", "kp", "kv", "bias", *POWERS):
                what, value = _NAMES.get(key, key), getattr(actuator, key)
                _check(f"Actuator '{actuator.name}' of joint '{name}'", what, value, signed=key not in POWERS)
    return dict(drives)


def _check(who: str, what: str, value: Any, *, signed: bool = False) -> None:
    """Refuses a number that is not finite or, unless signed, negative."""
    if not isinstance(value, Real) or not np.isfinite(float(value)):
        raise ModelError(f"{who} needs a finite {what}, got {value}.")
    if value < 0 and not signed:
        raise ModelError(f"{who} needs a {what} of at least 0, got {value:g}.")
