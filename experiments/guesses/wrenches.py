"""Columns that are named like wrenches: their bodies by names, and places, units, signs and axes by the model."""

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import DOUBTFUL, LIKELY, OPEN, SETUP, SURE, Belief, ColumnGroup, TableEntry, named
from experiments.guesses.model import (
    CLEAR,
    ENOUGH,
    ENOUGH_OF_WRENCHES,
    SAME,
    ComparedModel,
    explained,
    unexplained,
)
from experiments.guesses.scores import exact_names, is_named_after
from experiments.guesses.words import (
    LIKE,
    Component,
    families,
    likeness,
    most_alike,
    unit_of,
    words,
    wrench_groups,
)
from ident.errors import ExcitationError
from ident.estimation.equations import COMPONENTS, predicted_channels
from ident.estimation.preparation import Prepared
from ident.files.table import CURRENT, UNITS
from ident.judgement.checks import wrench_checks
from ident.payload.beyond_sensor import TURNED, weighed
from ident.recordings.plates import AUTO
from ident.recordings.wrench import GROUND
from ident.tolerances import AGREES

FEET = re.compile(r"foot|calcn|feet|sole|heel", re.IGNORECASE)
"""Names of bodies that stand on the ground."""

GROUNDS = re.compile(r"ground|base|plate|floor", re.IGNORECASE)
"""Names of the wrench at the base."""

Parts = dict[Component, str]
"""Columns by component."""


PARTS = {"force": slice(0, 3), "torque": slice(3, 6)}
"""Components of forces and of moments."""

UNPLACED = 0.2
"""Standard deviation of the place of a sensor that nothing states, m: most flanges are 4 to 25 cm beyond the frame of
the last body."""


def add_wrenches(belief: Belief) -> None:
    """Adds the columns that are named like wrenches."""
    wrenches = dict[str, Parts]()
    for rest, parts in _by_names(belief):
        own = re.sub(r"\W+", "_", rest).strip("_")
        if same := next((other for other, those in wrenches.items() if _is_same(belief, parts, those)), None):
            belief.ask(f"The wrench '{own}' has the same force as '{same}', and is left out.")
        else:
            wrenches[own] = parts
    grounds = [own for own in wrenches if GROUNDS.search(own)]
    for k, (own, parts) in enumerate(wrenches.items(), start=1):
        site = _site(own, belief)
        is_ground = belief.held and not site and (len(wrenches) == 1 or grounds == [own])
        name = GROUND if is_ground else site or (own if own not in ("", GROUND) else f"wrench{k}")
        group = ColumnGroup(name, _entries(belief, parts), is_ground and grounds != [own], own_name=own or "sensor")
        if site:
            _mount(group, belief)
        elif not is_ground:
            _place(belief, group)
        elif "point" in group.entries:
            group.entries["frame"] = TableEntry("world", "a point of application rests in the world")
        belief.groups[name] = group


def _by_names(belief: Belief) -> Iterable[tuple[str, Parts]]:
    """Names and columns of wrenches: two components or more, of which one changes."""
    kinds = {joint: belief.kinds[joint] for joint in belief.axes}
    usual = exact_names(belief.kinds)
    names = [name for name in belief.free if name not in usual and not is_named_after(name, kinds)]
    arrays = {len(each.names) for each in families(names) if each.kind == "position" and each.template.endswith(".#")}
    # Letters of a unit would be mistaken for a component.
    bare = {re.sub(r"\s*[\[(][^\])\d]*[\])]\s*$|[\W_]+(m?k?Nm?m?)$", "", name): name for name in names}
    measured = [b for b, n in bare.items() if words(n).unit not in CURRENT and words(n).measured]
    for rest, components in wrench_groups(measured).items():
        parts = {key: bare[name] for key, name in components.items()}
        changes = not belief.log.columns.keys().isdisjoint(parts.values())
        # Three torques beside three positions are an array of joints.
        of_joints = {kind for kind, _ in parts} == {"torque"} and {3} == arrays & {len(kinds)}
        if sum(kind != "point" for kind, _ in parts) > 1 and changes and not of_joints:
            yield rest, parts


