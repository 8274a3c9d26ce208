"""Columns with meaningless names: positions and wrenches, by the model's predictions of one from the other."""

from collections.abc import Sequence
from itertools import permutations
from math import perm

import numpy as np
from scipy.optimize import linear_sum_assignment

from experiments.guesses.belief import LIKELY, Belief, Entry, Group, Quantity
from experiments.guesses.joints import ROUND
from experiments.guesses.log_contents import LogContents
from experiments.guesses.predicted import Curves, curves, is_rate, prediction
from experiments.guesses.words import words
from ident.estimation.equations import COMPONENTS
from ident.files.column import UNITS
from ident.mechanism.mechanism import Mechanism
from ident.recordings.wrench import GROUND

MOST = 400
"""Largest number of assignments of columns to joints that are tried."""

CLEAR = 0.7
"""Ratio of the best assignment's unexplained share to the second's, above which the choice is open."""

DARK = 0.5
"""Largest unexplained share of the best assignment: wrong columns explain as much by chance."""

EXPLAINED = 0.8
"""Share of a column's variance above which a prediction is accepted for it."""


def add_unnamed(belief: Belief, contents: LogContents, mechanism: Mechanism, joints: Sequence[str], held: bool) -> None:
    """Adds positions of joints without columns, and a wrench or torques if no column is named so.

    Args:
        belief: The belief to extend.
        contents: The log.
        mechanism: The mechanism.
        joints: Its joints, each with one coordinate.
        held: True if something holds the base.
    """
    positions = belief.of("position")
    known = {joint: x.column for joint, x in positions.items() if x.column in contents.columns}
    lacking = [joint for joint in joints if joint not in positions]
    measured = [*belief.of("torque"), *belief.groups]
    still = [joint for joint in joints if joint not in known and joint not in lacking]
    if mechanism.prior is None or still or belief.undecided or not (lacking or not measured):
        return
    free = [name for name in contents.columns if name not in belief.columns and not words(name).commanded]
    rates = _rates(contents, free)
    # A column with a derivative is a position; without any such pair all columns may be.
    roots = [name for name in free if name in rates.values() and name not in rates] or free
    candidates = roots if len(roots) >= len(lacking) else [name for name in free if name not in rates]
    if lacking and (len(candidates) < len(lacking) or perm(len(candidates), len(lacking)) > MOST):
        if len(candidates) > len(lacking):
            belief.open.append(f"Too many columns may be positions to try the model on all: {', '.join(candidates)}.")
        return
    low = curves(contents, [*known.values(), *candidates])
    others = [name for name in free if name not in rates]
    if lacking and not _add_positions(belief, low, mechanism, known, lacking, candidates, others):
        return
    if not measured and not belief.torques_undecided:
        columns = {joint: quantity.column for joint, quantity in belief.of("position").items()}
        predicted = _predicted(belief, low, mechanism, joints, columns)
        free = [name for name in others if name not in belief.columns]
        _add_measured(belief, low, predicted, free, joints, contents.names, held)


def _rates(contents: LogContents, names: Sequence[str]) -> dict[str, str]:
    """Columns that are derivatives of others, in any unit, with these others."""
    return {rate: name for name in names for rate in names if rate != name and is_rate(contents, name, rate)}


def _unit(low: Curves, column: str) -> str:
    return "deg" if np.abs(low.levels[column]).max() > ROUND else "rad"


def _predicted(
    belief: Belief, low: Curves, mechanism: Mechanism, joints: Sequence[str], columns: dict[str, str]
) -> dict[str, np.ndarray]:
    """Channels that change, predicted by the model with these columns as positions."""
    hinge = {body.joint: bool(body.twist[3:].any()) for body in mechanism.tree.bodies if body.moves}
    named = belief.of("position")
    states = []
    for joint in joints:
        unit = named[joint].unit if joint in named else _unit(low, columns[joint])
        factor = UNITS["hinge position" if hinge[joint] else "slide position"].get(unit, 1.0)
        states.append(low.states[columns[joint]] * factor)
    every = prediction(mechanism, states)
    largest = max(float(np.ptp(x)) for x in every.values())
    return {name: x for name, x in every.items() if np.ptp(x) > 1e-6 * largest}


def _likeness(low: Curves, names: Sequence[str], predicted: dict[str, np.ndarray]) -> np.ndarray:
    """Squared correlations of columns with predicted channels."""
    if not names or not predicted:
        return np.zeros((len(names), len(predicted)))
    both = np.corrcoef(np.array([*(low.levels[n] for n in names), *predicted.values()]))
    return np.asarray(np.nan_to_num(both[: len(names), len(names) :]) ** 2)


