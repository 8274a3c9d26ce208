"""Candidate alignments of numbered columns with joints, and the share of wrenches and torques that each explains."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from experiments.guesses.belief import Belief
from experiments.guesses.families import Family, families
from experiments.guesses.joints import ROUND
from experiments.guesses.log_contents import LogContents
from experiments.guesses.predicted import Curves, beside_friction, prediction, shares_of_torques, unexplained
from experiments.guesses.words import unit_of, words
from ident.estimation.equations import COMPONENTS
from ident.files.column import UNITS
from ident.mechanism.mechanism import Mechanism

STILL = 1e-6
"""Range of a wrench component, N or N m, up to which it does not depend on the motion."""

MODEL, ALPHABET, LABELS = "in the model's order", "in the order of the alphabet", "in the order that the log states"


@dataclass(frozen=True)
class Alignment:
    """Columns of joints, one for each joint.

    Attributes:
        family: Family of the positions.
        order: Order of the joints.
        positions: Column of the position of each joint.
        torques: Column of the torque of each joint; empty if torques are known or absent.
        wrench: Columns of the ground's wrench if no names state it, force first.
        left: Share of the measurements that the model leaves unexplained; None without measurements.
    """

    family: Family
    order: str
    positions: Mapping[str, str]
    torques: Mapping[str, str] = field(default_factory=dict)
    wrench: tuple[str, ...] = ()
    left: float | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """Inputs of the search for alignments.

    Attributes:
        belief: The belief so far.
        contents: The log.
        mechanism: The mechanism.
        joints: Joints without positions, in the model's order.
        curves: Columns low-passed by one filter.
        families: Families of columns that are not assigned yet.
        held: True if something holds the base.
    """

    belief: Belief
    contents: LogContents
    mechanism: Mechanism
    joints: tuple[str, ...]
    curves: Curves
    families: tuple[Family, ...]
    held: bool


def position_families(there: Sequence[Family]) -> list[Family]:
    """Families that may be positions: those named so, or else those whose names state no quantity."""
    own = [each for each in there if each.is_of_joints]
    return [each for each in own if each.kind == "position"] or [each for each in own if each.kind == ""]


def alignments(problem: Problem, family: Family) -> Iterator[Alignment]:
    """Alignments of a family as positions, with possible torques, each with its unexplained share."""
    for order, targets, columns in ways(problem, family):
        positions = dict(zip(targets, columns, strict=True))
        yield from _measured(problem, Alignment(family, order, positions))


def ways(problem: Problem, family: Family) -> Iterator[tuple[str, Sequence[str], Sequence[str]]]:
    """Possible alignments: name of the order, joints in this order, and as many consecutive columns of a family."""
    names, joints = family.names, problem.joints
    if labelled := _labelled(problem, family):
        yield LABELS, list(labelled), list(labelled.values())
        return
    for targets in _targets(joints, len(names)):
        for order, listed in ((MODEL, targets), (ALPHABET, tuple(sorted(targets)))):
            if order == ALPHABET and listed == targets:
                continue
            for first in range(len(names) - len(listed) + 1):
                columns = names[first : first + len(listed)]
                if all(name in problem.contents.columns for name in columns):
                    yield order, listed, columns


def _labelled(problem: Problem, family: Family) -> dict[str, str]:
    """Columns by joint, if words in the log name all the joints in question by the same numbers."""
    for each in families(problem.contents.labels):
        labels = {number: problem.contents.labels[name] for number, name in each.members}
        columns = {labels[number]: name for number, name in family.members if number in labels}
        if set(problem.joints) <= set(columns):
            return {joint: columns[joint] for joint in problem.joints}
    return {}


def _targets(joints: Sequence[str], size: int) -> list[tuple[str, ...]]:
    """Joints that a family of some size may be of: all, those of a family of that size, or consecutive ones."""
    if size >= len(joints):
        return [tuple(joints)]
    own = [each.names for each in families(joints) if len(each.names) == size]
    return own or [tuple(joints[k : k + size]) for k in range(len(joints) - size + 1)]


def states_of(problem: Problem, positions: Mapping[str, str], factor: float) -> dict[str, np.ndarray]:
    """Positions and both derivatives of all joints (3, M); joints without columns are at rest."""
    known = problem.belief.of("position")
    hinges = {body.joint for body in problem.mechanism.tree.bodies if body.moves and body.turns}
    out = {}
    for joint in problem.mechanism.joints:
        if joint in positions:
            out[joint] = problem.curves.states[positions[joint]] * (factor if joint in hinges else 1.0)
        elif joint in known and known[joint].column in problem.curves.states:
            # A program has one unit for all angles.
            out[joint] = problem.curves.states[known[joint].column] * (factor if joint in hinges else 1.0)
        else:
            out[joint] = np.zeros((3, problem.curves.size))
    return out


def factors(problem: Problem, columns: Sequence[str]) -> list[float]:
    """Candidate factors from positions to radians, by the unit that the file or names state, or else by their size."""
    units = {
        unit_of("hinge position", words(name).unit) or problem.contents.units.get(name, "") for name in columns
    } - {""}
    if units:
        return [UNITS["hinge position"].get(units.pop(), 1.0)]
    largest = max(float(np.abs(problem.contents.columns[name]).max()) for name in columns)
    return [1.0] if largest < 0.05 else [np.pi / 180] if largest > 10 * ROUND else [1.0, np.pi / 180]


def _measured(problem: Problem, way: Alignment) -> Iterator[Alignment]:
    """The same alignment with each candidate family of torques or wrench, and with its unexplained share."""
    columns = list(way.positions.values())
    options = _torques(problem, way)
    for factor in factors(problem, columns):
        states = states_of(problem, way.positions, factor)
        predicted = prediction(problem.mechanism, list(states.values()))
        given = _given(problem, states, predicted)
        free = [name for name in problem.curves.levels if name not in (*columns, *problem.belief.columns)]
        shares = shares_of_torques(states, predicted, {name: problem.curves.levels[name] for name in free})
        place = {name: k for k, name in enumerate(free)}
        measured = []
        for torques in options:
            left = given + [float(shares[joint][place[name]]) for joint, name in torques.items()]
            measured.append(replace(way, torques=torques, left=sum(left) / len(left) if left else None))
        # Among columns without names, the best-fitting ones are the torques.
        yield from measured if way.family.kind else [min(measured, key=lambda each: each.left or 0.0)]
        if rows := _wrenches(problem, way, given):
            there = [k for k, c in enumerate(COMPONENTS) if np.ptp(predicted[c]) > STILL]
            both = [predicted[COMPONENTS[k]] for k in there] + [problem.curves.levels[name] for name in free]
            alone = 1 - np.corrcoef(both)[: len(there), len(there) :] ** 2
            lefts = [float(np.mean([alone[i, place[row[k]]] for i, k in enumerate(there)])) for row in rows]
            yield replace(way, wrench=rows[int(np.argmin(lefts))], left=min(lefts))


def _torques(problem: Problem, way: Alignment) -> list[dict[str, str]]:
    """Torque columns that may go with positions: same places in families of torques; empty if torques are known."""
    if problem.belief.of("torque"):
        return [{}]
    places = [way.family.names.index(name) for name in way.positions.values()]
    out = []
    for kind in ("torque", "current"):
        for each in problem.families:
            if each.kind == kind and each.is_of_joints and len(each.names) == len(way.family.names):
                own = [each.names[place] for place in places]
                if all(name in problem.contents.columns for name in own):
                    out.append(dict(zip(way.positions, own, strict=True)))
        if out:
            return out
    if problem.belief.groups or way.family.kind == "position":
        return [{}]
    # A single family of all columns: torques are other columns of it, in the same order.
    n, names, first, last = len(places), way.family.names, min(places), max(places)
    starts = [k for k in range(len(names) - n + 1) if k > last or k + n <= first] if last - first + 1 == n else []
    shifted = [[names[place - first + k] for place in places] for k in starts]
    moving = [own for own in shifted if set(own) <= set(problem.contents.columns)]
    return [dict(zip(way.positions, own, strict=True)) for own in moving] or [{}]


def _wrenches(problem: Problem, way: Alignment, given: Sequence[float]) -> list[tuple[str, ...]]:
    """Runs of six columns of a family without a name that may be the ground's wrench."""
    if not problem.held or given or way.family.kind or problem.belief.groups:
        return []
    names = way.family.names
    rows = [names[k : k + 6] for k in range(len(names) - 5)]
    return [
        row for row in rows if not set(row) & set(way.positions.values()) and set(row) <= set(problem.contents.columns)
    ]


def _given(problem: Problem, states: Mapping[str, np.ndarray], predicted: Mapping[str, np.ndarray]) -> list[float]:
    """Unexplained shares of the wrenches and torques that are known by name."""
    levels, out = problem.curves.levels, []
    wrench = [predicted[c] for c in COMPONENTS]
    for key, basis in (("force", wrench[:3]), ("torque", wrench)):
        listed = [group.entries[key].value for group in problem.belief.groups.values() if key in group.entries]
        total = sum(np.stack([levels.get(name, 0 * wrench[0]) for name in names], axis=1) for names in listed)
        if isinstance(total, np.ndarray) and np.ptp(total, axis=0).any():
            out.append(unexplained(total, basis))
    for joint, quantity in problem.belief.of("torque").items():
        if quantity.column in levels:
            out.append(beside_friction(states[joint], predicted[joint], levels[quantity.column]))
    return out
