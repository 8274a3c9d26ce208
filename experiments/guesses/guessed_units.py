"""Units of joints' columns by the file, their names, their rates and their size, and rates as derivatives."""

import numpy as np

from experiments.guesses.belief import DOUBTFUL, LIKELY, SURE, Belief, Quantity
from experiments.guesses.log_contents import LogContents
from ident.files.column import UNITS
from ident.recordings.plausibility import rate_factor

ROUND = 2 * np.pi + 0.5
"""Largest angle of a joint that is plausible in radians."""

LONG = 20.0
"""Largest travel of a slide that is plausible in metres."""

PERCENT, NORMALIZED = 100.0, ".pos"
"""Largest number and end of the name of a position that may be a percentage of a calibrated range: LeRobot writes such
ones, or degrees, under the same names."""

EXACT = 1.25
"""Ratio of a rate to the derivative, and its inverse, up to which they are in one unit."""


def set_units(belief: Belief) -> list[str]:
    """Sets units of positions by the file, their names, their velocities' units, and their size.

    Returns:
        Joints with angles whose unit was chosen by size, or because others have it.
    """
    log, kinds, open_ones = belief.log, belief.kinds, list[Quantity]()
    for x in belief.of("position").values():
        stated = belief.stated(x)
        x.unit = "" if x.column in log.units else stated or _unit_by_rate(belief, x)
        if x.column in log.units:
            x.why.append("the file knows its unit")
        elif x.unit:
            x.why.append(f"{x.unit} by its name" if stated else f"{x.unit} by its velocity, whose name has a unit")
        elif x.column in log.columns:
            open_ones.append(x)
    for kind, limit, larger, usual in (("hinge", ROUND, "deg", "rad"), ("slide", LONG, "mm", "m")):
        those = [x for x in open_ones if kinds[x.joint] == kind]
        others = {x.unit for joint, x in belief.of("position").items() if kinds[joint] == kind} - {""}
        sizes = {x.joint: log.largest(x.column) for x in those}
        # A program has one unit for all angles.
        unit = others.pop() if len(others) == 1 else larger if max(sizes.values(), default=0) > limit else usual
        for x in those:
            alike = sizes[x.joint] > limit or unit == usual
            x.unit, x.sure = unit, x.sure if alike else LIKELY
            others_are = "" if alike else f", and others are in {unit}"
            x.why.append(f"{unit} since it goes to {sizes[x.joint]:.3g}{others_are}")
    return [x.joint for x in open_ones if kinds[x.joint] == "hinge"]


def _unit_by_rate(belief: Belief, position: Quantity) -> str:
    """Unit of a position in which the derivative is the velocity in the unit that its name states; "" if unknown."""
    rate, log = belief.of("velocity").get(position.joint), belief.log
    if not rate or not belief.stated(rate) or not {rate.column, position.column} <= log.columns.keys():
        return ""
    kind = belief.kinds[position.joint]
    ratio = abs(rate_factor(log.time, log.columns[position.column], log.columns[rate.column]))
    ratio *= UNITS[f"{kind} velocity"][belief.stated(rate)]
    units = UNITS[f"{kind} position"]
    return next((own for own, scale in units.items() if _is_one(ratio / scale)), "")


def _is_one(ratio: float) -> bool:
    return 1 / EXACT < abs(ratio) < EXACT


def set_rates(belief: Belief) -> None:
    """Sets units and signs of velocities and accelerations as derivatives; drops columns that are no derivatives."""
    log = belief.log
    for kind, of in (("velocity", "position"), ("acceleration", "velocity")):
        for joint, quantity in belief.of(kind).items():
            x, dx = belief.values(joint, of), log.columns.get(quantity.column)
            if x is None or dx is None:
                continue
            choices = UNITS[f"{belief.kinds[joint]} {kind}"]
            if quantity.column in log.units:
                choices = {"": belief.factor(quantity)}
            ratio = rate_factor(log.time, x, dx)
            fits = {unit: ratio * c for unit, c in choices.items() if _is_one(ratio * c)}
            if not fits:
                quantity.why = [f"it is {ratio:.3g} times the derivative" if ratio else "it is not the derivative"]
                belief.notes.append(
                    f"Column '{quantity.column}' is named like the {kind} of '{joint}', but {quantity.why[0]} of what "
                    f"is taken for its {of}; it is left out."
                )
                quantity.column, quantity.sure = "", SURE
                continue
            stated = belief.stated(quantity)
            quantity.unit = stated if stated in fits else next(iter(fits))
            ratio = fits[quantity.unit]
            quantity.gain, quantity.sure = (-1.0 if ratio < 0 else 1.0), SURE
            in_unit = f" in {quantity.unit}" if quantity.unit else ""
            quantity.why.append(f"{ratio:.2f} times the derivative of the {of}{in_unit}")


def is_rate(log: LogContents, position: str, rate: str) -> bool:
    """True where a column may be the derivative of another, in any unit and of either sign."""
    size = rate_factor(log.time, log.columns[position], log.columns[rate])
    return any(_is_one(size / unit) for unit in (1.0, 180 / np.pi, np.pi / 180))


def doubt_units(belief: Belief, joints: list[str]) -> None:
    """Makes positions likely whose unit their size alone suggests, and remarks of those that may be percentages."""
    percentages = list[str]()
    for joint, x in belief.of("position").items():
        if joint in joints and x.sure == SURE:
            x.sure = LIKELY
            x.why.append("which nothing else shows")
        is_open = x.column.endswith(NORMALIZED) and x.unit in ("deg", "mm") and x.sure != SURE
        if x.about.unit == "%" or (is_open and belief.log.largest(x.column) <= PERCENT):
            percentages.append(joint)
            x.sure = DOUBTFUL
    if percentages:
        belief.ask(
            f"The positions of {', '.join(percentages)} may be percentages of calibrated ranges. Map degrees by "
            'unit = "deg", percentages by unit, gain and constant, so that gain * column + constant is the position.',
            percentages,
        )
