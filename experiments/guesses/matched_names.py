"""Columns of joints and of a moving base by name: scores of all pairs, and the assignment with the largest sum."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from experiments.guesses.belief import BASE, DOUBTFUL, LIKELY, SURE, Belief, ColumnGroup, TableEntry
from experiments.guesses.guessed_units import LONG
from experiments.guesses.words import (
    LIKE,
    NEAR,
    Family,
    Words,
    families,
    likeness,
    shares_numbers_alone,
    unit_of,
    without_prefix,
    without_unit,
    words,
)
from ident.estimation.recorded_motion import UNIT
from ident.files.column import COMMAND, KINDS

FITTING = {"position": ("position", ""), "torque": ("torque", "current", "force")}
"""Quantities that names may state of columns of a kind, if others than the kind."""

FOLLOWS = 0.8
"""Smallest correlation of a joint's commanded position with its position."""

ALONE = 0.7
"""Score of the only column of a quantity, for the only joint."""

Scores = dict[tuple[str, str], float]
"""Scores of columns for joints."""

TURNS = r"(?:quaternion|quat|orientation|rotation|rot|position|pos|q)?"

MOVES = r"(?:position|pos|translation|trans|p|t)?"
"""Words between the name of a group of columns and its component."""


def add_named(belief: Belief, *, numbered: bool = False) -> None:
    """Adds the columns that are named like joints, if unambiguous.

    Numbers alone are ambiguous, since they may start at zero or one: whole series of them are compared with the model,
    and then the remaining columns are added that share the number of a joint and its position.

    Args:
        belief: The belief to extend.
        numbered: True for columns outside series that share numbers alone, and for the only ones of the only joint.
    """
    log, joints, series = belief.log, belief.axes, families(belief.log.names)
    own, alone = _of_joints(joints), numbered and len(belief.kinds) == len(joints) == 1
    beside = {name for each in series if len(each.names) > 1 for name in each.names}
    beside = beside if numbered else _shifted(series, joints)
    for kind, patterns in KINDS.items():
        about, scores, positions = _about(belief, kind), Scores(), belief.of("position")
        exact = {} if numbered else {pattern.format(joint): joint for joint in joints for pattern in patterns}
        names = [name for name in belief.free if name not in beside]
        lone = [n for n in names if n in log.columns and _is_bare(about[n], kind)]
        for joint in (joint for joint in joints if joint not in belief.of(kind) and joint not in belief.undecided):
            for name in names:
                column, is_exact = about[name], exact.get(name) == joint
                score = 1.01 if is_exact else likeness(column, own[joint]) * _fits(column, kind)
                like = is_exact or shares_numbers_alone(column, own[joint]) == numbered
                if numbered and lone == [name] and alone:
                    like, score = True, max(score, ALONE)
                elif numbered:
                    same = joint not in positions or positions[joint].about.numbers == column.numbers
                    like = like and same and column.measured and set(own[joint].core) <= set(column.core)
                # A constant column is accepted by its exact name only.
                if like and (name in log.columns or (score >= 0.99 and not numbered)):
                    scores[name, joint] = score
        add_assigned(belief, scores, kind)


def _is_bare(about: Words, kind: str) -> bool:
    """True where a name states a measured quantity and no number."""
    return about.kind == kind and about.measured and not about.numbers


def _about(belief: Belief, kind: str) -> dict[str, Words]:
    """Words of all columns, without a robot's name before those of a quantity, unless it is that of the other side."""
    about = {name: words(name) for name in belief.log.names}
    those = {name: each for name, each in about.items() if each.kind and _fits(each, kind)}
    sides, stated = (
        {side for each in names for side in each.sides} for names in (map(words, belief.axes), those.values())
    )
    bare = {} if sides - stated else dict(zip(those, without_prefix(list(those.values())), strict=True))
    return about | bare


