"""Columns of joints, by name and as derivatives of one another, and their units."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from experiments.guesses.belief import LIKELY, SURE, Belief, Quantity
from experiments.guesses.families import families, is_shifted
from experiments.guesses.log_contents import LogContents
from experiments.guesses.words import LIKE, NEAR, Words, likeness, shares_numbers_alone, unit_of, without_prefix, words
from ident.files.column import CURRENT, KINDS, UNITS
from ident.recordings.plausibility import rate_factor

ROUND = 2 * np.pi + 0.5
"""Largest angle of a joint that is plausible in radians."""

LONG = 20.0
"""Largest travel of a slide that is plausible in metres."""


def add_named(belief: Belief, contents: LogContents, joints: Sequence[str], taken: Sequence[str] = ()) -> None:
    """Adds the columns that are named like joints, if unambiguous.

    Numbers alone are ambiguous, since they may start at zero or one: `add_aligned` aligns whole series of them,
    `add_numbered` the remaining columns.

    Args:
        belief: The belief to extend.
        contents: The log.
        joints: The joints in question.
        taken: Columns that hold something else.
    """
    own = _of_joints(joints)
    shifted = _shifted(contents.names, joints)
    for kind, patterns in KINDS.items():
        split = {name: words(name) for name in contents.names if name not in (*taken, *shifted, *belief.columns)}
        exact = {pattern.format(joint): joint for joint in joints for pattern in patterns}
        likes = {
            (name, joint): 1.01 if exact.get(name) == joint else likeness(about, own[joint])
            for name, about in split.items()
            for joint in joints
            if exact.get(name) == joint or (_fits(about, kind) and not shares_numbers_alone(about, own[joint]))
        }
        # A constant column is accepted by its exact name only.
        likes = {pair: like for pair, like in likes.items() if pair[0] in contents.columns or like >= 0.99}
        _add_best(belief, {pair: like for pair, like in likes.items() if like >= LIKE}, kind, contents.constant)


def add_numbered(belief: Belief, contents: LogContents, joints: Sequence[str], taken: Sequence[str] = ()) -> None:
    """Adds columns outside series that share the number of a joint and its position; arguments as for `add_named`."""
    own = _of_joints(joints)
    series = {name for each in families(contents.names) if len(each.names) > 1 for name in each.names}
    for kind in KINDS:
        names = [name for name in contents.columns if name not in (*taken, *series, *belief.columns)]
        there, positions = belief.of(kind), belief.of("position")
        likes = {
            (name, joint): likeness(about, own[joint])
            for name, about in ((name, words(name)) for name in names)
            for joint in joints
            if joint not in there
            and joint not in belief.undecided
            and _fits(about, kind)
            and not about.commanded
            and shares_numbers_alone(about, own[joint])
            and set(own[joint].core) <= set(about.core)
            and (joint not in positions or words(positions[joint].column).numbers == about.numbers)
        }
        _add_best(belief, {pair: like for pair, like in likes.items() if like >= LIKE}, kind, {})


def _fits(about: Words, kind: str) -> bool:
    """True where words of a name are compatible with a quantity."""
    return about.kind in {"position": ("position", ""), "torque": ("torque", "current")}.get(kind, (kind,))


def _of_joints(joints: Sequence[str]) -> dict[str, Words]:
    """Words of the joints' names without a common prefix; all words if nothing else is left."""
    about = [words(joint) for joint in joints]
    about = [each if each.core else Words((joint.lower(),)) for joint, each in zip(joints, about, strict=True)]
    return dict(zip(joints, without_prefix(about), strict=True))


def _shifted(names: Sequence[str], joints: Sequence[str]) -> set[str]:
    """Columns of families that are named exactly like joints, but whose numbers start elsewhere."""
    place = {joint: (each, number) for each in families(joints) for number, joint in each.members}
    exact = {pattern.format(joint): joint for joint in place for those in KINDS.values() for pattern in those}
    out = set[str]()
    for each in families(names):
        hit = {place[exact[name]][0].template: place[exact[name]][0] for name in each.names if name in exact}
        if any(is_shifted(each.numbers, own.numbers) for own in hit.values()):
            out |= set(each.names)
    return out


def is_named_after(name: str, joints: Sequence[str]) -> bool:
    """True where a possible wrench component is named like a joint, as `/jointset/hip/tx/value`."""
    about = words(name)
    return about.kind == "position" and any(likeness(about, each) > LIKE for each in _of_joints(joints).values())


def _add_best(belief: Belief, likes: dict[tuple[str, str], float], kind: str, constant: Collection[str]) -> None:
    """Assigns pairs of column and joint in the order of likeness; none if another is as likely."""
    while likes:
        name, joint = max(likes, key=lambda pair: likes[pair])
        like = likes[name, joint]
        columns = [c for c, j in likes if j == joint and likes[c, j] > like - NEAR]
        others = [j for c, j in likes if c == name and likes[c, j] > like - NEAR]
        if len(columns) > 1 and like <= 1:
            belief.open.append(f"The {kind} of '{joint}' may be in {' or in '.join(columns)}.")
            belief.undecided |= {joint} if kind == "position" else set()
        elif len(others) > 1 and like <= 1:
            belief.open.append(f"Column '{name}' may be the {kind} of {' or of '.join(others)}.")
            belief.undecided |= set(others) if kind == "position" else set()
        else:
            sure, why = (SURE, "named so") if like >= 0.99 else (LIKELY, f"named alike ({100 * like:.0f} %)")
            quantity = Quantity(joint, kind, name, sure, [why])
            if name in constant and kind != "position":
                quantity = Quantity(joint, kind, "", SURE, [f"'{name}' never changes"])
            belief.quantities[quantity.key] = quantity
            columns, others = [name], [joint]
        likes = {(c, j): x for (c, j), x in likes.items() if c not in columns and j not in others}


