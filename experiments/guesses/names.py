"""Columns of joints by name: scores of all pairs, and the assignment with the largest sum."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from experiments.guesses.belief import DOUBTFUL, LIKELY, SURE, Belief, Quantity
from experiments.guesses.families import Family, families, is_shifted
from experiments.guesses.log_contents import LogContents
from experiments.guesses.words import LIKE, NEAR, Words, likeness, shares_numbers_alone, unit_of, without_prefix, words
from ident.files.column import COMMAND, KINDS

FITTING = {"position": ("position", ""), "torque": ("torque", "current", "force")}
"""Quantities that names may state of columns of a kind, if others than the kind."""

FOLLOWS = 0.8
"""Smallest correlation of a joint's commanded position with its position."""


def add_named(
    belief: Belief, contents: LogContents, joints: Sequence[str], taken: Sequence[str] = (), *, numbered: bool = False
) -> None:
    """Adds the columns that are named like joints, if unambiguous.

    Numbers alone are ambiguous, since they may start at zero or one: whole series of them are compared with the model,
    and then the remaining columns are added that share the number of a joint and its position.

    Args:
        belief: The belief to extend.
        contents: The log.
        joints: The joints in question.
        taken: Columns that hold something else.
        numbered: True for columns outside series that share numbers alone.
    """
    own, series = _of_joints(joints), families(contents.names)
    beside = {name for each in series if len(each.names) > 1 for name in each.names}
    beside = beside if numbered else _shifted(series, joints)
    sides = set[str]().union(*(words(joint).sides for joint in joints))
    for kind, patterns in KINDS.items():
        # All columns of a quantity may begin with the robot's name, unless it is that of the other side.
        those = [name for name in contents.names if _fits(words(name), kind) and words(name).kind]
        others = sides - set[str]().union(*(words(name).sides for name in those))
        bare = {} if others else dict(zip(those, without_prefix([words(name) for name in those]), strict=True))
        exact = {} if numbered else {pattern.format(joint): joint for joint in joints for pattern in patterns}
        scores, positions = dict[tuple[str, str], float](), belief.of("position")
        for name in (name for name in contents.names if name not in (*taken, *beside, *belief.columns)):
            about, changes = bare.get(name, words(name)), name in contents.columns
            for joint in (joint for joint in joints if joint not in belief.of(kind) and joint not in belief.undecided):
                score = 1.01 if exact.get(name) == joint else likeness(about, own[joint]) * _fits(about, kind)
                like = exact.get(name) == joint or shares_numbers_alone(about, own[joint]) == numbered
                if numbered:
                    same = joint not in positions or words(positions[joint].column).numbers == about.numbers
                    like = like and same and about.measured and set(own[joint].core) <= set(about.core)
                # A constant column is accepted by its exact name only.
                if like and (changes or (score >= 0.99 and not numbered)):
                    scores[name, joint] = score
        _add_best(belief, scores, kind, contents.constant)


def add_only(belief: Belief, contents: LogContents, joint: str, taken: Sequence[str]) -> None:
    """Adds the only column of a quantity, whose name states nothing else, for the only joint."""
    for kind in KINDS:
        names = [name for name in contents.columns if name not in (*taken, *belief.columns)]
        about = {name: words(name) for name in names}
        those = [n for n in names if about[n].kind == kind and about[n].measured and not about[n].numbers]
        if joint not in belief.of(kind) and joint not in belief.undecided and len(those) == 1:
            belief.add(Quantity(joint, kind, those[0], LIKELY, [f"the only {kind}, of the only joint"]))


