"""Alignment of numbered columns with joints: the one with which the model explains clearly more than with others."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import perm

import numpy as np

from experiments.guesses.alignments import (
    ALPHABET,
    LABELS,
    MODEL,
    Alignment,
    Problem,
    alignments,
    position_families,
)
from experiments.guesses.belief import LIKELY, Belief, Entry, Group, Quantity
from experiments.guesses.families import Family, families
from experiments.guesses.log_contents import LogContents
from experiments.guesses.predicted import curves, explained, is_rate
from experiments.guesses.signs import ENOUGH, LITTLE
from experiments.guesses.unnamed import CLEAR, MOST
from ident.mechanism.mechanism import Mechanism
from ident.recordings.wrench import GROUND

ENOUGH_OF_WRENCHES = 0.95
"""Share of wrenches that the model has to explain with one alignment among several, whatever the wrenches' axes: with
that much freedom, a wrong alignment explains up to nine tenths."""

SAME = 0.999
"""Correlation of columns above which they may be two readings of one joint."""


def add_aligned(belief: Belief, contents: LogContents, mechanism: Mechanism, joints: Sequence[str], held: bool) -> None:
    """Adds positions, velocities and torques of joints without columns from families of numbered columns.

    Args:
        belief: The belief to extend.
        contents: The log.
        mechanism: The mechanism.
        joints: Its joints with one axis.
        held: True if something holds the base.
    """
    lacking = tuple(j for j in joints if j not in belief.of("position") and j not in belief.undecided)
    named = {name for name in contents.names if name not in belief.columns}
    there = tuple(each for each in families(contents.names) if set(each.names) <= named)
    fitting = [
        each for each in position_families(there) if lacking and len(each.names) > 1 and not _is_small(each, lacking)
    ]
    if not fitting or mechanism.prior is None:
        return
    known = [quantity.column for quantity in belief.of("position").values() if quantity.column in contents.columns]
    moving = [name for each in fitting for name in each.names if name in contents.columns]
    low = curves(contents, dict.fromkeys([*known, *moving]))
    problem = Problem(belief, contents, mechanism, lacking, low, there, held)
    every = [way for each in fitting for way in alignments(problem, each)]
    measured = [way for way in every if way.left is not None]
    if measured:
        _add_best(problem, measured)
    elif every:
        _add_unmeasured(problem, every)


def _is_small(family: Family, joints: Sequence[str]) -> bool:
    """True where columns without names are few enough to try all assignments, not only consecutive ones."""
    return family.template == "#" and perm(len(family.names), len(joints)) <= MOST


def _add_best(problem: Problem, every: Sequence[Alignment]) -> None:
    """Adds the alignment that leaves least unexplained; none if it is not clearly the best, or explains little."""
    every = sorted(every, key=lambda way: way.left or 0.0)
    twins = [way for way in every if _is_twin(problem, every[0], way)]
    # Of equally good families, those of the joint precede those of the motor or before calibration.
    best = min(twins, key=lambda way: way.family.is_second)
    others = [way for way in every if way not in twins]
    second = min((way.left or 0.0 for way in others), default=1.0)
    left = best.left or 0.0
    enough = ENOUGH if best.torques or problem.belief.of("torque") else ENOUGH_OF_WRENCHES
    alone = not others or best.order == LABELS
    if (alone and 1 - left >= LITTLE) or (1 - left >= enough and left <= CLEAR * second):
        if best.family.kind == "" and any(way.positions != best.positions for way in twins):
            _ask_which(problem, twins)
            return
        best = _with_one_family_of_torques(problem, best, twins)
        why = f"{best.order}: with it the model explains {explained(left)} of what is measured"
        _add(problem, best, why + ("" if not others else f", otherwise at most {explained(second)}"))
        return
    rival = f", with another one {explained(second)}" if others else ""
    _ask(
        problem,
        f"which columns of {_listed(best.family.names)} are the positions of {_listed(problem.joints)}: "
        f"{best.order}, from {next(iter(best.positions.values()))} on, the model explains {explained(left)} of what is "
        f"measured{rival}",
    )


def _with_one_family_of_torques(problem: Problem, best: Alignment, twins: Sequence[Alignment]) -> Alignment:
    """The best alignment, without its torques if another family's torques are explained as well."""
    rivals = [way for way in twins if way.torques and dict(way.torques) != dict(best.torques)]
    rivals = [
        way for way in rivals if 1 - (way.left or 0.0) >= ENOUGH and CLEAR * (way.left or 0.0) <= (best.left or 0.0)
    ]
    if not rivals or not best.torques or best.family.kind == "":
        return best
    ways = dict.fromkeys(_listed(tuple(way.torques.values())) for way in (best, *rivals))
    problem.belief.open.append(f"The torques may be those of {' or of '.join(ways)}, which the model explains alike.")
    problem.belief.torques_undecided = True
    return replace(best, torques={})