def _listed(parts: Parts, kind: str) -> list[str]:
    return [parts.get((kind, axis), "") for axis in "xyz"]


def _is_same(belief: Belief, one: Parts, other: Parts) -> bool:
    """True where two wrenches have forces of the same size throughout, and so are one that is written twice."""
    sizes = [np.linalg.norm(belief.log.table(_listed(parts, "force")), axis=1) for parts in (one, other)]
    return bool(all(np.ptp(size) > 0 for size in sizes) and np.corrcoef(sizes)[0, 1] > SAME)


def _site(rest: str, belief: Belief) -> str:
    """The site on a moving body that a wrench is named after; "" if there is none."""
    tree, sites = belief.mechanism.tree, belief.mechanism.sites.items()
    moving = {tree.names[k] for k in tree.moved}
    alike = list(most_alike(rest, [site for site, (body, _) in sites if body in moving], 0.99))
    return alike[0] if len(alike) == 1 else ""


def _mount(group: ColumnGroup, belief: Belief) -> None:
    """Adds the pose of the site that a wrench is named after."""
    body, pose = belief.mechanism.site(group.name)
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    group.entries["body"] = TableEntry(body, "the model has a site of that name on it")
    group.entries["position"] = TableEntry(pose[:3, 3].round(9).tolist(), "of the model's site of that name")
    group.entries["rpy_deg"] = TableEntry((angles.round(7) + 0.0).tolist(), "of the model's site of that name")


def _entries(belief: Belief, parts: Parts) -> dict[str, TableEntry]:
    """Lines on the columns of a wrench and their units."""
    log, there = belief.log, {kind for kind, _ in parts}
    entries = {"force": TableEntry(_listed(parts, "force"), "named so", SURE)} if "force" in there else {}
    moment, about = "torque", "about the origin"
    if {"point", "force", "torque"} <= there and not _is_about_origin(belief, parts):
        moment, about = "free_moment", "about the point, since p × F does not explain it"
        point = [name or 0.0 for name in _listed(parts, "point")]
        entries["point"] = TableEntry(point, "named so; what has no column is 0 m")
    if "torque" in there:
        entries[moment] = TableEntry(_listed(parts, "torque"), f"named so; {about}")
    for key, kind in (("unit", "force"), ("torque_unit", "torque"), ("point_unit", "point")):
        columns = [name for name in _listed(parts, kind) if name]
        units = {unit_of(kind.replace("point", "length"), words(name).unit) for name in columns} - {""}
        if log.states_unit(columns) or (kind == "point" and "point" not in entries):
            continue
        if len(units) == 1:
            entries[key] = TableEntry(units.pop(), "by the names")
        elif kind == "point":
            # The point is meaningless while nobody stands on the plate; the median assumes contact half of the time.
            size = float(np.median(np.abs(log.table(columns)), axis=0).max())
            if size > 10:
                entries[key] = TableEntry("mm", f"half of the time it is {size:.3g} or more away")
    return entries


def _is_about_origin(belief: Belief, parts: Parts) -> bool:
    """True where moments are those of the force at the point of application, about the origin, to 5 % of variance."""
    force, moment, point = (belief.log.table(_listed(parts, kind)) for kind in ("force", "torque", "point"))
    arm = np.cross(point, force)
    pairs = [k for k in range(3) if np.ptp(moment[:, k]) > 0 and np.ptp(arm[:, k]) > 0 and np.ptp(force) > 0]
    # About the point there is at most one component, along the plate's normal.
    return sum(1 - np.corrcoef(moment[:, k], arm[:, k])[0, 1] ** 2 < 0.05 for k in pairs) > 1


def _place(belief: Belief, group: ColumnGroup) -> None:
    """Adds the body that a wrench other than the ground's acts on; if that is open, the wrench stays a remark."""
    names, entries = belief.mechanism.tree.names, group.entries
    if "point" in entries or not belief.held or belief.flies:
        at_rest = "a point of application rests in the world" if belief.held and not belief.flies else "plates rest"
        entries["frame"] = TableEntry("world", at_rest)
        _stand(belief, group)
        return
    if len(alike := most_alike(group.name, names)) == 1:
        ((body, like),) = alike.items()
        entries["body"] = TableEntry(body, named(like)[0])
        return
    entries["body"] = TableEntry("?", f"one of {', '.join(names)}", DOUBTFUL)
    belief.ask(f"The name of the wrench '{group.name}' does not state the body that it acts on.")


