"""The order of columns with which the model explains clearly more than with others, or a question."""

from collections.abc import Sequence
from dataclasses import replace
from math import perm

import numpy as np

from experiments.guesses.belief import LIKELY, Belief, Quantity
from experiments.guesses.explained import Model, explained
from experiments.guesses.families import families
from experiments.guesses.log_contents import LogContents
from experiments.guesses.orders import (
    ANY,
    LABELS,
    MOST,
    Order,
    Problem,
    candidates,
    orders_of,
    orders_of_any,
    position_families,
)
from experiments.guesses.units import is_rate
from ident.mechanism.mechanism import Mechanism

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


def add_series(belief: Belief, contents: LogContents, mechanism: Mechanism, joints: Sequence[str], held: bool) -> None:
    """Adds positions, velocities and torques of joints without columns from families of numbered columns.

    Args:
        belief: The belief to extend.
        contents: The log.
        mechanism: The mechanism.
        joints: Its joints with one axis.
        held: True if something holds the base.
    """
    lacking = tuple(j for j in joints if j not in belief.of("position") and j not in belief.undecided)
    free = {name for name in contents.names if name not in belief.columns}
    there = tuple(each for each in families(contents.names) if set(each.names) <= free)
    fitting = position_families(there, lacking) if lacking else []
    if not fitting or mechanism.prior is None:
        return
    moving = [name for each in fitting for name in each.names if name in contents.columns]
    problem = Problem(Model.of(belief, contents, mechanism, moving), lacking, there, held)
    every = [order for each in fitting for order in orders_of(problem, each, ("torque", "current"))]
    if measured := [order for order in every if order.left is not None]:
        _add_best(problem, measured)
        return
    # Nothing is named like torques: other series may be some.
    unnamed = [order for each in fitting for order in orders_of(problem, each, ("",)) if order.left is not None]
    if every and not (unnamed and _add_best(problem, unnamed, ask=False)):
        _add_unmeasured(problem, every)


def add_any(belief: Belief, contents: LogContents, mechanism: Mechanism, joints: Sequence[str], held: bool) -> None:
    """Adds positions in any order if the model explains clearly more with it; arguments as for `add_series`."""
    positions = belief.of("position")
    lacking = tuple(joint for joint in joints if joint not in positions)
    still = [joint for joint, x in positions.items() if x.column not in contents.columns]
    names, others = candidates(belief, contents, len(lacking))
    if mechanism.prior is None or still or belief.undecided or not lacking or len(names) < len(lacking):
        return
    if perm(len(names), len(lacking)) > MOST:
        belief.open.append(
            f"The positions of {_listed(lacking)} may be any of {len(names)} columns, too many to compare all of them "
            "with the model."
        )
        return
    problem = Problem(Model.of(belief, contents, mechanism, names), lacking, (), held)
    _add_best(problem, list(orders_of_any(problem, names, others)))


def _add_best(problem: Problem, every: Sequence[Order], *, ask: bool = True) -> bool:
    """Adds the order that leaves least unexplained, and returns True if it is clearly the best and explains enough."""
    every = sorted(every, key=_left)
    twins = [order for order in every if _is_twin(problem, every[0], order)]
    # Of equally good families, those of the joint precede those of the motor or before calibration.
    best = min(twins, key=lambda order: order.is_second)
    others = [order for order in every if order not in twins]
    left, second = _left(best), min(map(_left, others), default=1.0)
    by_torques = best.torques or problem.model.belief.of("torque") or best.order == ANY
    alone = (not others or best.order == LABELS) and best.order != ANY and 1 - left >= LITTLE
    is_clear = alone or (1 - left >= (ENOUGH if by_torques else ENOUGH_OF_WRENCHES) and left <= CLEAR * second)
    if is_clear and not (best.kind == "" and any(order.positions != best.positions for order in twins)):
        best = _with_one_family_of_torques(problem, best, twins)
        why = f"in {best.order} order of the joints the model explains {explained(left)} of what is measured"
        _add(problem, best, why + (f", otherwise at most {explained(second)}" if others else ""))
        return True
    if ask and is_clear:
        places = dict.fromkeys(_listed(tuple(order.positions.values())) for order in twins)
        _ask(
            problem,
            f"{' and '.join(places)} are nearly the same: which were measured, and which were commanded, is open.",
        )
    elif ask:
        rival = f", and {explained(second)} with the next best choice" if others else ""
        taken = _listed(tuple(best.positions.values()))
        _ask(
            problem,
            f"The columns of the positions of {_listed(problem.joints)} are open. With {taken} the model explains "
            f"{explained(left)} of what is measured{rival}.",
        )
    return False


