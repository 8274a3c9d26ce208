"""Columns without names, or in numbered series: the order of the joints with which the model explains clearly more."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from math import perm

import numpy as np

from experiments.guesses.belief import Belief, ColumnGroup, TableEntry
from experiments.guesses.guessed_units import ROUND, is_rate
from experiments.guesses.matched_names import assigned
from experiments.guesses.model import ComparedModel, explained
from experiments.guesses.words import MEASURED, PARTS, Family, families, unit_of, words
from ident.estimation.equations import COMPONENTS
from ident.files.column import UNITS
from ident.recordings.wrench import GROUND

ENOUGH, LITTLE = 0.5, 0.1
"""Shares of wrenches and torques that the model has to explain with columns assigned only by their place, and with
others. Torques of arms are explained to less than half with columns of other joints, to eight tenths or more with the
right ones, even if masses are wrong by a factor of two. For columns with names the model may be worse."""

ENOUGH_OF_WRENCHES = 0.95
"""Share of wrenches that the model has to explain with one order among several, whatever the wrenches' axes: with that
much freedom, a wrong order explains up to nine tenths."""

CLEAR = 0.7
"""Ratio of the best order's unexplained share to the second's, above which the choice is open."""

SAME = 0.999
"""Correlation of columns above which they may be two readings of one joint."""

AGREES = 0.8
"""Share of a column's variance above which a prediction is accepted for it."""

MOST = 400
"""Largest number of assignments of columns without names to joints that are tried."""

MODEL, ALPHABET, LABELS, ANY = "the model's", "the alphabetical", "the stated", "the best"
"""Orders of joints."""


UNNAMED = Family("")
"""Family of columns that have no names in common."""


@dataclass(frozen=True)
class Order:
    """Columns of joints, one for each joint.

    Attributes:
        label: Order of the joints.
        positions: Column of the position of each joint.
        family: Columns that may be positions; without members if they have no names.
        torques: Column of the torque of each joint; empty if torques are known or absent.
        share: Share of the measurements that the model leaves unexplained; None without measurements.
    """

    label: str
    positions: Mapping[str, str]
    family: Family = UNNAMED
    torques: Mapping[str, str] = field(default_factory=dict)
    share: float | None = None

    @property
    def left(self) -> float:
        """Share of the measurements that is left, 1 without any."""
        return 1.0 if self.share is None else self.share

    @property
    def has_numbers_of_joints(self) -> bool:
        """True where the columns have the joints' own numbers."""
        numbers = {joint: k for each in families(self.positions) for k, joint in each.by_number.items()}
        own = {self.family.by_number.get(numbers.get(joint, -1)) == name for joint, name in self.positions.items()}
        return own == {True}


