"""Guess of a mapping of columns from a log and a model, and of where its wrenches are measured."""

import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from experiments.guesses.belief import BASE, DOUBTFUL, LIKELY, Belief, ColumnGroup, TableEntry
from experiments.guesses.beliefs_checked import check_positions, check_wrenches_and_torques, set_orientation
from experiments.guesses.guessed_units import doubt_units, set_rates, set_units
from experiments.guesses.log_contents import check_same_columns, log_contents
from experiments.guesses.matched_names import add_commands, add_named, add_orientations
from experiments.guesses.model import ComparedModel, explained, unexplained
from experiments.guesses.series import AGREES, CLEAR, ENOUGH, ENOUGH_OF_WRENCHES, add_any, add_measured, add_series
from experiments.guesses.words import LIKE, likeness, words
from experiments.guesses.wrenches import add_wrenches, set_turn, set_unit, size_ratio
from ident.errors import ExcitationError, InputError
from ident.estimation.equations import COMPONENTS
from ident.files.limits import LIMIT
from ident.mechanism.mechanism import Mechanism
from ident.payload.beyond_sensor import TURNED, weighed
from ident.recordings.wrench import GROUND

SIZE = 5.0
"""Largest ratio of sizes of the ground's wrench that the model explains in part: masses of models are wrong by less. Of
a payload of a tenth of the weight, in the base's axes, it explains .93."""

TINY = 1e-6
"""Difference of unexplained shares that is rounding, as of bodies that are rigidly connected."""


def place_wrenches(model: ComparedModel) -> None:
    """Decides by the model where a wrench is measured whose name does not say so: at the base, or beyond a joint.

    A sensor beyond a joint reads what it carries, in axes that move with it; other wrenches on bodies are contacts.
    """
    belief = model.belief
    groups = [group for group in belief.groups.values() if group.is_open or "body" in group.entries]
    if not groups:
        return
    states = model.states_of({})
    predicted, inside = model.predicted(states), model.wrenches(states)
    ground = np.stack([predicted[c] for c in COMPONENTS], axis=1)
    for group in groups:
        key, part = ("force", slice(0, 3)) if "force" in group.entries else ("torque", slice(3, 6))
        x = model.level(group.entries[key].value)
        left = {body: unexplained(x, list(there.T[part])) for body, there in inside.items()}
        best, at_base = min(left, key=lambda body: left[body], default=""), unexplained(x, list(ground.T[part]))
        if not group.is_open:
            group.is_inner = 1 - left.get(str(group.entries["body"].value), 1.0) >= AGREES
        elif best and 1 - left[best] >= AGREES and left[best] < CLEAR * at_base:
            sizes = {body: size_ratio(_varying(x), _varying(inside[body][:, part])) for body in left}
            _carry(group, model, left, sizes)
        elif 1 - at_base < (ENOUGH if _is_of_size(size_ratio(x, ground[:, part])) else ENOUGH_OF_WRENCHES):
            shares = f"{explained(at_base)} of it as the ground's, and {explained(left.get(best, 1.0))}"
            ask_place(belief, group, f"The model explains {shares} as that of what '{best}' carries.")
        if group.is_inner:
            body = str(group.entries["body"].value)
            _turn_inner(group, model, inside[body])
            if belief.of("torque") or any(not other.is_inner for other in belief.groups.values()):
                group.entries["body"].sure = DOUBTFUL
                belief.notes.append(
                    f"The wrench '{group.name}' is that of what '{body}' carries. It stays a remark for `payload`, "
                    "since `identify` would take it for a contact."
                )


def ask_place(belief: Belief, group: ColumnGroup, why: str) -> None:
    """Leaves a wrench a remark, with a question on the place where it is measured."""
    group.entries["body"] = TableEntry("?", "the body beyond the sensor", DOUBTFUL)
    belief.ask(f"It is open where the wrench '{group.own_name}' is measured. {why}")
    _rename(belief, group)


def _is_of_size(ratio: float) -> bool:
    """True where columns are about as large as the prediction, in some unit."""
    return any(1 / SIZE < ratio * unit < SIZE for unit in (1e-3, 1.0, 1e3))


def _varying(x: np.ndarray) -> np.ndarray:
    """Columns without their means, which a sensor's offsets are part of."""
    return np.asarray(x - x.mean(axis=0))


def _rename(belief: Belief, group: ColumnGroup) -> None:
    """Gives a wrench that is not the ground's its own name."""
    belief.groups.pop(group.name)
    group.name, group.is_open = group.own_name, False
    belief.groups[group.name] = group


def _carry(group: ColumnGroup, model: ComparedModel, left: Mapping[str, float], sizes: Mapping[str, float]) -> None:
    """Puts a wrench on the body beyond its sensor: named like it, or else of the likeliest weight."""
    best, group.is_inner = min(left, key=lambda body: left[body]), True
    alike = [body for body in left if CLEAR * left[body] <= left[best] + TINY]
    rigid = [body for body in alike if model.mover(body) == model.mover(best)]
    named = [body for body in alike if likeness(words(group.own_name), words(body)) >= LIKE]
    body = named[0] if len(named) == 1 else min(rigid, key=lambda body: abs(np.log(sizes[body])))
    why = f"the model explains {explained(left[body])} of it as the wrench of what '{body}' carries"
    is_one = len(named) == 1 or len(rigid) == len(alike)
    group.entries["body"] = TableEntry(body, why, LIKELY if is_one else DOUBTFUL)
    if not is_one:
        model.belief.ask(f"The wrench '{group.own_name}' may be that of what {' or '.join(alike)} carries.")
    _rename(model.belief, group)


def _turn_inner(group: ColumnGroup, model: ComparedModel, predicted: np.ndarray) -> None:
    """Sets units, sign and axes of a sensor's wrench by the model; its offsets do not matter."""
    for key, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        if key in group.entries:
            measured = _varying(model.level(group.entries[key].value))
            set_unit(model.belief, [group], key, size_ratio(measured, _varying(predicted[:, part])))
    if "force" not in group.entries:
        return
    with suppress(ExcitationError):
        force = model.level(group.entries["force"].value)
        # The direction of gravity decides, whatever the payload weighs.
        fit = weighed(np.hstack([force, 0 * force]), -predicted[:, :3])
        turned = fit.angle > TURNED and "rpy_deg" not in group.entries
        set_turn(group, fit.rotation.T if turned else np.eye(3), "body", "gravity fits", opposite=fit.opposite)


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
