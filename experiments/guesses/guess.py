"""Guess of a mapping of columns from a log and a model: all evidence in its order, and orders of numbered columns."""

import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, compress, permutations
from math import perm
from pathlib import Path

import numpy as np

from experiments.guesses.belief import BASE, DOUBTFUL, LIKELY, Belief, ColumnGroup, TableEntry
from experiments.guesses.checks import (
    check_positions,
    check_wrenches_and_torques,
    doubt_units,
    set_orientation,
    set_rates,
    set_units,
)
from experiments.guesses.log_contents import ROUND, check_same_columns, log_contents
from experiments.guesses.model import CLEAR, ENOUGH, ENOUGH_OF_WRENCHES, LITTLE, SAME, ComparedModel, explained
from experiments.guesses.scores import (
    FITTING,
    add_assigned,
    add_commands,
    add_poses,
    add_predicted,
    assigned,
    by_derivative,
    by_name,
    by_number,
    candidates,
)
from experiments.guesses.words import MEASURED, PARTS, Family, families, suits, unit_of, words
from experiments.guesses.wrenches import add_wrenches, place_wrenches
from ident.errors import InputError
from ident.estimation.equations import COMPONENTS
from ident.files.limits import LIMIT
from ident.files.table import UNITS
from ident.mechanism.mechanism import Mechanism
from ident.recordings.wrench import GROUND

MOST = 400
"""Largest number of assignments of columns without names to joints that are tried."""

MODEL, ALPHABET, LABELS, ANY = "the model's", "the alphabetical", "the stated", "the best"
DRIVER = "the driver's"
"""Orders of joints."""

RTDE = re.compile(r"actual_q[\W_]*#\W?")
"""Families of positions of Universal Robots' RTDE interface, which numbers joints from the base on."""

UNNAMED = Family("")
"""Family of columns that have no names in common."""


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
    _note_currents(belief)
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
            belief.ask_place(group, "Its name does not say so.")
        return
    check_positions(model)
    if not belief.sign_undecided:
        place_wrenches(model)


def _complete(belief: Belief) -> None:
    """Asks for joints without positions, unless they follow others."""
    placed = {*belief.of("position"), *(key.removeprefix("joints.") for key in belief.poses)}
    following = belief.mechanism.determined(placed)
    leads = {joint: f"'{lead.joint}'" for joint, lead in belief.mechanism.mimics.items()}
    belief.notes += [
        f"'{joint}' follows {leads.get(joint, 'from other joints')}, as the model couples them." for joint in following
    ]
    lacking = [joint for joint in belief.mechanism.joints if joint not in placed and joint not in following]
    belief.complete = not lacking
    if (absent := [joint for joint in lacking if joint not in belief.undecided]) and not belief.log.markers:
        listed, fixed = ", ".join(map(repr, absent)), " ".join(f"--fix {shlex.quote(joint)}" for joint in absent)
        belief.ask(f"No column looks like the position of {listed}; {fixed} leaves out what rests.")


def _note_currents(belief: Belief) -> None:
    """Notes which currents are not used as torques, and what is to state for them."""
    torques = [x for x in belief.quantities.values() if x.kind == "torque"]
    unused = [x.column for x in torques if x.is_current and x.sure == DOUBTFUL]
    if not belief.of("torque"):
        free = {name: words(name) for name in belief.free if name in belief.log.columns}
        unused += [name for name, own in free.items() if own.kind == "current" and own.numbers and own.measured]
    if unused:
        entry = f'torque = {{ column = "{unused[0]}", unit = "{words(unused[0]).unit or "A"}", gain = GAIN }}'
        belief.notes.append(
            f"Not used, as the gain of a current is not known here: {_listed(unused)}. State {entry} for each joint, "
            "with its motor's constant times the gear ratio in N m/A from the data sheet."
        )


