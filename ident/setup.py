"""Kinds of set-up errors, one row each: all that the rest of the program asks of a kind, except its mathematics.

A set-up parameter is zero if the set-up is as stated. Its effect on the channels is computed by
`ident.estimation.measurement`, except for a shift of time, which is in the row. To add a kind is to add its row and,
for any other effect, its mathematics there.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    # Commands that offer the kinds as options start without numpy.
    import numpy as np

Shift = Callable[["np.ndarray"], "np.ndarray"]
"""Shift of the samples' true times per unit of a parameter, by the time since the recording's origin, s."""


class Unit(NamedTuple):
    """Unit of a set-up error.

    Attributes:
        si: The SI unit, in which it is computed.
        factor: Factor to the unit in which sentences give it.
        shown: That unit, with the space before it.
        most: Largest standard deviation of a prior, in SI units and radians.
        suffix: Suffix of the key in columns files that give it in another unit.
        stated: Factor from that other unit to SI.
    """

    si: str
    factor: float
    shown: str
    most: float
    suffix: str = ""
    stated: float = 1.0


TIME = Unit("s", 1e3, " ms", 60.0)
SHARE = Unit("1", 100.0, " %", 1.0)
LENGTH = Unit("m", 1e3, " mm", 10.0)
ANGLE = Unit("rad", math.degrees(1), "°", math.pi, "_deg", math.radians(1))
"""Units. No set-up is less certain than a minute, the whole of a channel, ten metres or half a turn."""


@dataclass(frozen=True, kw_only=True)
class SetupKind:
    """A kind of set-up errors.

    In templates, `{of}` is the object's name, `{axis}` the axis and `{link}` the joint at the other end of a link.

    Attributes:
        std: Default standard deviation of the prior, whose mean is zero, in SI units and radians.
        unit: Its unit.
        of: The objects that have it, each along its axes: a key of `ident.estimation.setup_parameters.objects`.
        sentence: Template of the finding, with `{size}` and `{sign}`.
        signs: Words for `{sign}`, of a positive and of a negative error.
        along: Those of an error along a link, in place of `signs`: away from its other end, and towards it.
        short: Template of a few words, for an error that the data cannot distinguish from another one.
        label: Template of its label in the table of a payload's sensor.
        note: What else follows from the error, in a sentence.
        together: Template of a cause that changes several parameters, which the data may not be able to distinguish
            from another error, and which is tried where no parameter alone explains anything; empty for none.
        shift: Shift of the samples' true times; None if the error acts on something else.
        own: True if each of several recordings may have its own.
        far: True if values beyond the reach of a local search are tried first.
        gross: Standard deviation of an error that the data show far beyond what is stated, as a part of another size;
            zero for kinds without one.
        weighs: True if an error changes what the mechanism seems to weigh.
        common: True if the channels of one instrument, a wrench or all joint torques, also share an error that is as
            uncertain as each one's own, as of an amplifier or of a calibration weight.
        stated: True if it is estimated wherever a standard deviation is stated, and nowhere searched for.
    """

    std: float
    unit: Unit
    of: str
    sentence: str
    signs: tuple[str, str] = ("+", "-")
    along: tuple[str, str] = ("", "")
    short: str
    label: str
    note: str = ""
    together: str = ""
    shift: Shift | None = None
    own: bool = False
    far: bool = False
    gross: float = 0.0
    weighs: bool = False
    common: bool = False
    stated: bool = False


def _later(elapsed: "np.ndarray") -> "np.ndarray":
    """Shift by a delay of one second."""
    return 0.0 * elapsed - 1.0


def _acting_later(elapsed: "np.ndarray") -> "np.ndarray":
    """Shift by commands that act a second after they are logged."""
    return 0.0 * elapsed + 1.0


def _slower(elapsed: "np.ndarray") -> "np.ndarray":
    """Shift by a clock whose unit is twice as long."""
    return elapsed


SETUP: Mapping[str, SetupKind] = {
    "delay": SetupKind(
        std=0.05,
        unit=TIME,
        of="clocks",
        sentence="The wrench '{of}' is {size} {sign}",
        signs=("late", "early"),
        short="a delay of the wrench '{of}'",
        label="delay",
        shift=_later,
        own=True,
        far=True,
    ),
    "lag": SetupKind(
        std=0.02,
        unit=TIME,
        of="commands",
        sentence="Commands act {size} {sign} than they are logged and held",
        signs=("later", "earlier"),
        short="a lag of the commands",
        label="lag of the commands",
        shift=_acting_later,
        own=True,
    ),
    "clock": SetupKind(
        std=0.003,
        unit=SHARE,
        of="clocks",
        sentence="The clock of the wrench '{of}' runs {size} {sign}",
        signs=("slow", "fast"),
        short="another clock of the wrench '{of}'",
        label="rate of its clock, less 1",
        shift=_slower,
    ),
    "origin": SetupKind(
        std=0.05,
        unit=LENGTH,
        of="frames",
        sentence="The origin of the wrench '{of}' is {size} further along {sign}{axis} than stated",
        short="another origin of the wrench '{of}' along {axis}",
        label="shift along {axis}",
    ),
    "rotation": SetupKind(
        std=math.radians(3),
        unit=ANGLE,
        of="frames",
        sentence="The frame of the wrench '{of}' is turned by {size} about {sign}{axis} from where it was stated",
        short="a turn of the wrench '{of}' about {axis}",
        label="turn about {axis}",
        weighs=True,
    ),
    "gain": SetupKind(
        std=0.03,
        unit=SHARE,
        of="channels",
        sentence="The channel {of} reads {size} too {sign}",
        signs=("much", "little"),
        short="another gain of the channel {of}",
        label="gain of {of}, less 1",
        weighs=True,
        common=True,
    ),
    "scale": SetupKind(
        std=0.1,
        unit=SHARE,
        of="scales",
        sentence="The stated torque of joint '{of}' is {size} too {sign}",
        signs=("large", "small"),
        short="another scale of the torque of joint '{of}'",
        label="scale of the torque of {of}, less 1",
        weighs=True,
        stated=True,
    ),
    "gravity": SetupKind(
        std=math.radians(3),
        unit=ANGLE,
        of="gravity",
        sentence="Gravity is tilted by {size} about {sign}{axis} of the base frame",
        short="a tilt of gravity about {axis}",
        label="tilt of gravity about {axis}",
        weighs=True,
    ),
    "zero": SetupKind(
        std=math.radians(3),
        unit=ANGLE,
        of="angles",
        sentence="The joint '{of}' reads {size} too {sign}",
        signs=("much", "little"),
        short="another zero of joint '{of}'",
        label="zero of joint {of}",
    ),
    "axis": SetupKind(
        std=math.radians(3),
        unit=ANGLE,
        of="axes",
        sentence="The axis of joint '{of}' is tilted by {size} about {sign}{axis} of its body's frame",
        short="a tilt of the axis of joint '{of}' about {axis}",
        label="tilt of the axis of joint {of} about {axis}",
        together="a turn of all joint axes about {}",
    ),
    "centre": SetupKind(
        std=0.001,
        unit=LENGTH,
        of="centres",
        gross=0.1,
        sentence="The joint '{of}' lies {size} {sign} than in the model",
        signs=("farther along +{axis} of its parent's frame", "farther along -{axis} of its parent's frame"),
        along=("farther from the joint '{link}'", "nearer to the joint '{link}'"),
        short="another place of joint '{of}' along {axis} of its parent's frame",
        label="shift of joint {of} along {axis} of its parent's frame",
        together="another length of every link from {}",
        note="Inertias of an updated model belong to that place, which --write-geometry writes, too. "
        "At the model's place they act alike at rest without contacts beyond the joint, with one more first moment of "
        "the body that carries it: this shift times the mass beyond. In motion none do; centre = 0 under [setup] fits "
        "best.",
    ),
    "torque_delay": SetupKind(
        std=0.01,
        unit=TIME,
        of="torque_clocks",
        sentence="The joint torques are {size} {sign}",
        signs=("late", "early"),
        short="a delay of the joint torques",
        label="delay of the joint torques",
        shift=_later,
        own=True,
    ),
    "tracker_delay": SetupKind(
        std=0.05,
        unit=TIME,
        of="tracker_clocks",
        sentence="The poses of tracked bodies are {size} {sign}",
        signs=("late", "early"),
        short="a delay of the poses of tracked bodies",
        label="delay of the poses of tracked bodies",
        shift=_later,
        own=True,
    ),
}
"""Every kind of set-up error by its name, in the order of the parameters."""

OFFSET, FRICTION = "offset", "friction"
OWN = (OFFSET, FRICTION, *(kind for kind, row in SETUP.items() if row.own))
"""Kinds of parameters that each of several recordings may have separately."""

PRIORS = {kind: row.std for kind, row in SETUP.items()}
"""Default standard deviations of the priors."""

LARGEST = {kind: row.unit.most for kind, row in SETUP.items()}
"""Largest standard deviations that a prior may have."""

OF_PEOPLE = 0.01
"""Standard deviation of the joint centres in models of people, m: regressions and scaling place them to 10 to 20 mm."""