def add_commands(belief: Belief) -> None:
    """Adds commanded positions of joints without a torque: by name or number like the position, which follows them."""
    log, own = belief.log, _of_joints(belief.axes)
    positions = {j: x for j, x in belief.of("position").items() if j in belief.axes and x.column in log.columns}
    free = {name: words(name) for name in belief.free if name in log.columns}
    free = {n: about for n, about in free.items() if about.kind in ("position", "")}
    free, scores = {n: about for n, about in free.items() if about.commanded or "u" in about.core}, Scores()
    for joint in (joint for joint in positions if joint not in belief.of("torque")):
        q = log.columns[positions[joint].column]
        for name, about in free.items():
            u, numbers = log.columns[name], positions[joint].about.numbers
            like = max(likeness(about, own[joint]) * (not shares_numbers_alone(about, own[joint])), 0.0)
            like = max(like, ALONE * (about.numbers == numbers and bool(numbers)))
            score = 1.01 if name == COMMAND.format(joint) else min(1.0, like + 0.2)
            # Controllers call torques u as well.
            alike = about.commanded or 0.5 < np.std(u) / np.std(q) < 2
            if alike and abs(np.corrcoef(u, q)[0, 1]) > FOLLOWS:
                scores[name, joint] = max(score, ALONE * (len(belief.axes) == 1))
    add_assigned(belief, scores, "command")
    for joint, x in belief.of("command").items():
        stated = (unit_of(f"{kind} position", x.about.unit) for kind in ("hinge", "slide"))
        x.unit = next(filter(None, stated), "") or positions[joint].unit
        u, q = log.columns[x.column], log.columns[positions[joint].column]
        x.gain = positions[joint].gain * float(np.sign(np.corrcoef(u, q)[0, 1]))
        x.why.append("the position follows it; without a position actuator in the model it needs kp beside it")
        if any(not group.is_inner for group in belief.groups.values()):
            x.sure = DOUBTFUL
            x.why.append("a wrench is measured, so that the servo need not be trusted")


def _fits(about: Words, kind: str) -> bool:
    """True where words of a name are compatible with a quantity."""
    return about.kind in FITTING.get(kind, (kind,))


def _of_joints(joints: Sequence[str]) -> dict[str, Words]:
    """Words of the joints' names without a common prefix; all words if nothing else is left."""
    about = [words(joint) for joint in joints]
    about = [each if each.core else Words((joint.lower(),)) for joint, each in zip(joints, about, strict=True)]
    return dict(zip(joints, without_prefix(about), strict=True))


def exact_names(joints: Iterable[str]) -> dict[str, str]:
    """Joints by the names of columns that `read_log` knows."""
    return {pattern.format(joint): joint for joint in joints for patterns in KINDS.values() for pattern in patterns}


def _shifted(series: Sequence[Family], joints: Sequence[str]) -> set[str]:
    """Columns of families that are named exactly like joints, but whose numbers start elsewhere.

    Columns and joints each have numbers that the other lacks.
    """
    numbers, out = {joint: {*each.numbers} for each in families(joints) for joint in each.names}, set[str]()
    for name, joint in exact_names(numbers).items():
        for own in (each for each in series if name in each.names):
            if {*own.numbers} - numbers[joint] and numbers[joint] - {*own.numbers}:
                out |= {*own.names}
    return out


def is_named_after(name: str, joints: Mapping[str, str]) -> bool:
    """True where a possible wrench component is named like a joint, as `/jointset/hip/tx/value` or a slide's force."""
    about = words(name)
    likes = {joint: likeness(about, each) for joint, each in _of_joints(list(joints)).items()}
    slides = [likes[joint] for joint, kind in joints.items() if kind == "slide"]
    return (about.kind == "position" and any(like > LIKE for like in likes.values())) or any(x > 0.9 for x in slides)


def add_assigned(belief: Belief, scores: Scores, kind: str) -> None:
    """Adds the columns of a quantity with the largest sum of scores; asks where another assignment is as good."""
    for name, joint, score, columns, joints in decisions(scores):
        if columns or joints:
            may_be = f"The {kind} of '{joint}' may be in {' or in '.join(columns)}."
            may_be = may_be if columns else f"Column '{name}' may be the {kind} of {' or of '.join(joints)}."
            belief.ask(may_be, (joints or [joint]) if kind == "position" else ())
            continue
        sure, why = (SURE, "named so") if score >= 0.99 else (LIKELY, f"named alike ({100 * score:.0f} %)")
        still = name in belief.log.constant and kind != "position"
        belief.add(joint, kind, "" if still else name, f"'{name}' never changes" if still else why, sure)