@dataclass(frozen=True)
class Order:
    """Columns of joints, one for each joint.

    Attributes:
        label: Order of the joints.
        positions: Column of the position of each joint.
        family: Columns that may be positions; without members if they have no names.
        torques: Column of the torque of each joint; empty if torques are known or absent.
        left: Share of the measurements that the model leaves unexplained, 1 without measurements.
    """

    label: str
    positions: Mapping[str, str]
    family: Family = UNNAMED
    torques: Mapping[str, str] = field(default_factory=dict)
    left: float = 1.0

    def is_like(self, other: "Order", columns: Mapping[str, np.ndarray]) -> bool:
        """True where another order is equal, or differs only in columns (N,) with nearly the same values."""
        if self.positions.keys() != other.positions.keys():
            return False
        pairs = ((columns[name], columns[other.positions[joint]]) for joint, name in self.positions.items())
        return all(a is b or np.corrcoef(a, b)[0, 1] > SAME for a, b in pairs)


@dataclass(frozen=True, eq=False)
class OrderSearch:
    """Search for the columns of joints, in series or in any order.

    Attributes:
        model: The model beside the log.
        joints: Joints without positions, in the model's order.
        families: Families of columns that are not assigned yet.
    """

    model: ComparedModel
    joints: tuple[str, ...]
    families: tuple[Family, ...] = ()

    @property
    def belief(self) -> Belief:
        """The belief to extend."""
        return self.model.belief

    def of_series(self, several: Sequence[Family], kinds: Sequence[str]) -> list[Order]:
        """Orders of the columns of families as positions, with possible torques of some kinds, and what they leave."""
        orders = self.suiting(order for family in several for order in self._orders(family))
        return [own for each in orders for own in self.judged(each, self._torques(each, kinds), self.belief.free)]

    def suiting(self, orders: Iterable[Order]) -> list[Order]:
        """The orders whose columns state no unit that the positions of their joints cannot have, or else all."""
        every, kinds = list(orders), self.belief.kinds
        fit = (all(suits(f"{kinds[joint]} position", x) for joint, x in order.positions.items()) for order in every)
        return list(compress(every, fit)) or every

    def _orders(self, family: Family) -> Iterator[Order]:
        """Orders of as many consecutive columns of a family as there are joints, or of joints as there are columns."""
        names, joints, log = family.names, self.joints, self.belief.log
        for each in families(log.labels):
            own = {log.labels[label]: family.by_number.get(k, "") for k, label in each.by_number.items()}
            if all(map(own.get, joints)):
                yield Order(LABELS, {joint: own[joint] for joint in joints}, family)
                return
        # All joints, those of a family of that size, or consecutive ones, with the gaps of the columns' numbers.
        n = min(len(names), len(joints))
        alike = [each.names for each in families(joints) if len(each.names) == n < len(joints)]
        runs = [names[first : first + n] for first in range(len(names) - n + 1)]
        runs = [run for run in runs if log.columns.keys() >= set(run)]
        steps = [number - family.numbers[0] for number in family.numbers]
        steps = steps if len(names) == n and steps[-1] < len(joints) else list(range(n))
        for targets in alike or [tuple(joints[k + i] for i in steps) for k in range(len(joints) - steps[-1])]:
            by_driver = RTDE.fullmatch(family.template) and family.numbers == tuple(range(len(joints)))
            numbered = DRIVER if by_driver else MODEL
            for listed, label in {tuple(sorted(targets)): ALPHABET, tuple(targets): numbered}.items():
                yield from (Order(label, dict(zip(listed, run, strict=True)), family) for run in runs)

    @property
    def _with_forces(self) -> Iterator[Family]:
        """The families, and those that torques of hinges make with forces of slides, each with numbers of its own."""
        yield from self.families
        for one, other in combinations([each for each in self.families if each.kind == "torque"], 2):
            members = [*zip(one.numbers, one.names, strict=True), *zip(other.numbers, other.names, strict=True)]
            if len(dict(members)) == len(members):
                yield Family.of(one.template, members)

    def _torques(self, order: Order, kinds: Sequence[str]) -> list[dict[str, str]]:
        """Torque columns that may go with positions, at the same places in families; [{}] if torques are known."""
        own, places = order.family, [order.family.names.index(name) for name in order.positions.values()]
        there = [each for each in self._with_forces if each.is_of_joints and len(each.names) == len(own.names)]
        for kind in kinds if not self.belief.of("torque") else ():
            every = [[each.names[k] for k in places] for each in there if each.kind == kind and each is not own]
            if not kind and not self.belief.groups and max(places) - min(places) < len(places):
                # Of a single family of all columns, torques are others in the same order.
                shifts = range(-min(places), len(own.names) - max(places))
                every += [[own.names[k + shift] for k in places] for shift in shifts if abs(shift) >= len(places)]
            if options := [names for names in every if self.belief.log.columns.keys() >= set(names)]:
                return [dict(zip(order.positions, names, strict=True)) for names in options]
        return [{}]

    def judged(self, order: Order, options: Sequence[dict[str, str]], others: Sequence[str]) -> Iterator[Order]:
        """The same order with each family of torques, or with other columns as measured, and its unexplained share."""
        model, belief, is_any = self.model, self.belief, order.label == ANY
        free = [name for name in others if name in model.levels and name not in order.positions.values()]
        for scale in self._scales(order):
            states = model.states_of(order.positions, scale)
            predicted = model.predicted(states)
            known = [share.somehow for share in model.shares(states, predicted)]
            shares, judged = model.of_torques(states, predicted, free), list[Order]()
            for torques in options:
                every = known + [float(shares[joint][free.index(name)]) for joint, name in torques.items()]
                left = float(np.mean(every)) if every else 1.0
                judged.append(replace(order, torques=torques, left=left))
            if not (known or order.family.kind or belief.groups) and (is_any or (belief.held and len(free) > 5)):
                # Others may be the ground's wrench, or without any series whatever the model predicts.
                like, channels = model.likeness(free, predicted)
                like = like if is_any else like[:, [channel in COMPONENTS for channel in channels]]
                best = like.max(axis=int(is_any), initial=0)
                judged.append(replace(order, left=1 - float(best.mean()) if best.size else 1.0))
            # Among columns without names, the best-fitting ones were measured.
            yield from judged if order.family.kind else [min(judged, key=lambda each: each.left)]

    def swapped(self, positions: Family, torques: Family) -> list[Order]:
        """Order of positions and torques that no swap of two joints improves, and all orders one swap away from it."""

        def judged(joints: Sequence[str], label: str) -> Order:
            order, own = Order(label, dict(zip(joints, positions.names, strict=True)), positions), torques.names
            every = self.judged(order, [dict(zip(joints, own, strict=True))], own)
            return min(every, key=lambda order: order.left)

        best, joints = judged(self.joints, MODEL), [*self.joints]
        while True:
            ways = list[Order]()
            for i, k in combinations(range(len(joints)), 2):
                other = [joints[{i: k, k: i}.get(j, j)] for j in range(len(joints))]
                ways.append(judged(other, ANY))
            better = min(ways, key=lambda order: order.left, default=best)
            if better.left >= best.left:
                return [best, *ways]
            best, joints = better, [*better.positions]

    def _scales(self, order: Order) -> list[float]:
        """Candidate factors from positions to radians, by the unit that is stated, or else by their size."""
        log, kinds = self.belief.log, self.belief.kinds
        columns = [name for joint, name in order.positions.items() if kinds[joint] == "hinge"]
        units = {unit_of("hinge position", words(name).unit) or log.units.get(name, "") for name in columns} - {""}
        if units:
            return [UNITS["hinge position"].get(units.pop(), 1.0)]
        largest = max(map(log.largest, columns), default=0.0)
        return [1.0] if largest < 0.05 else [np.pi / 180] if largest > 10 * ROUND else [1.0, np.pi / 180]

    def add_best(self, every: Sequence[Order], *, ask: bool = True) -> bool:
        """Adds the order that leaves least, and returns True if it is clearly the best and explains enough.

        A driver's order is taken unless another is clearly better. With `ask`, what is not clear becomes a draft.
        """
        every = sorted(every, key=lambda order: order.left)
        best = next((own for own in every if own.label == DRIVER and CLEAR * own.left < every[0].left), every[0])
        twins = [order for order in every if best.is_like(order, self.belief.log.columns)]
        others = [order.left for order in every if order not in twins]
        left, second = best.left, min(others, default=1.0)
        alone = (not others or best.label in (LABELS, DRIVER)) and best.label != ANY
        enough = ENOUGH if best.torques or self.belief.of("torque") or best.label == ANY else ENOUGH_OF_WRENCHES
        least = LITTLE if alone else enough
        is_clear = 1 - left >= least and (alone or left <= CLEAR * second)
        copies = list(dict.fromkeys(_listed(order.positions.values()) for order in twins))
        why = f"in {best.label} order of the joints the model explains {explained(left)} of what is measured"
        if is_clear and (best.family.kind or len(copies) == 1):
            rival = f", otherwise at most {explained(second)}" if others else ""
            self._add(replace(best, torques=self._torques_of(best, twins)), why + rival)
            return True
        if ask and is_clear:
            which = "which were measured, and which were commanded, is open"
            self.belief.ask(f"{' and '.join(copies)} are nearly the same: {which}.", self.joints)
        elif ask:
            needed = f", where it takes {explained(1 - least)}" if 1 - left < least else ""
            rival = f", and {explained(second)} with the next best choice" if others else ""
            shares = f"With {copies[0]} the model explains {100 * (1 - left):.1f} % of what is measured{needed}{rival}."
            self.belief.ask(f"The columns of the positions of {_listed(self.joints)} are open. {shares}", self.joints)
        if ask:
            self._add(best, f"tried: {why}", DOUBTFUL)
        return False

    def add_unmeasured(self, every: Sequence[Order]) -> None:
        """Adds the only order, or a driver's, if nothing is measured to check it; drafts one of several."""
        best = next((order for order in every if order.label == DRIVER), every[-1])
        is_only = len({tuple(order.positions.items()) for order in every}) == 1 and best.family.kind == "position"
        why = f"in {best.label} order of the joints, which nothing in the log can confirm"
        if is_only or best.label == DRIVER:
            self._add(best, why)
            return
        self._add(best, f"tried: {why}", DOUBTFUL)
        self.belief.ask(
            f"{_listed(every[0].family.names)} may be the positions of {_listed(self.joints)} in several orders. The "
            "log has no wrench and no torque that shows which.",
            self.joints,
        )

    def _torques_of(self, best: Order, twins: Sequence[Order]) -> Mapping[str, str]:
        """Torques of the best order, none if another family's torques are explained as well."""
        alike = [each for each in twins if 1 - each.left >= ENOUGH and CLEAR * each.left <= best.left and each.torques]
        every = list(dict.fromkeys(tuple(each.torques.items()) for each in (best, *alike)))
        if len(every) == 1 or not best.torques or not best.family.kind:
            return best.torques
        stated = [each for each in every if MEASURED & {p.lower() for _, name in each for p in PARTS.findall(name)}]
        if len(stated) == 1:
            return dict(stated[0])
        names = " or of ".join(_listed(name for _, name in each) for each in every)
        self.belief.ask(f"The torques may be those of {names}, which the model explains alike.")
        self.belief.torques_undecided = True
        return {}

    def _add(self, order: Order, why: str, sure: str = LIKELY) -> None:
        """Adds the quantities of an order to the belief."""
        if order.label not in (LABELS, DRIVER):
            self.belief.by_place |= set(order.positions)
        rates = assigned(
            by_derivative(self.belief, order.positions, {*order.positions.values(), *order.torques.values()})
        )
        velocities = {joint: column for column, joint in rates} if len(rates) == len(order.positions) else {}
        quantities = {"position": order.positions, "torque": order.torques, "velocity": velocities}
        for kind, columns in quantities.items():
            for joint, column in columns.items():
                reason = why if kind == "position" else "in the place of the position"
                self.belief.add(joint, kind, column, reason, sure)