def _add_unmeasured(problem: Problem, every: Sequence[Alignment]) -> None:
    """Adds the only alignment if nothing is measured to check it; none of several."""
    different = {tuple(way.positions.items()): way for way in every}
    if len(different) == 1 and every[0].family.kind == "position":
        _add(problem, every[0], f"{every[0].order}, which nothing in the log can confirm")
        return
    _ask(
        problem,
        f"which columns of {_listed(every[0].family.names)} are the positions of {_listed(problem.joints)}: the "
        f"log has no wrench and no torque that would distinguish {MODEL} from {ALPHABET} or another place",
    )


def _ask(problem: Problem, what: str) -> None:
    problem.belief.open.append(f"It is open {what}.")
    problem.belief.undecided |= set(problem.joints)


def _ask_which(problem: Problem, twins: Sequence[Alignment]) -> None:
    places = dict.fromkeys(_listed(tuple(way.positions.values())) for way in twins)
    _ask(
        problem, f"which of {' or of '.join(places)}, that are nearly the same, were measured and which were commanded"
    )


def _is_twin(problem: Problem, one: Alignment, other: Alignment) -> bool:
    """True where two alignments are equal, or differ only in columns with nearly the same values."""
    if one.positions.keys() != other.positions.keys():
        return False
    x, y = ([problem.contents.columns[way.positions[joint]] for joint in one.positions] for way in (one, other))
    return all(a is b or np.corrcoef(a, b)[0, 1] > SAME for a, b in zip(x, y, strict=True))


def _add(problem: Problem, way: Alignment, why: str) -> None:
    """Adds the quantities of an alignment to the belief."""
    belief = problem.belief
    if way.order != LABELS and not _has_numbers_of_joints(way):
        belief.by_place |= set(way.positions)
    for kind, columns in (("position", way.positions), ("torque", way.torques), ("velocity", _rates(problem, way))):
        for joint, column in columns.items():
            reason = why if kind == "position" else "in the place of the position"
            quantity = Quantity(joint, kind, column, LIKELY, [reason])
            belief.quantities.setdefault(quantity.key, quantity)
    if way.wrench:
        share = f"agrees with the model's prediction ({explained(way.left or 0.0)} of the variance)"
        parts = (("force", way.wrench[:3]), ("torque", way.wrench[3:]))
        belief.groups[GROUND] = Group(GROUND, {key: Entry(list(names), share) for key, names in parts})


def _has_numbers_of_joints(way: Alignment) -> bool:
    """True where the columns have the joints' own numbers."""
    own = {
        joint: member.number for each in families(way.positions) for member in each.members for joint in [member.name]
    }
    there = {member.name: member.number for member in way.family.members}
    return all(own.get(joint) == there[column] for joint, column in way.positions.items())


def _rates(problem: Problem, way: Alignment) -> dict[str, str]:
    """Columns that are derivatives of the positions, all of one family, in the same order."""
    places = [way.family.names.index(name) for name in way.positions.values()]
    taken = {*way.positions.values(), *way.torques.values(), *way.wrench, *problem.belief.columns}
    for each in problem.families:
        same = each is way.family
        if not (same or (each.kind == "velocity" and each.is_of_joints and len(each.names) == len(way.family.names))):
            continue
        for first in range(-min(places), len(each.names) - max(places)) if same else (0,):
            names = [each.names[place + first] for place in places]
            if not set(names) & taken and _are_rates(problem.contents, way.positions.values(), names):
                return dict(zip(way.positions, names, strict=True))
    return {}


def _are_rates(contents: LogContents, positions: Collection[str], rates: Collection[str]) -> bool:
    """True where columns may be derivatives of others, in any unit and of either sign."""
    change = all(name in contents.columns for name in (*positions, *rates))
    return change and all(is_rate(contents, x, dx) for x, dx in zip(positions, rates, strict=True))


def _listed(names: Sequence[str]) -> str:
    """Names of a family or of several joints, abbreviated."""
    return ", ".join(names) if len(names) < 3 else f"{names[0]} to {names[-1]}"
