"""Scores of columns for quantities of joints by several kinds of evidence, and the assignment with the largest sum.

Likewise orientations of ball joints, and poses of a moving base.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from experiments.guesses.belief import BASE, DOUBTFUL, Belief, ColumnGroup, TableEntry, named
from experiments.guesses.model import ComparedModel, explained
from experiments.guesses.words import (
    LIKE,
    NEAR,
    Words,
    families,
    likeness,
    unit_of,
    without_prefix,
    without_unit,
    words,
)
from ident.estimation.equations import COMPONENTS
from ident.estimation.recorded_motion import UNIT
from ident.files.table import COMMAND, KINDS
from ident.recordings.wrench import GROUND
from ident.tolerances import AGREES
from sim.models.notes import LONGEST

Scores = dict[tuple[str, str], float]
"""Scores of pairs of a column and a joint, or of a column and a channel that the model predicts."""

EXACT = 1.01
"""Score of a name that `read_log` knows, which no other name reaches."""

FITTING = {"position": ("position", ""), "torque": ("torque", "current", "force")}
"""Quantities that names may state of columns of a kind, if others than the kind."""


BASES = re.compile(r"pelvis|base|root|trunk|torso|float", re.IGNORECASE)
"""Names of bodies that move freely."""

TURNS = r"(?:quaternion|quat|orientation|rotation|rot|position|pos|q)?"

MOVES = r"(?:position|pos|translation|trans|p|t)?"
"""Words between the name of a group of columns and its component."""


def assigned(scores: Scores) -> Scores:
    """Pairs with the largest sum of scores, each column and each joint at most once, without those of score zero."""
    columns, joints = (list(dict.fromkeys(pair[k] for pair in scores)) for k in (0, 1))
    matrix = np.array([[scores.get((column, joint), 0.0) for joint in joints] for column in columns])
    places = zip(*linear_sum_assignment(-matrix.reshape(len(columns), len(joints))), strict=True)
    pairs = ((columns[i], joints[k]) for i, k in places)
    return {pair: scores[pair] for pair in pairs if scores.get(pair, 0.0) > 0}


class Decision(NamedTuple):
    """A column assigned to a joint.

    Attributes:
        column: The column.
        joint: The joint.
        score: Score of the pair.
        columns: Columns that may be meant as well, this one included; empty if another assignment is clearly worse.
        joints: Otherwise joints that may be meant as well.
    """

    column: str
    joint: str
    score: float
    columns: list[str]
    joints: list[str]


def decisions(scores: Scores) -> Iterator[Decision]:
    """Columns and joints with the largest sum of scores, with rivals where another assignment is nearly as good."""
    scores = {pair: score for pair, score in scores.items() if score >= LIKE}
    best = assigned(scores)
    for (column, joint), score in best.items():
        other, columns, joints = assigned(scores | {(column, joint): 0.0}), list[str](), list[str]()
        if score < EXACT and sum(best.values()) - sum(other.values()) < NEAR:
            near = {pair for pair, each in scores.items() if each > score - NEAR}
            if any(to == joint for _, to in other):
                columns = [c for c in dict.fromkeys(c for c, _ in scores) if (c, joint) in near | other.keys()]
            else:
                joints = [j for j in dict.fromkeys(j for _, j in scores) if (column, j) in near]
        yield Decision(column, joint, score, columns, joints)


Evidence = Callable[[Belief, str], Scores]
"""Scores of columns that are not assigned yet, for joints without a quantity of some kind."""


def add_assigned(belief: Belief, evidence: Evidence, kinds: Iterable[str] = KINDS) -> None:
    """Adds the columns with the largest sum of scores; asks where another assignment is as good."""
    for kind in kinds:
        for column, joint, score, columns, joints in decisions(evidence(belief, kind)):
            if columns or joints:
                may_be = f"The {kind} of '{joint}' may be in {' or in '.join(columns)}."
                may_be = may_be if columns else f"Column '{column}' may be the {kind} of {' or of '.join(joints)}."
                belief.ask(may_be, (joints or [joint]) if kind == "position" else ())
            elif column in belief.log.constant and kind != "position":
                belief.add(joint, kind, "", f"'{column}' never changes", named(score)[1])
            else:
                belief.add(joint, kind, column, *named(score))


def by_name(belief: Belief, kind: str) -> Scores:
    """Likeness of names to those of joints; numbers alone are no likeness, as they may start at zero or one.

    A column that never changes needs the joint's exact name.
    """
    shifted, exact, scores = _shifted(belief), exact_names(belief.axes, (kind,)), Scores()
    for name, about, joint, own in _open(belief, kind, shifted):
        if exact.get(name) == joint:
            scores[name, joint] = EXACT
        elif not about.shares_numbers_alone(own):
            like = likeness(about, own) * _fits(about, kind)
            if name in belief.log.columns or like >= 0.99:
                scores[name, joint] = like
    return scores


def by_number(belief: Belief, kind: str) -> Scores:
    """Likeness of columns outside series that have the number of a joint and its position; or the only ones there are.

    Series are compared with the model before, as their numbers may start elsewhere; not so those named like positions
    that have their joints' exact names.
    """
    log, scores, positions = belief.log, Scores(), belief.of("position")
    exact = exact_names(belief.axes, ("position",))
    sure = {words(x.column).core for x in positions.values() if exact.get(x.column) == x.joint}
    series = (name for each in families(log.names) if len(each.names) > 1 for name in each.names)
    beside = {name for name in series if words(name).core not in sure}
    pairs = [pair for pair in _open(belief, kind, beside) if pair[0] in log.columns]
    bare = {name for name, about, *_ in pairs if about.kind == kind and about.measured and not about.numbers}
    for name, about, joint, own in pairs:
        like = likeness(about, own) * _fits(about, kind)
        same = joint not in positions or positions[joint].about.numbers == about.numbers
        if bare == {name} and len(belief.kinds) == 1:
            scores[name, joint] = max(like, LIKE)
        elif about.shares_numbers_alone(own) and same and about.measured and set(own.core) <= set(about.core):
            scores[name, joint] = like
    return scores


def _by_following(belief: Belief, _: str) -> Scores:
    """Scores of commanded positions of joints without a torque: by name or number like the position that follows."""
    log, own, scores = belief.log, _of_joints(belief.axes), Scores()
    free = {name: words(name) for name in belief.free if name in log.columns}
    free = {n: x for n, x in free.items() if x.kind in ("position", "") and (x.commanded or "u" in x.core)}
    positions = [x for x in belief.of("position").values() if x.column in log.columns]
    for joint, position in ((x.joint, x) for x in positions if x.joint not in belief.of("torque")):
        q, numbers = log.columns[position.column], position.about.numbers
        for name, about in free.items():
            u = log.columns[name]
            like = likeness(about, own[joint]) * (not about.shares_numbers_alone(own[joint]))
            like = max(like, 0.0, LIKE * (about.numbers == numbers and bool(numbers)))
            score = EXACT if name == COMMAND.format(joint) else min(1.0, like + 0.2)
            # Controllers call torques u as well.
            alike = about.commanded or 0.5 < np.std(u) / np.std(q) < 2
            if alike and abs(np.corrcoef(u, q)[0, 1]) > 0.8:
                scores[name, joint] = max(score, LIKE * (len(belief.axes) == 1))
    return scores


def by_derivative(belief: Belief, positions: Mapping[str, str], taken: Collection[str]) -> Scores:
    """Scores of free columns, except some, that may be derivatives of positions; two where a name says velocity."""
    log, scores = belief.log, Scores()
    free = [name for name in belief.free if name in log.columns and name not in taken]
    rates = {name: words(name).kind for name in free if words(name).measured and words(name).kind in ("velocity", "")}
    for joint, own in zip(positions, log.are_rates(list(positions.values()), list(rates)), strict=True):
        for (name, kind), is_rate in zip(rates.items(), own, strict=True):
            scores[name, joint] = is_rate * (1.0 + (kind != ""))
    return scores


def _open(belief: Belief, kind: str, beside: set[str]) -> Iterator[tuple[str, Words, str, Words]]:
    """Pairs of free columns, except some, and joints that lack a quantity, each with its words."""
    own, about, there = _of_joints(belief.axes), _about(belief, kind), belief.of(kind)
    names = [name for name in belief.free if name not in beside]
    for joint in (joint for joint in belief.axes if joint not in there and joint not in belief.undecided):
        yield from ((name, about[name], joint, own[joint]) for name in names)


def _about(belief: Belief, kind: str) -> dict[str, Words]:
    """Words of all columns, without a robot's name before those of a quantity, unless it is that of the other side."""
    about = {name: words(name) for name in belief.log.names}
    those = {name: each for name, each in about.items() if each.kind and _fits(each, kind)}
    of_joints = {side for joint in belief.axes for side in words(joint).sides}
    bare = those if of_joints - {side for each in those.values() for side in each.sides} else without_prefix(those)
    return about | bare