def _left(order: Order) -> float:
    return 1.0 if order.left is None else order.left


def _with_one_family_of_torques(problem: Problem, best: Order, twins: Sequence[Order]) -> Order:
    """The best order, without its torques if another family's torques are explained as well."""
    rivals = [order for order in twins if order.torques and dict(order.torques) != dict(best.torques)]
    rivals = [order for order in rivals if 1 - _left(order) >= ENOUGH and CLEAR * _left(order) <= _left(best)]
    if not rivals or not best.torques or best.kind == "":
        return best
    stated = {tuple(order.torques.items()) for order in (best, *rivals) if order.torques_are_measured}
    if len(stated) == 1:
        return replace(best, torques=dict(stated.pop()))
    names = dict.fromkeys(_listed(tuple(order.torques.values())) for order in (best, *rivals))
    problem.model.belief.open.append(
        f"The torques may be those of {' or of '.join(names)}, which the model explains alike."
    )
    problem.model.belief.torques_undecided = True
    return replace(best, torques={})


def _add_unmeasured(problem: Problem, every: Sequence[Order]) -> None:
    """Adds the only order if nothing is measured to check it; none of several."""
    different = {tuple(order.positions.items()): order for order in every}
    if len(different) == 1 and every[0].kind == "position":
        _add(problem, every[0], f"in {every[0].order} order of the joints, which nothing in the log can confirm")
        return
    _ask(
        problem,
        f"{_listed(every[0].names)} may be the positions of {_listed(problem.joints)} in several orders. The log has "
        "no wrench and no torque that shows which.",
    )


def _ask(problem: Problem, sentence: str) -> None:
    problem.model.belief.open.append(sentence)
    problem.model.belief.undecided |= set(problem.joints)


def _is_twin(problem: Problem, one: Order, other: Order) -> bool:
    """True where two orders are equal, or differ only in columns with nearly the same values."""
    if one.positions.keys() != other.positions.keys():
        return False
    columns = problem.model.contents.columns
    x, y = ([columns[order.positions[joint]] for joint in one.positions] for order in (one, other))
    return all(a is b or np.corrcoef(a, b)[0, 1] > SAME for a, b in zip(x, y, strict=True))


def _add(problem: Problem, order: Order, why: str) -> None:
    """Adds the quantities of an order to the belief."""
    belief = problem.model.belief
    if order.order != LABELS and not _has_numbers_of_joints(order):
        belief.by_place |= set(order.positions)
    rates = _rates(problem, order)
    for kind, columns in (("position", order.positions), ("torque", order.torques), ("velocity", rates)):
        for joint, column in columns.items():
            reason = why if kind == "position" else "in the place of the position"
            belief.add(Quantity(joint, kind, column, LIKELY, [reason]))


def _has_numbers_of_joints(order: Order) -> bool:
    """True where the columns have the joints' own numbers."""
    own = {joint: number for each in families(order.positions) for number, joint in each.members}
    there = {name: number for each in families(order.names) for number, name in each.members}
    return all(joint in own and own[joint] == there.get(name) for joint, name in order.positions.items())


def _rates(problem: Problem, order: Order) -> dict[str, str]:
    """Columns that are derivatives of the positions, all of one family, in the same order."""
    contents, positions = problem.model.contents, order.positions.values()
    places = [order.names.index(name) for name in positions]
    taken = {*positions, *order.torques.values(), *problem.model.belief.columns}
    for each in problem.families:
        same = each.names == order.names
        if not (same or (each.kind == "velocity" and each.is_of_joints and len(each.names) == len(order.names))):
            continue
        for first in range(-min(places), len(each.names) - max(places)) if same else (0,):
            names = [each.names[place + first] for place in places]
            moving = contents.columns.keys() >= {*positions, *names} and taken.isdisjoint(names)
            if moving and all(is_rate(contents, x, dx) for x, dx in zip(positions, names, strict=True)):
                return dict(zip(order.positions, names, strict=True))
    return {}


def _listed(names: Sequence[str]) -> str:
    """Names of a family or of several joints, abbreviated."""
    return ", ".join(names) if len(names) < 3 else f"{names[0]} to {names[-1]}"
