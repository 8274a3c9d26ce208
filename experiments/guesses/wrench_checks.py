"""Places, units, signs and axes of wrenches by the model's predictions."""

from collections.abc import Iterable, Mapping
from contextlib import suppress

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import DOUBTFUL, LIKELY, Belief, ColumnGroup, TableEntry
from experiments.guesses.model import AGREES, CLEAR, ENOUGH, ENOUGH_OF_WRENCHES, ComparedModel, explained, unexplained
from experiments.guesses.words import LIKE, likeness, words
from ident.errors import ExcitationError
from ident.estimation.equations import COMPONENTS, predicted_channels
from ident.estimation.preparation import Prepared
from ident.files.column import UNITS
from ident.judgement.checks import wrench_checks
from ident.payload.beyond_sensor import TURNED, weighed
from ident.recordings.wrench import GROUND

PARTS = {"force": slice(0, 3), "torque": slice(3, 6)}
"""Components of forces and of moments."""

UNIT_KEYS = {"force": "unit", "torque": "torque_unit"}
"""Keys of the units of forces and of moments."""


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
        key = next(kind for kind in PARTS if kind in group.entries)
        x, part = model.level(group.entries[key].value), PARTS[key]
        left = {body: unexplained(x, list(there.T[part])) for body, there in inside.items()}
        best, at_base = min(left, key=left.__getitem__, default=""), unexplained(x, list(ground.T[part]))
        ratio = size_ratio(x, ground[:, part])
        # Masses of models are wrong by less; of a payload of a tenth of the weight, in the base's axes, the model
        # explains .93.
        most = 5
        is_of_size = any(1 / most < ratio * factor < most for factor in UNITS[key].values())
        if not group.is_open:
            group.is_inner = 1 - left.get(str(group.entries["body"].value), 1.0) >= AGREES
        elif best and 1 - left[best] >= AGREES and left[best] < CLEAR * at_base:
            sizes = {body: size_ratio(_varying(x), _varying(inside[body][:, part])) for body in left}
            _carry(group, model, left, sizes)
        elif 1 - at_base < (ENOUGH if is_of_size else ENOUGH_OF_WRENCHES):
            shares = f"{explained(at_base)} of it as the ground's, and {explained(left.get(best, 1.0))}"
            ask_place(belief, group, f"The model explains {shares} as that of what '{best}' carries.")
        if group.is_inner:
            body = str(group.entries["body"].value)
            _turn_inner(group, model, inside[body])
            origin = "of the sensor in the frame of that body, m: its moments depend on it"
            if "torque" in group.entries:
                group.entries.setdefault("position", TableEntry([0.0, 0.0, 0.0], origin, LIKELY))
            whole = all(kind in group.entries and all(group.entries[kind].value) for kind in PARTS)
            if not whole or belief.of("torque") or any(not other.is_inner for other in belief.groups.values()):
                group.entries["body"].sure = DOUBTFUL
                use = "for `payload`" if whole else "without all six components, which `payload` needs"
                belief.notes.append(
                    f"The wrench '{group.name}' is that of what '{body}' carries. It stays a remark {use}, since "
                    "`identify` would take it for a contact."
                )


def ask_place(belief: Belief, group: ColumnGroup, why: str) -> None:
    """Leaves a wrench a remark, with a question on the place where it is measured."""
    group.entries["body"] = TableEntry("?", "the body beyond the sensor", DOUBTFUL)
    belief.ask(f"It is open where the wrench '{group.own_name}' is measured. {why}")
    _rename(belief, group)


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
    best, group.is_inner = min(left, key=left.__getitem__), True
    # Of bodies that are rigidly connected they differ by rounding.
    alike = [body for body in left if CLEAR * left[body] <= left[best] + 1e-6]
    rigid = [body for body in alike if model.mover(body) == model.mover(best)]
    namesakes = [body for body in alike if likeness(words(group.own_name), words(body)) >= LIKE]
    body = namesakes[0] if len(namesakes) == 1 else min(rigid, key=lambda body: abs(np.log(sizes[body])))
    why = f"the model explains {explained(left[body])} of it as the wrench of what '{body}' carries"
    is_one = len(namesakes) == 1 or len(rigid) == len(alike)
    group.entries["body"] = TableEntry(body, why, LIKELY if is_one else DOUBTFUL)
    if not is_one:
        model.belief.ask(f"The wrench '{group.own_name}' may be that of what {' or '.join(alike)} carries.")
    _rename(model.belief, group)


def _turn_inner(group: ColumnGroup, model: ComparedModel, predicted: np.ndarray) -> None:
    """Sets units, sign and axes of a sensor's wrench by the model; its offsets do not matter."""
    for key, part in PARTS.items():
        if key in group.entries:
            measured = _varying(model.level(group.entries[key].value))
            _set_unit(model.belief, [group], key, size_ratio(measured, _varying(predicted[:, part])))
    if "force" not in group.entries:
        return
    with suppress(ExcitationError):
        force = model.level(group.entries["force"].value)
        # The direction of gravity decides, whatever the payload weighs.
        fit = weighed(np.hstack([force, 0 * force]), -predicted[:, :3])
        turned = fit.angle > TURNED and "rpy_deg" not in group.entries
        _set_turn(group, fit.rotation.T if turned else np.eye(3), "body", "gravity fits", opposite=fit.opposite)


