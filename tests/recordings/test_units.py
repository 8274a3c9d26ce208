"""Units of logs, against the constants of physics."""

import pytest
from scipy import constants

from ident.files.column import UNITS

TURN, FORCE = 2 * constants.pi, {"N": 1.0, "mN": constants.milli, "kN": constants.kilo}
LENGTH = {"m": 1.0, "cm": constants.centi, "mm": constants.milli}
ANGLE = {"rad": 1.0, "deg": constants.degree}
PAIRS = ("N", "m"), ("N", "mm"), ("mN", "m"), ("kN", "m")
MOMENT = {f"{force}{space}{arm}": FORCE[force] * LENGTH[arm] for force, arm in PAIRS for space in ("", " ")}


def rates(units, seconds):
    return {f"{unit}{per}": size for unit, size in units.items() for per in seconds}


SECOND, SQUARED = ("/s",), ("/s^2", "/s2", "/s²")
EXPECTED = {
    "time": {"s": 1.0, "ms": constants.milli, "us": constants.micro, "ns": constants.nano},
    "hinge position": ANGLE,
    "hinge velocity": rates(ANGLE, SECOND) | {"rpm": TURN / constants.minute},
    "hinge acceleration": rates(ANGLE, SQUARED),
    "hinge torque": MOMENT,
    "hinge command": ANGLE,
    "ball position": {"1": 1.0},
    "ball velocity": rates(ANGLE, SECOND),
    "ball acceleration": rates(ANGLE, SQUARED),
    "ball torque": MOMENT,
    "slide position": LENGTH,
    "slide velocity": rates(LENGTH, SECOND),
    "slide acceleration": rates(LENGTH, SQUARED),
    "slide torque": FORCE,
    "slide command": LENGTH,
    "force": FORCE,
    "torque": MOMENT,
    "length": LENGTH,
}


@pytest.mark.parametrize("quantity", UNITS)
def test_units_are_what_they_are_in_si(quantity):
    assert UNITS[quantity] == pytest.approx(EXPECTED[quantity], rel=1e-12)
    assert next(iter(UNITS[quantity].values())) == 1