def _stand(belief: Belief, group: ColumnGroup) -> None:
    """Adds the bodies that may stand on a plate."""
    tree, names = belief.mechanism.tree, belief.mechanism.bodies
    carrying = {tree.names[body.parent] for body in tree.bodies if body.parent >= 0}
    feet = [name for name in names if FEET.search(name)]
    among = feet or [name for name in names if name not in carrying]
    what = "named like feet" if feet else "bodies that carry no other"
    if sides := words(group.name).sides:
        among = [name for name in among if words(name).sides == sides] or among
    if len(among) == 1:
        group.entries["on"] = TableEntry(among[0], what)
    elif 1 < len(among) <= 8:
        group.entries["on"] = TableEntry(AUTO, "the body nearest to the force, in every episode")
        group.entries["among"] = TableEntry(among, what)
    else:
        group.entries["on"] = TableEntry("?", f"one of {', '.join(tree.names)}", DOUBTFUL)
        belief.ask(f"It is open which body stands on '{group.name}'.")


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
            belief.ask_place(group, f"The model explains {shares} as that of what '{best}' carries.")
        if group.is_inner:
            body = str(group.entries["body"].value)
            _turn_inner(group, model, inside[body])
            whole = all(kind in group.entries and all(group.entries[kind].value) for kind in PARTS)
            if not whole or belief.of("torque") or any(not other.is_inner for other in belief.groups.values()):
                group.entries["body"].sure = DOUBTFUL
                use = "for `payload`" if whole else "without all six components, which `payload` needs"
                belief.notes.append(
                    f"The wrench '{group.name}' is that of what '{body}' carries. It stays a remark {use}, since "
                    "`identify` would take it for a contact."
                )
            if "torque" in group.entries and "position" not in group.entries:
                _ask_position(belief, group)


def _ask_position(belief: Belief, group: ColumnGroup) -> None:
    """Asks for the position of a sensor, which `payload` estimates until it is stated."""
    what = "unknown, of the sensor in the frame of that body, m: its moments depend on it"
    group.entries["position"] = TableEntry([0.0, 0.0, 0.0], what, OPEN)
    belief.ask(
        f"It is open where the sensor of '{group.name}' is in the frame of '{group.entries['body'].value}': correct "
        f"its position. Until then origin = {UNPLACED} under [setup] lets `payload` estimate it from the motion."
    )
    if not group.is_doubtful:
        origin = TableEntry(UNPLACED, "standard deviation of the sensor's position, m; leave it out if you measure it")
        belief.poses[SETUP] = ColumnGroup(SETUP, {"origin": origin})


def _varying(x: np.ndarray) -> np.ndarray:
    """Columns without their means, which a sensor's offsets are part of."""
    return np.asarray(x - x.mean(axis=0))


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
    model.belief.rename(group)


def _turn_inner(group: ColumnGroup, model: ComparedModel, predicted: np.ndarray) -> None:
    """Sets units, sign and axes of a sensor's wrench by the model; its offsets do not matter."""
    for key, part in PARTS.items():
        if key in group.entries:
            measured = _varying(model.level(group.entries[key].value))
            model.belief.set_unit([group], key, size_ratio(measured, _varying(predicted[:, part])))
    if "force" not in group.entries:
        return
    with suppress(ExcitationError):
        force = model.level(group.entries["force"].value)
        # The direction of gravity decides, whatever the payload weighs.
        fit = weighed(np.hstack([force, 0 * force]), -predicted[:, :3])
        turned = fit.angle > TURNED and "rpy_deg" not in group.entries
        group.turn(fit.rotation.T if turned else np.eye(3), "body", "gravity fits", opposite=fit.opposite)


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
            changed |= belief.set_unit(belief.outer.values(), kind, ratio)
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
            group.turn(check.rotation, frame, why, opposite=check.sign < 0)
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