def _fits(about: Words, kind: str) -> bool:
    """True where words of a name are compatible with a quantity."""
    return about.kind in FITTING.get(kind, (kind,))


def _of_joints(joints: Sequence[str]) -> dict[str, Words]:
    """Words of the joints' names without a common prefix; all words if nothing else is left."""
    about = {joint: words(joint) for joint in joints}
    return without_prefix({joint: each if each.core else Words((joint.lower(),)) for joint, each in about.items()})


def exact_names(joints: Iterable[str], kinds: Iterable[str] = KINDS) -> dict[str, str]:
    """Joints by the names of columns that `read_log` knows."""
    return {pattern.format(joint): joint for joint in joints for kind in kinds for pattern in KINDS[kind]}


def _shifted(belief: Belief) -> set[str]:
    """Columns of families that are named exactly like joints, but whose numbers start elsewhere.

    Columns and joints each have numbers that the other lacks.
    """
    numbers = {joint: {*each.numbers} for each in families(belief.axes) for joint in each.names}
    exact, out = exact_names(numbers), set[str]()
    for own in families(belief.log.names):
        of_joints = [numbers[exact[name]] for name in own.names if name in exact]
        if any({*own.numbers} - those and those - {*own.numbers} for those in of_joints):
            out |= {*own.names}
    return out