def add_commands(belief: Belief, contents: LogContents, joints: Sequence[str]) -> None:
    """Adds commanded positions of joints without a torque: by name or number like the position, which follows them."""
    positions = {j: x for j, x in belief.of("position").items() if j in joints and x.column in contents.columns}
    free = {name: words(name) for name in contents.columns if name not in belief.columns}
    free = {n: about for n, about in free.items() if about.commanded or "u" in about.core}
    free = {n: about for n, about in free.items() if about.kind in ("position", "")}
    own, measured = _of_joints(joints), {joint: words(x.column) for joint, x in positions.items()}
    scores = dict[tuple[str, str], float]()
    for joint, x in positions.items():
        for name, about in free.items() if joint not in belief.of("torque") else ():
            like = max(likeness(about, own[joint]) * (not shares_numbers_alone(about, own[joint])), 0.0)
            same = about.numbers == measured[joint].numbers and bool(about.numbers)
            score = 1.01 if name == COMMAND.format(joint) else min(1.0, max(like, 0.7 * same) + 0.2)
            score = max(score, 0.7 * (len(joints) == 1))
            u, q = contents.columns[name], contents.columns[x.column]
            # Controllers call torques u as well.
            alike = about.commanded or 0.5 < np.std(u) / np.std(q) < 2
            if alike and abs(np.corrcoef(u, q)[0, 1]) > FOLLOWS:
                scores[name, joint] = score
    _add_best(belief, {pair: score for pair, score in scores.items() if score > 0.2}, "command", {})
    for joint, x in belief.of("command").items():
        stated = (unit_of(f"{kind} position", words(x.column).unit) for kind in ("hinge", "slide"))
        x.unit = next(filter(None, stated), "") or positions[joint].unit
        u, q = contents.columns[x.column], contents.columns[positions[joint].column]
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


def _shifted(series: Sequence[Family], joints: Sequence[str]) -> set[str]:
    """Columns of families that are named exactly like joints, but whose numbers start elsewhere."""
    place = {joint: (each, number) for each in families(joints) for number, joint in each.members}
    exact = {pattern.format(joint): joint for joint in place for those in KINDS.values() for pattern in those}
    out = set[str]()
    for each in series:
        hit = {place[exact[name]][0].template: place[exact[name]][0] for name in each.names if name in exact}
        if any(is_shifted(each.numbers, own.numbers) for own in hit.values()):
            out |= set(each.names)
    return out


def is_named_after(name: str, joints: Mapping[str, str]) -> bool:
    """True where a possible wrench component is named like a joint, as `/jointset/hip/tx/value` or a slide's force."""
    about = words(name)
    likes = {joint: likeness(about, each) for joint, each in _of_joints(list(joints)).items()}
    slides = [likes[joint] for joint, kind in joints.items() if kind == "slide"]
    return (about.kind == "position" and any(like > LIKE for like in likes.values())) or any(x > 0.9 for x in slides)


def _add_best(belief: Belief, scores: dict[tuple[str, str], float], kind: str, constant: Collection[str]) -> None:
    """Assigns columns to joints by the largest sum of scores; none where another assignment is as good."""
    scores = {pair: score for pair, score in scores.items() if score >= LIKE}
    if not scores:
        return
    columns, joints = (list(dict.fromkeys(pair[k] for pair in scores)) for k in (0, 1))
    matrix = np.array([[scores.get((column, joint), 0.0) for joint in joints] for column in columns])
    for i, k in _pairs(matrix):
        name, joint, score = columns[i], joints[k], matrix[i, k]
        forbidden = matrix.copy()
        forbidden[i, k] = 0.0
        other = _pairs(forbidden)
        is_tie = score <= 1 and _sum(matrix) - _sum(forbidden) < NEAR
        others = [c for c, to in other if to == k]
        near = [columns[c] for c in sorted({*np.flatnonzero(matrix[:, k] > score - NEAR).tolist(), *others})]
        if is_tie and others:
            belief.open.append(f"The {kind} of '{joint}' may be in {' or in '.join(near)}.")
            belief.undecided |= {joint} if kind == "position" else set()
        elif is_tie:
            likely = [joints[j] for j in np.flatnonzero(matrix[i] > score - NEAR)]
            belief.open.append(f"Column '{name}' may be the {kind} of {' or of '.join(likely)}.")
            belief.undecided |= set(likely) if kind == "position" else set()
        else:
            sure, why = (SURE, "named so") if score >= 0.99 else (LIKELY, f"named alike ({100 * score:.0f} %)")
            quantity = Quantity(joint, kind, name, sure, [why])
            if name in constant and kind != "position":
                quantity = Quantity(joint, kind, "", SURE, [f"'{name}' never changes"])
            belief.add(quantity)


def _pairs(scores: np.ndarray) -> list[tuple[int, int]]:
    """Assignment of rows to columns with the largest sum, without pairs of score zero."""
    return [(int(i), int(k)) for i, k in zip(*linear_sum_assignment(-scores), strict=True) if scores[i, k] > 0]


def _sum(scores: np.ndarray) -> float:
    return float(sum(scores[pair] for pair in _pairs(scores)))