@dataclass(frozen=True, eq=False)
class ColumnSearch:
    """Search for the columns of joints.

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

    def orders(self, family: Family, kinds: Sequence[str]) -> Iterator[Order]:
        """Orders of a family's columns as positions, with possible torques of some kinds, and what they leave."""
        for label, joints, columns in self._orders(family):
            order = Order(label, dict(zip(joints, columns, strict=True)), family)
            yield from self._judged(order, self._torques(order, kinds), self.belief.free)

    def any_order(self, names: Sequence[str], others: Sequence[str]) -> Iterator[Order]:
        """All assignments of columns, each with the share of the measurements, or of all others, that it leaves."""
        for chosen in permutations(names, len(self.joints)):
            yield from self._judged(Order(ANY, dict(zip(self.joints, chosen, strict=True))), [{}], others)

    def _orders(self, family: Family) -> Iterator[tuple[str, Sequence[str], Sequence[str]]]:
        """Name of the order, joints in this order, and as many consecutive columns of a family."""
        names, joints, log = family.names, self.joints, self.belief.log
        for each in families(log.labels):
            own = {log.labels[label]: family.by_number.get(k, "") for k, label in each.by_number.items()}
            if all(map(own.get, joints)):
                yield LABELS, joints, [own[joint] for joint in joints]
                return
        # All joints, those of a family of that size, or consecutive ones.
        n = min(len(names), len(joints))
        alike = [each.names for each in families(joints) if len(each.names) == n < len(joints)]
        runs = [names[first : first + n] for first in range(len(names) - n + 1)]
        for targets in alike or [joints[k : k + n] for k in range(len(joints) - n + 1)]:
            for listed, label in {tuple(sorted(targets)): ALPHABET, tuple(targets): MODEL}.items():
                yield from ((label, listed, run) for run in runs if log.columns.keys() >= set(run))

    def _torques(self, order: Order, kinds: Sequence[str]) -> list[dict[str, str]]:
        """Torque columns that may go with positions, at the same places in families; [{}] if torques are known."""
        own, places = order.family, [order.family.names.index(name) for name in order.positions.values()]
        if self.belief.of("torque"):
            return [{}]
        for kind in kinds:
            there = [each for each in self.families if each.is_of_joints and len(each.names) == len(own.names)]
            every = [[each.names[k] for k in places] for each in there if each.kind == kind and each is not own]
            if not kind and not self.belief.groups and max(places) - min(places) < len(places):
                # Of a single family of all columns, torques are others in the same order.
                shifts = range(-min(places), len(own.names) - max(places))
                every += [[own.names[k + shift] for k in places] for shift in shifts if abs(shift) >= len(places)]
            if options := [names for names in every if self.belief.log.columns.keys() >= set(names)]:
                return [dict(zip(order.positions, names, strict=True)) for names in options]
        return [{}]

    def _judged(self, order: Order, options: Sequence[dict[str, str]], others: Sequence[str]) -> Iterator[Order]:
        """The same order with each family of torques, or with other columns as measured, and its unexplained share."""
        model, belief, is_any = self.model, self.belief, order.label == ANY
        free = [name for name in others if name in model.levels and name not in order.positions.values()]
        for scale in self.scales(list(order.positions.values())):
            states = model.states_of(order.positions, scale)
            predicted = model.predicted(states)
            known = [share.somehow for share in model.shares(states, predicted)]
            shares, judged = model.of_torques(states, predicted, free), list[Order]()
            for torques in options:
                every = known + [float(shares[joint][free.index(name)]) for joint, name in torques.items()]
                judged.append(replace(order, torques=torques, share=float(np.mean(every)) if every else None))
            if not (known or order.family.kind or belief.groups) and (is_any or (belief.held and len(free) > 5)):
                # Others may be the ground's wrench, or without any series whatever the model predicts.
                like, channels = model.likeness(free, predicted)
                like = like if is_any else like[:, [channel in COMPONENTS for channel in channels]]
                best = like.max(axis=int(is_any), initial=0)
                judged.append(replace(order, share=1 - float(best.mean()) if best.size else 1.0))
            # Among columns without names, the best-fitting ones were measured.
            yield from judged if order.family.kind else [min(judged, key=lambda each: each.left)]

    def scales(self, columns: Sequence[str]) -> list[float]:
        """Candidate factors from positions to radians, by the unit that is stated, or else by their size."""
        log = self.belief.log
        units = {unit_of("hinge position", words(name).unit) or log.units.get(name, "") for name in columns} - {""}
        if units:
            return [UNITS["hinge position"].get(units.pop(), 1.0)]
        largest = max(map(log.largest, columns))
        return [1.0] if largest < 0.05 else [np.pi / 180] if largest > 10 * ROUND else [1.0, np.pi / 180]

    def add_best(self, every: Sequence[Order], *, ask: bool = True) -> bool:
        """Adds the order that leaves least, and returns True if it is clearly the best and explains enough."""
        every = sorted(every, key=lambda order: order.left)
        twins = [order for order in every if self._is_twin(every[0], order)]
        # Of equally good families, those of the joint precede those of the motor or before calibration.
        best = min(twins, key=lambda order: bool(order.family.kind) and order.family.is_second)
        others = [order.left for order in every if order not in twins]
        left, second = best.left, min(others, default=1.0)
        enough = ENOUGH if best.torques or self.belief.of("torque") or best.label == ANY else ENOUGH_OF_WRENCHES
        alone = (not others or best.label == LABELS) and best.label != ANY and 1 - left >= LITTLE
        is_clear = alone or (1 - left >= enough and left <= CLEAR * second)
        copies = list(dict.fromkeys(_listed(order.positions.values()) for order in twins))
        if is_clear and (best.family.kind or len(copies) == 1):
            rival = f", otherwise at most {explained(second)}" if others else ""
            why = f"in {best.label} order of the joints the model explains {explained(left)} of what is measured"
            self._add(replace(best, torques=self._torques_of(best, twins)), why + rival)
            return True
        if ask:
            rival = f", and {explained(second)} with the next best choice" if others else ""
            are_open = (
                f"The columns of the positions of {_listed(self.joints)} are open. With {copies[0]} the model explains "
                f"{explained(left)} of what is measured{rival}."
            )
            which = (
                f"{' and '.join(copies)} are nearly the same: which were measured, and which were commanded, is open."
            )
            self.belief.ask(which if is_clear else are_open, self.joints)
        return False

    def add_unmeasured(self, every: Sequence[Order]) -> None:
        """Adds the only order if nothing is measured to check it; none of several."""
        if len({tuple(order.positions.items()) for order in every}) == 1 and every[0].family.kind == "position":
            self._add(every[0], f"in {every[0].label} order of the joints, which nothing in the log can confirm")
            return
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
        if len(stated := [each for each in every if any(_is_stated(name) for _, name in each)]) == 1:
            return dict(stated[0])
        names = " or of ".join(_listed(name for _, name in each) for each in every)
        self.belief.ask(f"The torques may be those of {names}, which the model explains alike.")
        self.belief.torques_undecided = True
        return {}

    def _is_twin(self, one: Order, other: Order) -> bool:
        """True where two orders are equal, or differ only in columns with nearly the same values."""
        if one.positions.keys() != other.positions.keys():
            return False
        x, y = ([self.belief.log.columns[order.positions[j]] for j in one.positions] for order in (one, other))
        return all(a is b or np.corrcoef(a, b)[0, 1] > SAME for a, b in zip(x, y, strict=True))

    def _add(self, order: Order, why: str) -> None:
        """Adds the quantities of an order to the belief."""
        if order.label != LABELS and not order.has_numbers_of_joints:
            self.belief.by_place |= set(order.positions)
        quantities = (("position", order.positions), ("torque", order.torques), ("velocity", self._rates(order)))
        for kind, columns in quantities:
            for joint, column in columns.items():
                self.belief.add(joint, kind, column, why if kind == "position" else "in the place of the position")

    def _rates(self, order: Order) -> dict[str, str]:
        """Columns that are derivatives of all positions, the likeliest first."""
        log, taken = self.belief.log, {*order.positions.values(), *order.torques.values()}
        free = {name: words(name) for name in self.belief.free if name in log.columns and name not in taken}
        names = [n for n, each in free.items() if each.measured and each.kind in ("velocity", "")]
        scores = [[is_rate(log, q, n) * (1 + (free[n].kind != "")) for q in order.positions.values()] for n in names]
        pairs = assigned(np.array(scores).reshape(len(names), len(order.positions)))[1]
        joints = list(order.positions)
        return {joints[k]: names[i] for i, k in pairs} if len(pairs) == len(joints) else {}


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
    search = ColumnSearch(ComparedModel.of(belief, [name for each in own for name in each.names]), lacking, there)
    named = ("torque", "current") if own[0].kind else ("torque", "current", "")
    every = [order for each in own for order in search.orders(each, named)]
    if measured := [order for order in every if order.share is not None]:
        search.add_best(measured)
        return
    # Nothing is named like torques: other series may be some.
    unnamed = [order for each in own for order in search.orders(each, ("",)) if order.share is not None]
    if every and not (unnamed and search.add_best(unnamed, ask=False)):
        search.add_unmeasured(every)


