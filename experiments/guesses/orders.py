"""Possible orders of columns: which of them are the positions, and which the torques or the wrench beside them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from math import perm

import numpy as np

from experiments.guesses.belief import Belief
from experiments.guesses.explained import Model
from experiments.guesses.families import Family, families
from experiments.guesses.log_contents import LogContents
from experiments.guesses.units import ROUND, is_rate
from experiments.guesses.words import MEASURED, PARTS, unit_of, words
from ident.estimation.equations import COMPONENTS
from ident.files.column import UNITS

STILL = 1e-6
"""Range of a predicted channel, relative to the largest, up to which it does not depend on the motion."""

MOST = 400
"""Largest number of assignments of columns without names to joints that are tried."""

MODEL, ALPHABET, LABELS, ANY = "the model's", "the alphabetical", "the stated", "the best"
"""Orders of joints."""


@dataclass(frozen=True)
class Order:
    """Columns of joints, one for each joint.

    Attributes:
        names: Columns that may be positions.
        kind: Quantity that the family of the positions states; "" for none.
        order: Order of the joints.
        positions: Column of the position of each joint.
        torques: Column of the torque of each joint; empty if torques are known or absent.
        left: Share of the measurements that the model leaves unexplained; None without measurements.
        is_second: True for positions of motors rather than of joints.
    """

    names: tuple[str, ...]
    kind: str
    order: str
    positions: Mapping[str, str]
    torques: Mapping[str, str] = field(default_factory=dict)
    left: float | None = None
    is_second: bool = False

    @property
    def torques_are_measured(self) -> bool:
        """True if the torques' names say that they were measured."""
        return any(part.lower() in MEASURED for name in self.torques.values() for part in PARTS.findall(name))


@dataclass(frozen=True, eq=False)
class Problem:
    """Inputs of the search for orders.

    Attributes:
        model: The model beside the log.
        joints: Joints without positions, in the model's order.
        families: Families of columns that are not assigned yet.
        held: True if something holds the base.
    """

    model: Model
    joints: tuple[str, ...]
    families: tuple[Family, ...]
    held: bool

    @property
    def changing(self) -> set[str]:
        """Columns that change."""
        return set(self.model.contents.columns)


def position_families(there: Sequence[Family], joints: Sequence[str]) -> list[Family]:
    """Families that may be positions: those named so, or else those whose names state no quantity."""
    own = [each for each in there if each.is_of_joints]
    own = [each for each in own if each.kind == "position"] or [each for each in own if each.kind == ""]
    # Of few columns without names all assignments are tried, not only consecutive ones.
    small = [each for each in own if each.template == "#" and perm(len(each.names), len(joints)) <= MOST]
    return [each for each in own if len(each.names) > 1 and each not in small]


def orders_of(problem: Problem, family: Family, kinds: Sequence[str]) -> Iterator[Order]:
    """Orders of a family's columns as positions, with possible torques of some kinds, and their unexplained shares."""
    for order, joints, columns in _orders(problem, family):
        positions = dict(zip(joints, columns, strict=True))
        own = Order(family.names, family.kind, order, positions, is_second=family.is_second)
        yield from _measured(problem, own, _torques(problem, own, family, kinds))


def _orders(problem: Problem, family: Family) -> Iterator[tuple[str, Sequence[str], Sequence[str]]]:
    """Name of the order, joints in this order, and as many consecutive columns of a family."""
    names, joints, labels = family.names, problem.joints, problem.model.contents.labels
    for each in families(labels):
        named = {number: labels[name] for number, name in each.members}
        own = {named[number]: name for number, name in family.members if number in named}
        if set(joints) <= set(own):
            yield LABELS, joints, [own[joint] for joint in joints]
            return
    for targets in _targets(joints, len(names)):
        alphabetical = tuple(sorted(targets))
        for listed, order in {alphabetical: ALPHABET, targets: MODEL}.items():
            for first in range(len(names) - len(listed) + 1):
                columns = names[first : first + len(listed)]
                if problem.changing.issuperset(columns):
                    yield order, listed, columns


def _targets(joints: Sequence[str], size: int) -> list[tuple[str, ...]]:
    """Joints that a family of some size may be of: all, those of a family of that size, or consecutive ones."""
    if size >= len(joints):
        return [tuple(joints)]
    own = [each.names for each in families(joints) if len(each.names) == size]
    return own or [tuple(joints[k : k + size]) for k in range(len(joints) - size + 1)]


def candidates(belief: Belief, contents: LogContents, number: int) -> tuple[list[str], list[str]]:
    """Columns that may be positions of some number of joints, and all that are no derivatives of others."""
    free = [name for name in contents.columns if name not in belief.columns and words(name).measured]
    rates = {b: a for a in free for b in free if a != b and is_rate(contents, a, b)}
    # A column with a derivative is a position; without any such pair all columns may be.
    roots = [name for name in free if name in rates.values() and name not in rates] or free
    others = [name for name in free if name not in rates]
    return (roots if len(roots) >= number else others), others


