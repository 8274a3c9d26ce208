"""Guess of a mapping of columns from a log and a model: all evidence in its order, and units of joints' columns."""

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from experiments.guesses.belief import BASE, DOUBTFUL, LIKELY, SURE, Belief, ColumnGroup, Quantity, TableEntry
from experiments.guesses.checks import check_positions, check_wrenches_and_torques, set_orientation
from experiments.guesses.groups import add_poses, add_wrenches
from experiments.guesses.log_contents import LONG, ROUND, check_same_columns, is_one, log_contents
from experiments.guesses.model import ComparedModel
from experiments.guesses.orders import add_any, add_series
from experiments.guesses.scores import add_assigned, add_commands, add_predicted, by_name, by_number
from experiments.guesses.wrench_checks import ask_place, place_wrenches
from ident.errors import InputError
from ident.files.column import UNITS
from ident.files.limits import LIMIT
from ident.mechanism.mechanism import Mechanism
from ident.recordings.wrench import GROUND


def believed(
    mechanism: Mechanism, logs: Sequence[Path], *, base: str | None = None, limit: int = LIMIT, rate: float = 0.0
) -> Belief:
    """Beliefs about the columns of some logs, from the first of them.

    Args:
        mechanism: The mechanism, with the joints and bodies to find.
        logs: Files that `read_log` reads.
        base: Body whose frame is {0}, by default the world.
        limit: Bytes that an archive may take in memory.
        rate: Samples per second of logs without times, Hz.

    Raises:
        LogError: A log is missing, damaged or without times, or lacks an assigned column of the first.
        InputError: The library that reads such files is not installed.
    """
    log = log_contents(logs[0], limit, rate).without_markers(mechanism.sites)
    belief = Belief(log, mechanism)
    add_poses(belief, base)
    add_wrenches(belief)
    add_assigned(belief, by_name)
    add_series(belief)
    add_assigned(belief, by_number)
    add_any(belief)
    set_units(belief)
    add_predicted(belief)
    if belief.can_predict and not belief.undecided:
        _check(belief, limit)
    doubt_units(belief)
    set_rates(belief)
    if belief.flies and any(not group.is_inner for group in belief.groups.values()) and GROUND not in belief.groups:
        of_base = belief.poses.setdefault(BASE, ColumnGroup(BASE, {}))
        of_base.entries["held"] = TableEntry(False, "the model's joints move it freely in a plane")
    _complete(belief)
    if belief.complete and mechanism.prior is not None:
        check_wrenches_and_torques(belief, limit)
    add_commands(belief)
    asked = belief.undecided or belief.torques_undecided or log.markers
    if not (asked or belief.groups or belief.of("torque") or belief.of("command")):
        belief.notes.append("The log has no wrench, torque or commanded position, of which `identify` needs one.")
    belief.unused = belief.free
    check_same_columns(log, logs[1:], {*belief.columns, *log.times} - {""}, limit, rate)
    return belief


def _check(belief: Belief, limit: int) -> None:
    """Checks positions and wrenches by the model."""
    if all(belief.values(joint, "position") is None for joint in belief.axes):
        return
    set_orientation(belief, limit)
    try:
        model = ComparedModel.of(belief)
    except InputError as error:
        belief.notes.append(f"Orders and signs could not be checked against the model: {error}")
        for group in [group for group in belief.groups.values() if group.is_open]:
            ask_place(belief, group, "Its name does not say so.")
        return
    check_positions(model)
    if not belief.sign_undecided:
        place_wrenches(model)


def _complete(belief: Belief) -> None:
    """Asks for joints without positions, unless they follow others."""
    placed = {*belief.of("position"), *(key.removeprefix("joints.") for key in belief.poses)}
    following = belief.mechanism.determined(placed)
    belief.notes += [f"'{joint}' follows '{lead}', as the model couples them." for joint, lead in following.items()]
    lacking = [joint for joint in belief.mechanism.joints if joint not in placed and joint not in following]
    belief.complete = not lacking
    if (absent := [joint for joint in lacking if joint not in belief.undecided]) and not belief.log.markers:
        listed, fixed = ", ".join(map(repr, absent)), " ".join(f"--fix {shlex.quote(joint)}" for joint in absent)
        belief.ask(f"No column looks like the position of {listed}; {fixed} leaves out what rests.")