def add_any(belief: Belief) -> None:
    """Adds positions in any order if the model explains clearly more with it."""
    positions, log = belief.of("position"), belief.log
    lacking = tuple(joint for joint in belief.mechanism.joints if joint not in positions)
    still = any(x.column not in log.columns for x in positions.values())
    names, others = _candidates(belief, len(lacking))
    if not belief.can_predict or still or belief.undecided or not lacking or len(names) < len(lacking):
        return
    if perm(len(names), len(lacking)) <= MOST:
        search = ColumnSearch(ComparedModel.of(belief, names), lacking)
        search.add_best(list(search.any_order(names, others)))
    else:
        several = f"any of {len(names)} columns, too many to compare all of them with the model"
        belief.ask(f"The positions of {_listed(lacking)} may be {several}.")


def add_measured(belief: Belief) -> None:
    """Adds the ground's wrench, or else torques, if none is known: columns that the model's predictions explain."""
    positions, log, joints = belief.of("position"), belief.log, belief.mechanism.joints
    moving = all(joint in positions and positions[joint].column in log.columns for joint in joints)
    known = belief.torques_undecided or belief.undecided or belief.groups or belief.of("torque")
    _, names = _candidates(belief)
    if known or not moving or not names or not joints or not belief.can_predict:
        return
    model = ComparedModel.of(belief)
    like, channels = model.likeness(names, model.predicted(model.states_of({})))

    def matched(wanted: Sequence[str]) -> dict[str, tuple[str, float]]:
        """Columns by channel with the largest sum of squared correlations, each with its own."""
        those = [k for k, channel in enumerate(channels) if channel in wanted]
        pairs = {channels[those[k]]: (names[i], float(like[i, those[k]])) for i, k in assigned(like[:, those])[1]}
        return {channel: pair for channel, pair in pairs.items() if pair[1] > AGREES}

    wrench = matched(COMPONENTS) if belief.held else {}
    if len(wrench.keys() & set(COMPONENTS[:3])) > 1:
        columns = {component: column for component, (column, _) in wrench.items()}
        least = explained(1 - min(share for _, share in wrench.values()))
        for key, part in (("force", COMPONENTS[:3]), ("torque", COMPONENTS[3:])):
            _fill(columns, part, belief)
            entry = TableEntry(
                [columns.get(c, "") for c in part], f"the model explains {least} of its variance or more"
            )
            belief.groups.setdefault(GROUND, ColumnGroup(GROUND, {})).entries[key] = entry
        return
    torques = matched(joints)
    for joint, (column, share) in torques.items() if 2 * len(torques) >= len(joints) else ():
        belief.add(joint, "torque", column, f"the model explains {explained(1 - share)} of its variance")