def add_series(belief: Belief) -> None:
    """Adds positions, velocities and torques of joints without columns from families of numbered columns."""
    lacking = tuple(j for j in belief.axes if j not in belief.of("position") and j not in belief.undecided)
    free = set(belief.free)
    there = tuple(each for each in families(belief.log.names) if free >= set(each.names))
    own = [each for each in there if each.is_of_joints]
    own = [each for each in own if each.kind == "position"] or [each for each in own if each.kind == ""]
    # Of few columns without names all assignments are tried, not only consecutive ones.
    own = [each for each in own if not (each.template == "#" and perm(len(each.names), len(lacking)) <= MOST)]
    own = [each for each in own if len(each.names) > 1]
    if not own or not lacking or not belief.can_predict:
        return
    search = OrderSearch(ComparedModel.of(belief, [name for each in own for name in each.names]), lacking, there)
    every = search.of_series(own, ("torque", "current") if own[0].kind else ("torque", "current", ""))
    if measured := [order for order in every if order.left < 1]:
        search.add_best(measured)
        return
    # Nothing is named like torques: other series may be some.
    unnamed = [order for order in search.of_series(own, ("",)) if order.left < 1]
    if every and not (unnamed and search.add_best(unnamed, ask=False)):
        search.add_unmeasured(every)