def orders_of_any(problem: Problem, names: Sequence[str], others: Sequence[str]) -> Iterator[Order]:
    """All assignments of columns, each with the share of the measurements, or of all others, that it leaves."""
    model = problem.model
    for chosen in permutations(names, len(problem.joints)):
        order = Order(tuple(names), "", ANY, dict(zip(problem.joints, chosen, strict=True)))
        rest = [name for name in others if name not in chosen]
        for scale in scales(problem, chosen):
            states = model.states_of(order.positions, scale)
            predicted = model.predicted(states)
            known = [share.somehow for share in model.shares(states, predicted)]
            if not known and rest:
                known = list(1 - likeness(model, rest, predicted)[0].max(axis=1, initial=0))
            yield replace(order, left=float(np.mean(known or [1.0])))


def likeness(model: Model, names: Sequence[str], predicted: Mapping[str, np.ndarray]) -> tuple[np.ndarray, list[str]]:
    """Squared correlations of columns with the predicted channels that change, and these channels' names."""
    largest = max(float(np.ptp(x)) for x in predicted.values())
    moving = {name: x for name, x in predicted.items() if np.ptp(x) > STILL * largest}
    if not names or not moving:
        return np.zeros((len(names), len(moving))), list(moving)
    both = np.corrcoef(np.array([*(model.levels[n] for n in names), *moving.values()]))
    return np.nan_to_num(both[: len(names), len(names) :]) ** 2, list(moving)


def scales(problem: Problem, columns: Sequence[str]) -> list[float]:
    """Candidate factors from positions to radians, by the unit that the file or names state, or else by their size."""
    contents = problem.model.contents
    units = {unit_of("hinge position", words(name).unit) or contents.units.get(name, "") for name in columns} - {""}
    if units:
        return [UNITS["hinge position"].get(units.pop(), 1.0)]
    largest = max(float(np.abs(contents.columns[name]).max()) for name in columns)
    return [1.0] if largest < 0.05 else [np.pi / 180] if largest > 10 * ROUND else [1.0, np.pi / 180]


def _measured(problem: Problem, order: Order, options: Sequence[dict[str, str]]) -> Iterator[Order]:
    """The same order with each candidate family of torques or wrench, and with its unexplained share."""
    model, columns = problem.model, list(order.positions.values())
    for scale in scales(problem, columns):
        states = model.states_of(order.positions, scale)
        predicted = model.predicted(states)
        known = [share.somehow for share in model.shares(states, predicted)]
        free = [name for name in model.levels if name not in (*columns, *model.belief.columns)]
        shares = model.of_torques(states, predicted, free)
        measured = []
        for torques in options:
            every = known + [float(shares[joint][free.index(name)]) for joint, name in torques.items()]
            measured.append(replace(order, torques=torques, left=sum(every) / len(every) if every else None))
        # Among columns without names, the best-fitting ones are the torques.
        yield from measured if order.kind else [min(measured, key=lambda each: 1.0 if each.left is None else each.left)]
        if problem.held and len(free) >= len(COMPONENTS) and not (known or order.kind or model.belief.groups):
            # Other columns may be the ground's wrench.
            like, channels = likeness(model, free, predicted)
            there = like[:, [k for k, channel in enumerate(channels) if channel in COMPONENTS]]
            yield replace(order, left=1 - float(there.max(axis=0, initial=0).mean()) if there.size else 1.0)


def _torques(problem: Problem, order: Order, family: Family, kinds: Sequence[str]) -> list[dict[str, str]]:
    """Torque columns that may go with positions: same places in families of these kinds; empty if torques are known."""
    if problem.model.belief.of("torque"):
        return [{}]
    joints, places = list(order.positions), [order.names.index(name) for name in order.positions.values()]
    same = [each for each in problem.families if each.is_of_joints and len(each.names) == len(order.names)]
    for kind in kinds:
        every = [[each.names[k] for k in places] for each in same if each.kind == kind and each is not family]
        if own := [names for names in every if problem.changing.issuperset(names)]:
            return [dict(zip(joints, names, strict=True)) for names in own]
    if problem.model.belief.groups or order.kind == "position":
        return [{}]
    # A single family of all columns: torques are other columns of it, in the same order.
    n, first, last = len(places), min(places), max(places)
    starts = [k for k in range(len(order.names) - n + 1) if k > last or k + n <= first] if last - first + 1 == n else []
    shifted = [[order.names[place - first + k] for place in places] for k in starts]
    moving = [names for names in shifted if problem.changing.issuperset(names)]
    return [dict(zip(joints, names, strict=True)) for names in moving] or [{}]