def set_units(belief: Belief, contents: LogContents, kinds: Mapping[str, str]) -> list[str]:
    """Sets units of positions by the file, their names and their size.

    Args:
        belief: The belief whose positions get units.
        contents: The log.
        kinds: `hinge` or `slide` for each joint.

    Returns:
        Joints with angles whose unit was chosen by size alone.
    """
    left: list[Quantity] = []
    for joint, quantity in belief.of("position").items():
        stated = unit_of(f"{kinds[joint]} position", words(quantity.column).unit)
        if quantity.column in contents.units:
            quantity.why.append("the file knows its unit")
        elif stated:
            quantity.unit = stated
            quantity.why.append(f"{stated} by its name")
        else:
            left.append(quantity)
    for kind, limit, larger, usual in (("hinge", ROUND, "deg", "rad"), ("slide", LONG, "mm", "m")):
        those = [quantity for quantity in left if kinds[quantity.joint] == kind and quantity.column in contents.columns]
        sizes = [np.abs(contents.columns[quantity.column]).max() for quantity in those]
        # A program has one unit for all angles.
        unit = larger if max(sizes, default=0) > limit else usual
        for quantity, size in zip(those, sizes, strict=True):
            quantity.unit = unit
            by_another = "" if size > limit or unit == usual else f", and another to {max(sizes):.3g}"
            quantity.why.append(f"{unit} since it goes to {size:.3g}{by_another}")
    return [x.joint for x in left if kinds[x.joint] == "hinge" and x.column in contents.columns]


def set_rates(belief: Belief, contents: LogContents, kinds: Mapping[str, str]) -> None:
    """Sets units and signs of velocities and accelerations as derivatives; drops columns that are no derivatives."""
    for kind, of in (("velocity", "position"), ("acceleration", "velocity")):
        for joint, quantity in belief.of(kind).items():
            x = _position_or_rate(belief, contents, kinds, joint, of)
            dx = contents.columns.get(quantity.column)
            if x is None or dx is None:
                continue
            choices = UNITS[f"{kinds[joint]} {kind}"]
            stated = unit_of(f"{kinds[joint]} {kind}", words(quantity.column).unit)
            of_file = _factor(contents, quantity.column, quantity.unit, f"{kinds[joint]} {kind}")
            factor = rate_factor(contents.time, x, dx)
            fits = {unit: factor * c for unit, c in choices.items() if 0.8 < abs(factor * c) < 1.25}
            if quantity.column in contents.units:
                fits = {"": factor * of_file} if 0.8 < abs(factor * of_file) < 1.25 else {}
            if not fits:
                quantity.why = [f"it is {factor:.3g} times the derivative" if factor else "it is not the derivative"]
                belief.notes.append(
                    f"Column '{quantity.column}' is named like the {kind} of '{joint}', but {quantity.why[0]} of what "
                    f"is taken for its {of}; it is left out."
                )
                quantity.column, quantity.sure = "", SURE
                continue
            quantity.unit = stated if stated in fits else next(iter(fits))
            ratio = fits[quantity.unit]
            quantity.gain = -1.0 if ratio < 0 else 1.0
            quantity.why.append(
                f"{ratio:.2f} times the derivative of the {of}" + (f" in {quantity.unit}" * bool(quantity.unit))
            )
            quantity.sure = SURE


def _position_or_rate(
    belief: Belief, contents: LogContents, kinds: Mapping[str, str], joint: str, kind: str
) -> np.ndarray | None:
    """A joint's position or velocity in SI units; the velocity by differentiation if it has no column (N,)."""
    quantity = belief.of(kind).get(joint)
    if quantity and quantity.column in contents.columns:
        return contents.columns[quantity.column] * quantity.gain * factor(contents, quantity, kinds)
    if kind == "velocity" and (x := _position_or_rate(belief, contents, kinds, joint, "position")) is not None:
        return np.gradient(x, contents.time)
    return None


def position(belief: Belief, contents: LogContents, kinds: Mapping[str, str], joint: str) -> np.ndarray | None:
    """A joint's position in rad or m at the common times (N,); None if no column that changes has it."""
    return _position_or_rate(belief, contents, kinds, joint, "position")


def _factor(contents: LogContents, column: str, unit: str, quantity: str) -> float:
    """Factor from a column's unit, its own or the file's, to the SI unit."""
    if unit:
        return UNITS[quantity][unit]
    of_file = next((u for u in UNITS[quantity] if contents.units.get(column) == "deg" and u.startswith("deg")), None)
    return UNITS[quantity][of_file] if of_file else 1.0


def factor(contents: LogContents, quantity: Quantity, kinds: Mapping[str, str]) -> float:
    """Factor from the unit of a joint's quantity to the SI unit."""
    return _factor(contents, quantity.column, quantity.unit, f"{kinds[quantity.joint]} {quantity.kind}")


def is_current(quantity: Quantity) -> bool:
    """True where the name of a torque column says that it is a motor current."""
    about = words(quantity.column)
    return about.kind == "current" or about.unit in CURRENT