def add_any(belief: Belief) -> None:
    """Adds positions in any order if the model explains clearly more with it."""
    positions, log = belief.of("position"), belief.log
    lacking = tuple(joint for joint in belief.mechanism.joints if joint not in positions)
    still = any(x.column not in log.columns for x in positions.values())
    names, others = candidates(belief, len(lacking))
    names = [name for name in names if words(name).kind in FITTING["position"]]
    if not belief.can_predict or still or belief.undecided or not lacking or len(names) < len(lacking):
        return
    if perm(len(names), len(lacking)) <= MOST:
        search = OrderSearch(ComparedModel.of(belief, names), lacking)
        orders = (Order(ANY, dict(zip(lacking, each, strict=True))) for each in permutations(names, len(lacking)))
        search.add_best([own for order in search.suiting(orders) for own in search.judged(order, [{}], others)])
    elif alike := _alike(belief, len(lacking)):
        search = OrderSearch(ComparedModel.of(belief, alike[0].names), lacking)
        search.add_best(search.swapped(*alike))
    else:
        several = f"any of {len(names)} columns, too many to compare all of them with the model"
        belief.ask(f"The positions of {_listed(lacking)} may be {several}.", lacking)


def _alike(belief: Belief, number: int) -> tuple[Family, Family] | None:
    """Positions and torques by the words of their names, if there are as many of each as joints; else None."""
    kinds: dict[str, list[str]] = {}
    for name in (name for name in belief.free if name in belief.log.columns and words(name).measured):
        kinds.setdefault(words(name).kind, []).append(name)
    both = [kinds.get("position", []), kinds.get("torque") or kinds.get("current", [])]
    if any(len(names) != number for names in both):
        return None
    positions, torques = (Family.of("", enumerate(names)) for names in both)
    return positions, torques


def _listed(names: Iterable[str]) -> str:
    """Names of a family or of several joints, abbreviated."""
    names = list(names)
    return ", ".join(names) if len(names) < 3 else f"{names[0]} to {names[-1]}"
