"""Units of joints' columns by the file, their names, their rates and their size, and rates as derivatives."""

from collections.abc import Mapping

import numpy as np

from experiments.guesses.belief import DOUBTFUL, LIKELY, SURE, Belief, Quantity
from experiments.guesses.log_contents import LogContents
from experiments.guesses.words import unit_of, words
from ident.files.column import CURRENT, UNITS
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


def set_units(belief: Belief, contents: LogContents, kinds: Mapping[str, str]) -> list[str]:
    """Sets units of positions by the file, their names, their velocities' units, and their size.

    Returns:
        Joints with angles whose unit was chosen by size, or because others have it.
    """
    open_ones = list[Quantity]()
    for joint, x in belief.of("position").items():
        stated = unit_of(f"{kinds[joint]} position", words(x.column).unit)
        by_rate = "" if stated else _unit_by_rate(belief, contents, kinds, joint)
        if x.column in contents.units:
            x.why.append("the file knows its unit")
        elif stated or by_rate:
            x.unit = stated or by_rate
            x.why.append(f"{stated} by its name" if stated else f"{by_rate} by its velocity, whose name has a unit")
        else:
            open_ones.append(x)
    for kind, limit, larger, usual in (("hinge", ROUND, "deg", "rad"), ("slide", LONG, "mm", "m")):
        those = [x for x in open_ones if kinds[x.joint] == kind and x.column in contents.columns]
        others = {x.unit for joint, x in belief.of("position").items() if kinds[joint] == kind} - {""}
        sizes = [np.abs(contents.columns[x.column]).max() for x in those]
        # A program has one unit for all angles.
        unit = others.pop() if len(others) == 1 else larger if max(sizes, default=0) > limit else usual
        for x, size in zip(those, sizes, strict=True):
            alike = size > limit or unit == usual
            x.unit, x.sure = unit, x.sure if alike else LIKELY
            x.why.append(f"{unit} since it goes to {size:.3g}" + ("" if alike else f", and others are in {unit}"))
    return [x.joint for x in open_ones if kinds[x.joint] == "hinge" and x.column in contents.columns]


def _unit_by_rate(belief: Belief, contents: LogContents, kinds: Mapping[str, str], joint: str) -> str:
    """Unit of a position in which the derivative is the velocity in the unit that its name states; "" if unknown."""
    rate, column = belief.of("velocity").get(joint), belief.of("position")[joint].column
    unit = unit_of(f"{kinds[joint]} velocity", words(rate.column).unit) if rate else ""
    if not rate or not unit or rate.column not in contents.columns or column not in contents.columns:
        return ""
    ratio = abs(rate_factor(contents.time, contents.columns[column], contents.columns[rate.column]))
    ratio *= UNITS[f"{kinds[joint]} velocity"][unit]
    units = UNITS[f"{kinds[joint]} position"]
    return next((own for own, scale in units.items() if 1 / EXACT < ratio / scale < EXACT), "")


def set_rates(belief: Belief, contents: LogContents, kinds: Mapping[str, str]) -> None:
    """Sets units and signs of velocities and accelerations as derivatives; drops columns that are no derivatives."""
    for kind, of in (("velocity", "position"), ("acceleration", "velocity")):
        for joint, quantity in belief.of(kind).items():
            x = _values(belief, contents, kinds, joint, of)
            dx = contents.columns.get(quantity.column)
            if x is None or dx is None:
                continue
            choices = UNITS[f"{kinds[joint]} {kind}"]
            if quantity.column in contents.units:
                choices = {"": factor(contents, quantity, kinds)}
            stated = unit_of(f"{kinds[joint]} {kind}", words(quantity.column).unit)
            ratio = rate_factor(contents.time, x, dx)
            fits = {unit: ratio * c for unit, c in choices.items() if 1 / EXACT < abs(ratio * c) < EXACT}
            if not fits:
                quantity.why = [f"it is {ratio:.3g} times the derivative" if ratio else "it is not the derivative"]
                belief.notes.append(
                    f"Column '{quantity.column}' is named like the {kind} of '{joint}', but {quantity.why[0]} of what "
                    f"is taken for its {of}; it is left out."
                )
                quantity.column, quantity.sure = "", SURE
                continue
            quantity.unit = stated if stated in fits else next(iter(fits))
            ratio = fits[quantity.unit]
            quantity.gain, quantity.sure = (-1.0 if ratio < 0 else 1.0), SURE
            quantity.why.append(
                f"{ratio:.2f} times the derivative of the {of}" + (f" in {quantity.unit}" * bool(quantity.unit))
            )


def _values(
    belief: Belief, contents: LogContents, kinds: Mapping[str, str], joint: str, kind: str
) -> np.ndarray | None:
    """A joint's position or velocity in SI units; the velocity by differentiation if it has no column (N,)."""
    quantity = belief.of(kind).get(joint)
    if quantity and quantity.column in contents.columns:
        return contents.columns[quantity.column] * quantity.gain * factor(contents, quantity, kinds)
    if kind == "velocity" and (x := _values(belief, contents, kinds, joint, "position")) is not None:
        return np.gradient(x, contents.time)
    return None


def factor(contents: LogContents, x: Quantity, kinds: Mapping[str, str]) -> float:
    """Factor from the unit of a joint's quantity, its own or the file's, to the SI unit."""
    units = UNITS[f"{kinds[x.joint]} {x.kind}"]
    in_degrees = not x.unit and contents.units.get(x.column) == "deg"
    return units[next((u for u in units if in_degrees and u.startswith("deg")), x.unit or next(iter(units)))]


def is_rate(contents: LogContents, position: str, rate: str) -> bool:
    """True where a column may be the derivative of another, in any unit and of either sign."""
    size = abs(rate_factor(contents.time, contents.columns[position], contents.columns[rate]))
    return any(1 / EXACT < size / unit < EXACT for unit in (1.0, 180 / np.pi, np.pi / 180))


def is_current(quantity: Quantity) -> bool:
    """True where the name of a torque column says that it is a motor current."""
    about = words(quantity.column)
    return about.kind == "current" or about.unit in CURRENT


def doubt_units(belief: Belief, contents: LogContents, joints: list[str]) -> None:
    """Makes positions likely whose unit their size alone suggests, and remarks of those that may be percentages."""
    percentages = list[str]()
    for joint, x in belief.of("position").items():
        if joint in joints and x.sure == SURE:
            x.sure = LIKELY
            x.why.append("which nothing else shows")
        is_open = x.column.endswith(NORMALIZED) and x.unit in ("deg", "mm") and x.sure != SURE
        if words(x.column).unit == "%" or (is_open and np.abs(contents.columns[x.column]).max() <= PERCENT):
            percentages.append(joint)
            x.sure = DOUBTFUL
    if percentages:
        belief.undecided |= set(percentages)
        belief.open.append(
            f"The positions of {', '.join(percentages)} may be percentages of calibrated ranges. Map degrees by "
            'unit = "deg", percentages by unit, gain and constant, so that gain * column + constant is the position.'
        )
