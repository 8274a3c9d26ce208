"""Guess of a mapping of columns from a log and a model."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from experiments.guesses.belief import Belief, Entry, Group
from experiments.guesses.checked import check_wrenches_and_torques, mounted
from experiments.guesses.chosen import add_any, add_series
from experiments.guesses.explained import Model
from experiments.guesses.log_contents import LogContents, check_same_columns, log_contents
from experiments.guesses.markers import without_markers
from experiments.guesses.measured import add_measured
from experiments.guesses.names import add_commands, add_named, add_only, is_named_after
from experiments.guesses.orientations import BASE, add_orientations
from experiments.guesses.sensors import ask_place, place_wrenches
from experiments.guesses.signs import check_positions
from experiments.guesses.units import doubt_units, set_rates, set_units
from experiments.guesses.wrenches import add_wrenches
from experiments.guesses.written import toml_text
from ident.errors import InputError
from ident.files.atomic import replacing
from ident.files.column import KINDS
from ident.files.limits import LIMIT
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.plane import plane_normal
from ident.recordings.columns.mapping import joint_kinds
from ident.recordings.wrench import GROUND
from ident.recordings.wrench_names import wrench_groups


def believed(
    mechanism: Mechanism, logs: Sequence[Path], *, base: str | None = None, limit: int = LIMIT, rate: float = 0.0
) -> tuple[LogContents, Belief]:
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
    kinds, held = joint_kinds(mechanism.tree), not mechanism.tree.floats
    flies = held and plane_normal(mechanism) is not None
    log, belief = without_markers(log_contents(logs[0], limit, rate), mechanism.sites), Belief()
    balls, axes = ([joint for joint in kinds if (kinds[joint] == "ball") is ball] for ball in (True, False))
    add_orientations(belief, log, balls, base if held else None)
    usual = {pattern.format(joint) for joint in kinds for patterns in KINDS.values() for pattern in patterns}
    others = [name for name in log.names if name not in usual]
    components = [c for group in wrench_groups(others).values() if len(group) > 2 for c in group.values()]
    components = [name for name in components if not is_named_after(name, {joint: kinds[joint] for joint in axes})]
    add_named(belief, log, axes, components)
    add_wrenches(belief, log, mechanism, held, flies)
    # The model's predictions are used only if angles alone determine them.
    signs = not balls and not belief.poses
    compared = mechanism if signs else replace(mechanism, prior=None)
    add_series(belief, log, compared, axes, held)
    add_named(belief, log, axes, components, numbered=True)
    if len(kinds) == len(axes) == 1:
        add_only(belief, log, axes[0], components)
    add_any(belief, log, compared, mechanism.joints, held)
    by_size = set_units(belief, log, kinds)
    add_measured(belief, log, compared, held)
    moving = any(x.column in log.columns for x in belief.of("position").values())
    if moving and compared.prior is not None and not belief.undecided:
        mechanism = mounted(belief, log, mechanism, limit)
        try:
            model = Model.of(belief, log, mechanism, [])
        except InputError as error:
            belief.notes.append(f"Orders and signs could not be checked against the model: {error}")
            for group in [group for group in belief.groups.values() if group.is_open]:
                ask_place(belief, group, "Its name does not say so.")
        else:
            signs = check_positions(model, by_size)
            if signs:
                place_wrenches(model)
    doubt_units(belief, log, by_size)
    set_rates(belief, log, kinds)
    if flies and any(not group.is_inner for group in belief.groups.values()) and GROUND not in belief.groups:
        of_base = belief.poses.setdefault(BASE, Group(BASE, {}))
        of_base.entries["held"] = Entry(False, "the model's joints move it freely in a plane")
    placed = {*belief.of("position"), *(key.removeprefix("joints.") for key in belief.poses)}
    following = mechanism.determined(placed)
    belief.notes += [f"'{joint}' follows '{lead}', as the model couples them." for joint, lead in following.items()]
    lacking = [joint for joint in mechanism.joints if joint not in placed and joint not in following]
    belief.complete = not lacking
    if (absent := [joint for joint in lacking if joint not in belief.undecided]) and not log.markers:
        listed, fixed = ", ".join(map(repr, absent)), " ".join(f"--fix {shlex.quote(joint)}" for joint in absent)
        belief.open.append(f"No column looks like the position of {listed}; {fixed} leaves out what rests.")
    if not lacking and mechanism.prior is not None:
        check_wrenches_and_torques(belief, log, mechanism, limit, axes=signs)
    add_commands(belief, log, axes)
    asked = belief.undecided or belief.torques_undecided or log.markers
    if not (asked or belief.groups or belief.of("torque") or belief.of("command")):
        belief.notes.append("The log has no wrench, torque or commanded position, of which `identify` needs one.")
    clock = {clock.column for clock in log.clocks}
    belief.unused = [name for name in log.names if name not in belief.columns]
    check_same_columns(log, logs[1:], {*belief.columns, *clock} - {""}, limit, rate)
    return log, belief


def write_mapping(path: Path, log: LogContents, belief: Belief, joints: Sequence[str], *, force: bool = False) -> None:
    """Writes the mapping.

    Raises:
        InputError: The file exists, and `force` is false.
    """
    if path.exists() and not force:
        raise InputError(f"'{path}' is there already; --force replaces it, --out NAME writes another.")
    with replacing(path) as temporary:
        temporary.write_text(toml_text(log, belief, joints), encoding="utf-8")