def size_ratio(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Size of columns over that of the prediction."""
    return max(float(np.linalg.norm(measured)) / max(float(np.linalg.norm(predicted)), 1e-12), 1e-12)


def set_units_of_wrenches(belief: Belief, log: Prepared) -> bool:
    """Sets unknown units of forces and moments by their size, and returns True if one is not the SI unit."""
    predicted = predicted_channels(log.mechanism, log.samples.motion, log.frame)
    there, changed = np.stack([predicted[c] for c in COMPONENTS], axis=1), False
    for kind, part in PARTS.items():
        measured = log.wrench[:, part]
        known = np.isfinite(measured).all(axis=0)
        if known.any() and np.ptp(there[:, part][:, known]):
            ratio = size_ratio(measured[:, known], there[:, part][:, known])
            changed |= _set_unit(belief, belief.outer.values(), kind, ratio)
    return changed


def _set_unit(belief: Belief, groups: Iterable[ColumnGroup], kind: str, ratio: float) -> bool:
    """Sets the unit of forces or moments by their size, unless it is known, and returns True if it is not the SI unit.

    Args:
        belief: The belief, for a note on a size that no unit explains.
        groups: The wrenches.
        kind: `force` or `torque`.
        ratio: Size of the columns over what the model predicts in SI units.
    """
    key, choices = UNIT_KEYS[kind], UNITS[kind]
    sizes = {unit: ratio * choice for unit, choice in choices.items()}
    unit = min(sizes, key=lambda unit: abs(np.log(sizes[unit])))
    # Up to half way, as factors go, to the next unit, which is a thousand times as large.
    if not 1 / np.sqrt(1000) < sizes[unit] < np.sqrt(1000):
        belief.notes.append(
            f"The {kind}s have {ratio:.2g} times the size in {next(iter(choices))} that the model predicts, "
            "which no other unit explains."
        )
        return False
    changed, why = False, f"in {unit} it has {sizes[unit]:.2g} times the size that the model predicts"
    for entries in (group.entries for group in groups):
        columns = [name for k in (kind, "free_moment") if k in entries for name in entries[k].value]
        if key not in entries and any(columns) and not belief.log.states_unit(columns):
            entries[key] = TableEntry(unit, why)
            changed = choices[unit] != 1
    return changed


def set_axes(belief: Belief, log: Prepared) -> None:
    """Sets signs and right-angled turns of wrenches with which they are far closer to the predictions."""
    checks, base = wrench_checks(log)
    if base is not None:
        belief.notes.append(
            f"The ground's wrench fits far better in the frame of '{base.body}' (--base {base.body}): an error of "
            f"{100 * base.error_there:.0f} % rather than {100 * base.error:.0f} % of what the model predicts."
        )
        return
    for group, check in ((belief.groups[name], check) for name, check in checks.items() if name in belief.groups):
        off = f"{100 * check.error:.0f} %"
        if check.mirrored:
            _mirror(group.entries, check.mirrored)
        elif check.suspicious:
            why = f"{100 * check.error_turned:.0f} % of the prediction is off then, as it stands {off}"
            frame = "base" if group.name == GROUND else "body"
            _set_turn(group, check.rotation, frame, why, opposite=check.sign < 0)
        elif check.error > 0.3:
            belief.notes.append(
                f"The wrench '{group.name}' is off by {off} of what the model predicts, and no other sign or "
                "right-angled turn is far better; see where its sensor is, and what else acts."
            )
        elif first := group.entries.get("force") or group.entries.get("torque"):
            first.why += f"; sign and axes as the model has them ({off} off)"


def _mirror(entries: dict[str, TableEntry], components: Iterable[str]) -> None:
    """Gives columns of components that have the opposite sign alone a gain of -1."""
    for key, part in (("force", PARTS["force"]), ("torque", PARTS["torque"]), ("free_moment", PARTS["torque"])):
        wrong = [component for component in COMPONENTS[part] if component in components]
        if key in entries and wrong:
            names = zip(entries[key].value, COMPONENTS[part], strict=True)
            mirrored = [{"column": name, "gain": -1.0} if own in wrong and name else name for name, own in names]
            why = f"{', '.join(wrong)} mirrored, as the model predicts the opposite sign"
            entries[key] = TableEntry(mirrored, f"{entries[key].why}; {why}")


def _set_turn(group: ColumnGroup, rotation: np.ndarray, frame: str, why: str, *, opposite: bool) -> None:
    """Sets the sign and the axes of a wrench, at right angles if they are to 3°."""
    if opposite:
        group.entries["applied_to_link"] = TableEntry(False, f"the opposite sign: {why}")
    if not np.array_equal(rotation, np.eye(3)):
        angles = Rotation.from_matrix(rotation).as_euler("xyz", degrees=True)
        near = 90 * np.round(angles / 90)
        angles = np.where(np.abs(angles - near) < 3, near, angles).round(1) + 0.0
        group.entries["rpy_deg"] = TableEntry(angles.tolist(), f"its axes in those of the {frame}: {why}")
        # A frame that is not turned states no angles.
        if "frame" in group.entries:
            group.entries["frame"] = TableEntry("plate", "axes other than the world's")
            group.entries["position"] = TableEntry([0, 0, 0], "the world's origin")
