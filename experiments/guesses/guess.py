"""Guess of a mapping of columns from a log and a model."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from experiments.guesses.belief import BASE, Belief, ColumnGroup, TableEntry
from experiments.guesses.checks import check_positions, check_wrenches_and_torques, set_orientation
from experiments.guesses.log_contents import check_same_columns, log_contents
from experiments.guesses.model import ComparedModel
from experiments.guesses.names import add_commands, add_named, add_orientations
from experiments.guesses.places import ask_place, place_wrenches
from experiments.guesses.series import add_any, add_measured, add_series
from experiments.guesses.units import doubt_units, set_rates, set_units
from experiments.guesses.wrenches import add_wrenches
from ident.errors import InputError
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
    add_orientations(belief, base)
    add_wrenches(belief)
    add_named(belief)
    add_series(belief)
    add_named(belief, numbered=True)
    add_any(belief)
    by_size = set_units(belief)
    add_measured(belief)
    axes = not belief.can_predict or _check(belief, by_size, limit)
    doubt_units(belief, by_size)
    set_rates(belief)
    if belief.flies and any(not group.is_inner for group in belief.groups.values()) and GROUND not in belief.groups:
        of_base = belief.poses.setdefault(BASE, ColumnGroup(BASE, {}))
        of_base.entries["held"] = TableEntry(False, "the model's joints move it freely in a plane")
    _complete(belief)
    if belief.complete and mechanism.prior is not None:
        check_wrenches_and_torques(belief, limit, axes=axes and belief.can_predict)
    add_commands(belief)
    asked = belief.undecided or belief.torques_undecided or log.markers
    if not (asked or belief.groups or belief.of("torque") or belief.of("command")):
        belief.notes.append("The log has no wrench, torque or commanded position, of which `identify` needs one.")
    belief.unused = belief.free
    check_same_columns(log, logs[1:], {*belief.columns, *log.times} - {""}, limit, rate)
    return belief


def _check(belief: Belief, by_size: list[str], limit: int) -> bool:
    """Checks positions and wrenches by the model, and returns True if no sign of a joint is open."""
    moving = any(x.column in belief.log.columns for x in belief.of("position").values())
    if belief.undecided or not moving:
        return True
    set_orientation(belief, limit)
    try:
        model = ComparedModel.of(belief)
    except InputError as error:
        belief.notes.append(f"Orders and signs could not be checked against the model: {error}")
        for group in [group for group in belief.groups.values() if group.is_open]:
            ask_place(belief, group, "Its name does not say so.")
        return True
    if no_sign_is_open := check_positions(model, by_size):
        place_wrenches(model)
    return no_sign_is_open


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
