"""Places of wrenches by the model: at the base, or of a sensor beyond a joint; its units, sign and axes."""

from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from experiments.guesses.belief import DOUBTFUL, LIKELY, Belief, ColumnGroup, TableEntry
from experiments.guesses.model import ComparedModel, explained, unexplained
from experiments.guesses.series import AGREES, CLEAR, ENOUGH, ENOUGH_OF_WRENCHES
from experiments.guesses.words import LIKE, likeness, words
from experiments.guesses.wrenches import set_turn, set_unit, size_ratio
from ident.errors import ExcitationError
from ident.estimation.equations import COMPONENTS
from ident.payload.weight import TURNED, weighed

SIZE = 5.0
"""Largest ratio of sizes of the ground's wrench that the model explains in part: masses of models are wrong by less. Of
a payload of a tenth of the weight, in the base's axes, it explains .93."""

TINY = 1e-6
"""Difference of unexplained shares that is rounding, as of bodies that are rigidly connected."""


def place_wrenches(model: ComparedModel) -> None:
    """Decides by the model where a wrench is measured whose name does not say so: at the base, or beyond a joint.

    A sensor beyond a joint reads what it carries, in axes that move with it; other wrenches on bodies are contacts.
    """
    belief = model.belief
    groups = [group for group in belief.groups.values() if group.is_open or "body" in group.entries]
    if not groups:
        return
    states = model.states_of({})
    predicted, inside = model.predicted(states), model.wrenches(states)
    ground = np.stack([predicted[c] for c in COMPONENTS], axis=1)
    for group in groups:
        key, part = ("force", slice(0, 3)) if "force" in group.entries else ("torque", slice(3, 6))
        x = model.level(group.entries[key].value)
        left = {body: unexplained(x, list(there.T[part])) for body, there in inside.items()}
        best, at_base = min(left, key=lambda body: left[body], default=""), unexplained(x, list(ground.T[part]))
        if not group.is_open:
            group.is_inner = 1 - left.get(str(group.entries["body"].value), 1.0) >= AGREES
        elif best and 1 - left[best] >= AGREES and left[best] < CLEAR * at_base:
            sizes = {body: size_ratio(_varying(x), _varying(inside[body][:, part])) for body in left}
            _carry(group, model, left, sizes)
        elif 1 - at_base < (ENOUGH if _is_of_size(size_ratio(x, ground[:, part])) else ENOUGH_OF_WRENCHES):
            shares = f"{explained(at_base)} of it as the ground's, and {explained(left.get(best, 1.0))}"
            ask_place(belief, group, f"The model explains {shares} as that of what '{best}' carries.")
        if group.is_inner:
            body = str(group.entries["body"].value)
            _turn_inner(group, model, inside[body])
            if belief.of("torque") or any(not other.is_inner for other in belief.groups.values()):
                group.entries["body"].sure = DOUBTFUL
                belief.notes.append(
                    f"The wrench '{group.name}' is that of what '{body}' carries. It stays a remark for `payload`, "
                    "since `identify` would take it for a contact."
                )


def ask_place(belief: Belief, group: ColumnGroup, why: str) -> None:
    """Leaves a wrench a remark, with a question on the place where it is measured."""
    group.entries["body"] = TableEntry("?", "the body beyond the sensor", DOUBTFUL)
    belief.ask(f"It is open where the wrench '{group.own_name}' is measured. {why}")
    _rename(belief, group)


def _is_of_size(ratio: float) -> bool:
    """True where columns are about as large as the prediction, in some unit."""
    return any(1 / SIZE < ratio * unit < SIZE for unit in (1e-3, 1.0, 1e3))


def _varying(x: np.ndarray) -> np.ndarray:
    """Columns without their means, which a sensor's offsets are part of."""
    return np.asarray(x - x.mean(axis=0))


def _rename(belief: Belief, group: ColumnGroup) -> None:
    """Gives a wrench that is not the ground's its own name."""
    belief.groups.pop(group.name)
    group.name, group.is_open = group.own_name, False
    belief.groups[group.name] = group


def _carry(group: ColumnGroup, model: ComparedModel, left: Mapping[str, float], sizes: Mapping[str, float]) -> None:
    """Puts a wrench on the body beyond its sensor: named like it, or else of the likeliest weight."""
    best, group.is_inner = min(left, key=lambda body: left[body]), True
    alike = [body for body in left if CLEAR * left[body] <= left[best] + TINY]
    rigid = [body for body in alike if model.mover(body) == model.mover(best)]
    named = [body for body in alike if likeness(words(group.own_name), words(body)) >= LIKE]
    body = named[0] if len(named) == 1 else min(rigid, key=lambda body: abs(np.log(sizes[body])))
    why = f"the model explains {explained(left[body])} of it as the wrench of what '{body}' carries"
    is_one = len(named) == 1 or len(rigid) == len(alike)
    group.entries["body"] = TableEntry(body, why, LIKELY if is_one else DOUBTFUL)
    if not is_one:
        model.belief.ask(f"The wrench '{group.own_name}' may be that of what {' or '.join(alike)} carries.")
    _rename(model.belief, group)


def _turn_inner(group: ColumnGroup, model: ComparedModel, predicted: np.ndarray) -> None:
    """Sets units, sign and axes of a sensor's wrench by the model; its offsets do not matter."""
    for key, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        if key in group.entries:
            measured = _varying(model.level(group.entries[key].value))
            set_unit(model.belief, [group], key, size_ratio(measured, _varying(predicted[:, part])))
    if "force" not in group.entries:
        return
    with suppress(ExcitationError):
        force = model.level(group.entries["force"].value)
        # The direction of gravity decides, whatever the payload weighs.
        fit = weighed(np.hstack([force, 0 * force]), -predicted[:, :3])
        turned = fit.angle > TURNED and "rpy_deg" not in group.entries
        set_turn(group, fit.rotation.T if turned else np.eye(3), "body", "gravity fits", opposite=fit.opposite)