def set_units(belief: Belief) -> None:
    """Sets units of positions by the file, their names, their velocities' units, and their size."""
    log, kinds, open_ones = belief.log, belief.kinds, list[Quantity]()
    for x in belief.of("position").values():
        if x.column in log.units:
            x.why.append("the file knows its unit")
        elif stated := belief.stated(x):
            x.unit = stated
            x.why.append(f"{x.unit} by its name")
        elif by_rate := _unit_by_rate(belief, x):
            x.unit = by_rate
            x.why.append(f"{x.unit} by its velocity, whose name has a unit")
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
            x.why.append(f"{unit} since it goes to {sizes[x.joint]:.3g}" + f", and others are in {unit}" * (not alike))
    belief.by_size = {x.joint for x in open_ones if kinds[x.joint] == "hinge"}


def _unit_by_rate(belief: Belief, position: Quantity) -> str:
    """Unit of a position in which the derivative is the velocity in the unit that its name states; "" if unknown."""
    rate, log = belief.of("velocity").get(position.joint), belief.log
    if not rate or not belief.stated(rate) or not {rate.column, position.column} <= log.columns.keys():
        return ""
    kind = belief.kinds[position.joint]
    ratio = log.rate_factor(log.columns[position.column], rate.column)
    ratio *= UNITS[f"{kind} velocity"][belief.stated(rate)]
    return next((own for own, scale in UNITS[f"{kind} position"].items() if is_one(ratio / scale)), "")


def doubt_units(belief: Belief) -> None:
    """Makes positions likely whose unit their size alone suggests, and remarks of those that may be percentages."""
    percentages = list[str]()
    for joint, x in belief.of("position").items():
        if joint in belief.by_size and x.sure == SURE:
            x.sure = LIKELY
            x.why.append("which nothing else shows")
        # LeRobot writes percentages of calibrated ranges, or degrees, under the same names.
        is_open = x.column.endswith(".pos") and x.unit in ("deg", "mm") and x.sure != SURE
        if x.about.unit == "%" or (is_open and belief.log.largest(x.column) <= 100):
            percentages.append(joint)
            x.sure = DOUBTFUL
    if percentages:
        belief.ask(
            f"The positions of {', '.join(percentages)} may be percentages of calibrated ranges. Map degrees by "
            'unit = "deg", percentages by unit, gain and constant, so that gain * column + constant is the position.',
            percentages,
        )


def set_rates(belief: Belief) -> None:
    """Sets units and signs of velocities and accelerations as derivatives; drops columns that are no derivatives."""
    log, rates = belief.log, (("velocity", "position"), ("acceleration", "velocity"))
    for x, of in ((x, of) for kind, of in rates for x in belief.of(kind).values()):
        state, stated = belief.values(x.joint, of), belief.stated(x)
        if state is None or x.column not in log.columns:
            continue
        choices = {"": belief.factor(x)} if x.column in log.units else UNITS[f"{belief.kinds[x.joint]} {x.kind}"]
        ratio = log.rate_factor(state, x.column)
        fits = {unit: ratio * choice for unit, choice in choices.items() if is_one(ratio * choice)}
        x.sure = SURE
        if not fits:
            x.why = [f"it is {ratio:.3g} times the derivative" if ratio else "it is not the derivative"]
            belief.notes.append(
                f"Column '{x.column}' is named like the {x.kind} of '{x.joint}', but {x.why[0]} of what is taken for "
                f"its {of}; it is left out."
            )
            x.column = ""
            continue
        x.unit, x.gain = stated if stated in fits else next(iter(fits)), float(np.sign(ratio))
        x.why.append(f"{fits[x.unit]:.2f} times the derivative of the {of}" + f" in {x.unit}" * bool(x.unit))
