"""Quaternion columns of ball joints, and poses of a moving base, by names and norm."""

import re
from collections.abc import Mapping

import numpy as np

from experiments.guesses.belief import BASE, LIKELY, SURE, Belief, ColumnGroup, TableEntry
from experiments.guesses.names import decisions
from experiments.guesses.units import LONG
from experiments.guesses.words import LIKE, likeness, unit_of, without_unit, words

TURNS = r"(?:quaternion|quat|orientation|rotation|rot|position|pos|q)?"
MOVES = r"(?:position|pos|translation|trans|p|t)?"
"""Words between the name of a group of columns and its component."""

BASES = re.compile(r"pelvis|base|root|trunk|torso|float", re.IGNORECASE)
"""Names of bodies that move freely."""

UNIT = 0.01
"""Largest deviation of a quaternion's norm from one."""


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