def is_named_after(name: str, joints: Mapping[str, str]) -> bool:
    """True where a possible wrench component is named like a joint, as `/jointset/hip/tx/value` or a slide's force."""
    about = words(name)
    likes = {joint: likeness(about, each) for joint, each in _of_joints(list(joints)).items()}
    slides = [likes[joint] for joint, kind in joints.items() if kind == "slide"]
    return (about.kind == "position" and any(like > LIKE for like in likes.values())) or any(x > 0.9 for x in slides)


def add_commands(belief: Belief) -> None:
    """Adds commanded positions, in the units of their names or of the positions that follow them."""
    add_assigned(belief, _by_following, ("command",))
    log, positions = belief.log, belief.of("position")
    for joint, x in belief.of("command").items():
        stated = (unit_of(f"{kind} position", x.about.unit) for kind in ("hinge", "slide"))
        x.unit = next(filter(None, stated), "") or positions[joint].unit
        u, q = log.columns[x.column], log.columns[positions[joint].column]
        x.gain = positions[joint].gain * float(np.sign(np.corrcoef(u, q)[0, 1]))
        x.why.append("the position follows it; without a position actuator in the model it needs kp beside it")
        if any(not group.is_inner for group in belief.groups.values()):
            x.sure = DOUBTFUL
            x.why.append("a wrench is measured, so that the servo need not be trusted")


def add_predicted(belief: Belief) -> None:
    """Adds the ground's wrench, or else torques, if none is known: columns that the model's predictions explain."""
    joints, (_, names) = belief.mechanism.joints, candidates(belief)
    moving = all(belief.values(joint, "position") is not None for joint in joints)
    known = belief.torques_undecided or belief.undecided or belief.groups or belief.of("torque")
    if known or not moving or not names or not joints or not belief.can_predict:
        return
    model = ComparedModel.of(belief)
    like, channels = model.likeness(names, model.predicted(model.states_of({})))

    def matched(wanted: Sequence[str]) -> dict[str, tuple[str, float]]:
        """Columns by channel with the largest sum of squared correlations, each with its own."""
        every = {(n, c): float(like[i, k]) for i, n in enumerate(names) for k, c in enumerate(channels) if c in wanted}
        return {channel: (name, score) for (name, channel), score in assigned(every).items() if score > AGREES}

    wrench = matched(COMPONENTS) if belief.held else {}
    if len(wrench.keys() & set(COMPONENTS[:3])) > 1:
        columns = {component: column for component, (column, _) in wrench.items()}
        least = explained(1 - min(share for _, share in wrench.values()))
        group = belief.groups[GROUND] = ColumnGroup(GROUND, {})
        for key, part in (("force", COMPONENTS[:3]), ("torque", COMPONENTS[3:])):
            _fill(columns, part, belief)
            why = f"the model explains {least} of its variance or more"
            group.entries[key] = TableEntry([columns.get(c, "") for c in part], why)
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