def _fill(columns: dict[str, str], part: Sequence[str], belief: Belief) -> None:
    """Adds the third component if two are in order in the file."""
    names = belief.log.names
    starts = [names.index(columns[c]) - k for k, c in enumerate(part) if c in columns]
    if len(starts) == 2 and starts[0] == starts[1]:
        for component, name in zip(part, names[starts[0] : starts[0] + 3], strict=False):
            if component not in columns and name not in (*columns.values(), *belief.columns):
                columns[component] = name
                place = "by its place alone: the model predicts none"
                belief.notes.append(f"Column '{name}' is taken for {component} {place}.")


def _candidates(belief: Belief, number: int = 0) -> tuple[list[str], list[str]]:
    """Columns that may be positions of some number of joints, and all that are no derivatives of others."""
    free = [name for name in belief.free if name in belief.log.columns and words(name).measured]
    rates = {b: a for a in free for b in free if a != b and is_rate(belief.log, a, b)}
    others = [name for name in free if name not in rates]
    # A column with a derivative is a position; without any such pair all columns may be.
    roots = [name for name in others if name in rates.values()] or free
    return (roots if len(roots) >= number else others), others


def _is_stated(name: str) -> bool:
    """True if the name of a column says that it was measured."""
    return any(part.lower() in MEASURED for part in PARTS.findall(name))


def _listed(names: Iterable[str]) -> str:
    """Names of a family or of several joints, abbreviated."""
    names = list(names)
    return ", ".join(names) if len(names) < 3 else f"{names[0]} to {names[-1]}"