def _add_positions(
    belief: Belief,
    low: Curves,
    mechanism: Mechanism,
    known: dict[str, str],
    lacking: Sequence[str],
    candidates: Sequence[str],
    others: Sequence[str],
) -> bool:
    """Adds the columns with which the model explains the others best, and returns True if they are clearly the best."""
    joints = mechanism.tree.joints
    measured = [name for group in belief.groups.values() for name in group.columns if name in low.levels]
    measured += [quantity.column for quantity in belief.of("torque").values() if quantity.column in low.levels]
    ways = []
    for chosen in permutations(candidates, len(lacking)):
        columns = known | dict(zip(lacking, chosen, strict=True))
        rest = measured or [name for name in others if name not in chosen]
        like = _likeness(low, rest, _predicted(belief, low, mechanism, joints, columns))
        ways.append((float(1 - like.max(axis=1, initial=0).mean()) if rest else 1.0, chosen))
    ways.sort()
    best, chosen = ways[0]
    second = ways[1][0] if len(ways) > 1 else 1.0
    if best > CLEAR * second or best > DARK:
        belief.open.append(
            f"Which columns are the positions of {', '.join(lacking)} is open: the model explains "
            f"{100 * (1 - best):.0f} % of the others with {', '.join(chosen)}, but "
            f"{100 * (1 - second):.0f} % with others of {', '.join(candidates)}."
        )
        return False
    for joint, column in zip(lacking, chosen, strict=True):
        why = f"with it the model explains {100 * (1 - best):.0f} % of the other columns, otherwise at most "
        quantity = Quantity(
            joint, "position", column, LIKELY, [why + f"{100 * (1 - second):.0f} %"], _unit(low, column)
        )
        belief.quantities[quantity.key] = quantity
    return True


def _add_measured(
    belief: Belief,
    low: Curves,
    predicted: dict[str, np.ndarray],
    names: Sequence[str],
    joints: Sequence[str],
    order: Sequence[str],
    held: bool,
) -> None:
    """Adds the ground's wrench, or else joint torques: the columns that the model's predictions explain."""
    wrench = _matched(low, names, {c: x for c, x in predicted.items() if c in COMPONENTS}) if held else {}
    if sum(component in COMPONENTS[:3] for component in wrench) > 1:
        columns = {component: column for component, (column, _) in wrench.items()}
        least = min(like for _, like in wrench.values())
        entries = {}
        for key, part in (("force", COMPONENTS[:3]), ("torque", COMPONENTS[3:])):
            _fill(columns, part, order, belief)
            listed = [columns.get(component, "") for component in part]
            entries[key] = Entry(
                listed, f"agrees with the model's prediction ({100 * least:.0f} % of the variance or more)"
            )
        belief.groups[GROUND] = Group(GROUND, entries)
        return
    for joint, (column, like) in _matched(low, names, {j: predicted[j] for j in joints if j in predicted}).items():
        why = f"agrees with the model's prediction ({100 * like:.0f} % of the variance)"
        belief.quantities[f"joints.{joint}.torque"] = Quantity(joint, "torque", column, LIKELY, [why])


def _matched(low: Curves, names: Sequence[str], predicted: dict[str, np.ndarray]) -> dict[str, tuple[str, float]]:
    """Columns of predicted channels, assigned by the largest sum of squared correlations, each with its own."""
    like = _likeness(low, names, predicted)
    pairs = zip(*linear_sum_assignment(-like), strict=True)
    channels = list(predicted)
    return {channels[k]: (names[i], float(like[i, k])) for i, k in pairs if like[i, k] > EXPLAINED}


def _fill(columns: dict[str, str], part: Sequence[str], order: Sequence[str], belief: Belief) -> None:
    """Adds the third component if two are in order in the file."""
    places = {k: order.index(columns[c]) - k for k, c in enumerate(part) if c in columns}
    missing = [k for k in range(3) if k not in places]
    if len(missing) == 1 and len(set(places.values())) == 1:
        place = missing[0] + next(iter(places.values()))
        taken = [*columns.values(), *belief.columns]
        if 0 <= place < len(order) and order[place] not in taken:
            columns[part[missing[0]]] = order[place]
            belief.notes.append(
                f"Column '{order[place]}' is taken for {part[missing[0]]} by its place alone: the model predicts none."
            )