def candidates(belief: Belief, number: int = 0) -> tuple[list[str], list[str]]:
    """Columns that may be positions of some number of joints, and all that are no derivatives of others."""
    free = [name for name in belief.free if name in belief.log.columns and words(name).measured]
    rates = {free[b]: free[a] for a, b in np.argwhere(belief.log.are_rates(free, free)) if a != b}
    others = [name for name in free if name not in rates]
    # A column with a derivative is a position; without any such pair all columns may be.
    roots = [name for name in others if name in rates.values()] or free
    return (roots if len(roots) >= number else others), others


def add_poses(belief: Belief, base: str | None) -> None:
    """Adds columns of ball joints, and of a moving base.

    Args:
        belief: The belief to extend.
        base: Name of the body whose frame is {0}; None if the base does not move.
    """
    groups = _grouped(belief, TURNS, "wxyz")
    norms = {rest: np.linalg.norm(belief.log.table(names), axis=1) for rest, names in groups.items()}
    groups = {rest: names for rest, names in groups.items() if (np.abs(norms[rest] - 1) < UNIT).all()}
    balls = [joint for joint in belief.kinds if joint not in belief.axes]
    for own in decisions({(rest, ball): likeness(words(rest), words(ball)) for rest in groups for ball in balls}):
        if own.columns:
            belief.ask(f"The orientation of '{own.joint}' may be in {' or in '.join(own.columns)}.")
            continue
        why, sure = named(own.score)
        entry = TableEntry(groups.pop(own.column), f"{why}, with a norm of one", sure)
        belief.poses[f"joints.{own.joint}"] = ColumnGroup(own.joint, {"position": entry})
    if base is not None and belief.held:
        _add_base(belief, groups, base)


def _add_base(belief: Belief, groups: Mapping[str, list[str]], base: str) -> None:
    """Adds the poses of the base, if one quaternion named like it has a position beside it."""
    log, places = belief.log, _grouped(belief, MOVES, "xyz")
    alike = [rest for rest in groups if BASES.search(rest) or likeness(words(rest), words(base)) >= LIKE]
    bases = [rest for rest in alike if rest in places and not log.columns.keys().isdisjoint(groups[rest])]
    if len(bases) > 1:
        belief.ask(f"The poses of the base may be those of {' or of '.join(bases)}.")
    for rest in bases if len(bases) == 1 else ():
        position, entries = places[rest], {"position": TableEntry(places[rest], "beside the quaternion")}
        if not log.states_unit(position):
            size, stated = max(map(log.largest, position)), unit_of("length", words(position[0]).unit)
            unit = stated or ("mm" if size > LONGEST else "m")
            why = "by its name" if stated else f"it goes to {size:.3g}"
            entries["unit"] = TableEntry(unit, why)
        entries["quaternion"] = TableEntry(groups[rest], "named like the base, with a norm of one")
        belief.poses[BASE] = ColumnGroup(BASE, entries)


def _grouped(belief: Belief, between: str, components: str) -> dict[str, list[str]]:
    """Columns of vectors with all components, in order, by the common part of their names."""
    groups: dict[tuple[str, str], dict[str, str]] = {}
    for name in belief.log.names:
        bare = without_unit(name)[0].strip()
        if match := re.fullmatch(rf"(.*?)[\W_]*{between}[\W_]*([{components}])", bare, re.IGNORECASE):
            groups.setdefault((match[1], bare[: match.start(2)]), {}).setdefault(match[2].lower(), name)
    return {rest: [own[c] for c in components] for (rest, _), own in groups.items() if own.keys() == set(components)}
