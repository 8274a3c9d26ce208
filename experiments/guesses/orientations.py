"""Quaternion columns of ball joints, and poses of a moving base, by names and norm."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from experiments.guesses.belief import LIKELY, SURE, Belief, Entry, Group
from experiments.guesses.log_contents import LogContents
from experiments.guesses.units import LONG
from experiments.guesses.words import LIKE, NEAR, likeness, unit_of, without_unit, words

TURNS = r"(?:quaternion|quat|orientation|rotation|rot|position|pos|q)?"
MOVES = r"(?:position|pos|translation|trans|p|t)?"
"""Words between the name of a group of columns and its component."""

BASES = re.compile(r"pelvis|base|root|trunk|torso|float", re.IGNORECASE)
"""Names of bodies that move freely."""

UNIT = 0.01
"""Largest deviation of a quaternion's norm from one."""

BASE = "base"
"""Table of a mapping with the poses of the base."""


def add_orientations(belief: Belief, contents: LogContents, balls: Sequence[str], base: str | None) -> None:
    """Adds columns of ball joints, and of a moving base.

    Args:
        belief: The belief to extend.
        contents: The log.
        balls: Ball joints.
        base: Name of the body whose frame is {0}; None if the base does not move.
    """
    groups = {
        rest: names for rest, names in _grouped(contents, TURNS, "wxyz").items() if _is_quaternion(contents, names)
    }
    likes = {(rest, ball): likeness(words(rest), words(ball)) for rest in groups for ball in balls}
    while likes and max(likes.values()) >= LIKE:
        rest, ball = max(likes, key=lambda pair: likes[pair])
        like = likes[rest, ball]
        if rivals := [r for r, b in likes if b == ball and r != rest and likes[r, b] > like - NEAR]:
            belief.open.append(f"The orientation of '{ball}' may be in {' or in '.join([rest, *rivals])}.")
        else:
            why = "named so, with a norm of one" if like >= 0.99 else f"named alike ({100 * like:.0f} %), norm one"
            entry = Entry(groups[rest], why, SURE if like >= 0.99 else LIKELY)
            belief.poses[f"joints.{ball}"] = Group(ball, {"position": entry})
            groups.pop(rest)
        likes = {(r, b): x for (r, b), x in likes.items() if b != ball and r in groups}
    if base is not None:
        _add_base(belief, contents, groups, base)


def _add_base(belief: Belief, contents: LogContents, groups: Mapping[str, list[str]], base: str) -> None:
    """Adds the poses of the base, if one quaternion named like it has a position beside it."""
    places = _grouped(contents, MOVES, "xyz")
    named = [rest for rest in groups if BASES.search(rest) or likeness(words(rest), words(base)) >= LIKE]
    bases = [rest for rest in named if rest in places and any(name in contents.columns for name in groups[rest])]
    if len(bases) > 1:
        belief.open.append(f"The poses of the base may be those of {' or of '.join(bases)}.")
    if len(bases) != 1:
        return
    (rest,) = bases
    group = Group(BASE, {"position": Entry(places[rest], "beside the quaternion")})
    if not any(name in contents.units for name in places[rest]):
        size = max(float(np.abs(_column(contents, name)).max()) for name in places[rest])
        stated = unit_of("length", words(places[rest][0]).unit)
        group.entries["unit"] = Entry(
            stated or ("mm" if size > LONG else "m"), "by its name" if stated else f"it goes to {size:.3g}"
        )
    group.entries["quaternion"] = Entry(groups[rest], "named like the base, with a norm of one")
    belief.poses[BASE] = group


def _grouped(contents: LogContents, between: str, components: str) -> dict[str, list[str]]:
    """Columns of vectors with all components, in order, by the common part of their names."""
    groups: dict[tuple[str, str], dict[str, str]] = {}
    for name in contents.names:
        bare = without_unit(name)[0].strip()
        if match := re.fullmatch(rf"(.*?)[\W_]*{between}[\W_]*([{components}])", bare, re.IGNORECASE):
            groups.setdefault((match[1], bare[: match.start(2)]), {}).setdefault(match[2].lower(), name)
    return {rest: [own[c] for c in components] for (rest, _), own in groups.items() if own.keys() == set(components)}


def _is_quaternion(contents: LogContents, names: Sequence[str]) -> bool:
    norm = np.linalg.norm([_column(contents, name) for name in names], axis=0)
    return bool((np.abs(norm - 1) < UNIT).all())


def _column(contents: LogContents, name: str) -> np.ndarray:
    """A column at the common times, also a constant one (N,)."""
    return contents.columns.get(name, np.full(len(contents.time), contents.constant.get(name, 0.0)))