def decisions(scores: Scores) -> Iterator[tuple[str, str, float, list[str], list[str]]]:
    """Columns and joints with the largest sum of scores, with the score of each pair.

    Yields also the columns, or else the joints, that may be meant as well; neither where no other sum is as large.
    """
    scores = {pair: score for pair, score in scores.items() if score >= LIKE}
    columns, joints = (list(dict.fromkeys(pair[k] for pair in scores)) for k in (0, 1))
    matrix = np.array([[scores.get((column, joint), 0.0) for joint in joints] for column in columns])
    best, pairs = assigned(matrix) if scores else (0.0, [])
    for i, k in pairs:
        score, forbidden = matrix[i, k], matrix.copy()
        forbidden[i, k] = 0.0
        next_best, other = assigned(forbidden)
        others = [c for c, to in other if to == k]
        near, owners = list[str](), list[str]()
        if score <= 1 and best - next_best < NEAR and others:
            near = [columns[c] for c in sorted({*np.flatnonzero(matrix[:, k] > score - NEAR).tolist(), *others})]
        elif score <= 1 and best - next_best < NEAR:
            owners = [joints[j] for j in np.flatnonzero(matrix[i] > score - NEAR)]
        yield columns[i], joints[k], score, near, owners


def assigned(scores: np.ndarray) -> tuple[float, list[tuple[int, int]]]:
    """Largest sum of scores, and the pairs of rows and columns that have it, without those of score zero."""
    pairs = [(int(i), int(k)) for i, k in zip(*linear_sum_assignment(-scores), strict=True) if scores[i, k] > 0]
    return float(sum(scores[pair] for pair in pairs)), pairs


BASES = re.compile(r"pelvis|base|root|trunk|torso|float", re.IGNORECASE)
"""Names of bodies that move freely."""


def add_orientations(belief: Belief, base: str | None) -> None:
    """Adds columns of ball joints, and of a moving base.

    Args:
        belief: The belief to extend.
        base: Name of the body whose frame is {0}; None if the base does not move.
    """
    groups = _grouped(belief, TURNS, "wxyz")
    norms = {rest: np.linalg.norm(belief.log.table(names), axis=1) for rest, names in groups.items()}
    groups = {rest: names for rest, names in groups.items() if (np.abs(norms[rest] - 1) < UNIT).all()}
    balls = [joint for joint in belief.kinds if joint not in belief.axes]
    likes = {(rest, ball): likeness(words(rest), words(ball)) for rest in groups for ball in balls}
    for rest, ball, like, rivals, _ in decisions(likes):
        if rivals:
            belief.ask(f"The orientation of '{ball}' may be in {' or in '.join(rivals)}.")
            continue
        why = "named so, with a norm of one" if like >= 0.99 else f"named alike ({100 * like:.0f} %), norm one"
        entry = TableEntry(groups.pop(rest), why, SURE if like >= 0.99 else LIKELY)
        belief.poses[f"joints.{ball}"] = ColumnGroup(ball, {"position": entry})
    if base is not None and belief.held:
        _add_base(belief, groups, base)


def _add_base(belief: Belief, groups: Mapping[str, list[str]], base: str) -> None:
    """Adds the poses of the base, if one quaternion named like it has a position beside it."""
    log, places = belief.log, _grouped(belief, MOVES, "xyz")
    named = [rest for rest in groups if BASES.search(rest) or likeness(words(rest), words(base)) >= LIKE]
    bases = [rest for rest in named if rest in places and not log.columns.keys().isdisjoint(groups[rest])]
    if len(bases) > 1:
        belief.ask(f"The poses of the base may be those of {' or of '.join(bases)}.")
    for rest in bases if len(bases) == 1 else ():
        position, entries = places[rest], {"position": TableEntry(places[rest], "beside the quaternion")}
        if not log.states_unit(position):
            size, stated = max(map(log.largest, position)), unit_of("length", words(position[0]).unit)
            unit, why = stated or ("mm" if size > LONG else "m"), "by its name" if stated else f"it goes to {size:.3g}"
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
