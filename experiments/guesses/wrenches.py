"""Columns of wrenches: groups by name, reference points of moments, and the bodies that wrenches may act on."""

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import DOUBTFUL, LIKELY, SURE, Belief, Entry, Group
from experiments.guesses.chosen import AGREES, CLEAR, ENOUGH, ENOUGH_OF_WRENCHES
from experiments.guesses.explained import Model, explained, unexplained
from experiments.guesses.log_contents import LogContents
from experiments.guesses.names import is_named_after
from experiments.guesses.words import LIKE, NEAR, likeness, unit_of, words
from ident.errors import ExcitationError
from ident.estimation.equations import COMPONENTS
from ident.files.column import CURRENT
from ident.judgement.diagnosis import FrameCheck
from ident.mechanism.mechanism import Mechanism
from ident.payload.weight import TURNED, weighed
from ident.recordings.columns.mapping import joint_kinds
from ident.recordings.columns.plates import AUTO
from ident.recordings.wrench import GROUND
from ident.recordings.wrench_names import Component, wrench_groups

FEET = re.compile(r"foot|calcn|feet|sole|heel", re.IGNORECASE)
"""Names of bodies that stand on the ground."""

GROUNDS = re.compile(r"ground|base|plate|floor", re.IGNORECASE)
"""Names of the wrench at the base."""

SAME = 0.999
"""Correlation of the sizes of two forces above which they are the same force."""

SIZE = 5.0
"""Largest ratio of sizes of the ground's wrench that the model explains in part: masses of models are wrong by less. Of
a payload of a tenth of the weight, in the base's axes, it explains .93."""

TINY = 1e-6
"""Difference of unexplained shares that is rounding, as of bodies that are rigidly connected."""

SNAPPED = 3.0
"""Deviation from right angles, degrees, up to which a sensor's axes are taken to be at right angles."""

HALF_WAY = np.sqrt(1000)
"""Largest ratio of sizes within one unit: the geometric mean of 1 and the next unit's factor of 1000."""

OF_SIZE = {
    "force": ("unit", {"N": 1.0, "kN": 1e-3}),
    "torque": ("torque_unit", {"N m": 1.0, "N mm": 1e3, "kN m": 1e-3}),
}
"""Key of the unit of forces and of moments, and the size of a column in each unit over that in the SI unit."""

Parts = dict[Component, str]
"""Columns by component."""

ABOUT_ORIGIN = 0.05
"""Share of a moment's variance not explained by p × F, up to which it is about the origin rather than the point."""


def add_wrenches(belief: Belief, contents: LogContents, mechanism: Mechanism, held: bool, flies: bool) -> None:
    """Adds the columns that are named like wrenches.

    Args:
        belief: The belief to extend.
        contents: The log.
        mechanism: The mechanism, with the bodies that wrenches may act on.
        held: True if something holds the base.
        flies: True if the joints move a held base freely in a plane.
    """
    kinds = {joint: kind for joint, kind in joint_kinds(mechanism.tree).items() if kind != "ball"}
    names = [name for name in contents.names if name not in belief.columns and not is_named_after(name, kinds)]
    bare = {_bare(n): n for n in names if words(n).unit not in CURRENT and words(n).measured}
    wrenches: list[tuple[str, Parts]] = []
    for rest, components in wrench_groups(list(bare)).items():
        parts = {key: bare[name] for key, name in components.items()}
        changes = any(name in contents.columns for name in parts.values())
        if sum(kind != "point" for kind, _ in parts) < 2 or not changes:
            continue
        own = re.sub(r"\W+", "_", rest).strip("_")
        if same := next((other for other, those in wrenches if _is_same(contents, parts, those)), None):
            belief.open.append(f"The wrench '{own}' has the same force as '{same}', and is left out.")
            continue
        wrenches.append((own, parts))
    for k, (rest, parts) in enumerate(wrenches):
        site = _site(rest, mechanism)
        grounds = [j for j, (other, _) in enumerate(wrenches) if GROUNDS.search(other)]
        is_ground = held and not site and (len(wrenches) == 1 or grounds == [k])
        group = Group(GROUND if is_ground else site or (rest if rest not in ("", GROUND) else f"wrench{k + 1}"), {})
        group.entries, group.is_open = _entries(contents, parts), is_ground and grounds != [k]
        group.own_name = rest or "sensor"
        if site:
            _mount(group, mechanism)
        elif not is_ground:
            _place(belief, group, mechanism, held and not flies)
        elif "point" in group.entries:
            group.entries["frame"] = Entry("world", "a point of application rests in the world")
        belief.groups[group.name] = group


def _is_same(contents: LogContents, one: Parts, other: Parts) -> bool:
    """True where two wrenches have forces of the same size throughout, and so are one that is written twice."""
    sizes = []
    for parts in (one, other):
        forces = [name for (kind, _), name in parts.items() if kind == "force" and name in contents.columns]
        sizes.append(np.linalg.norm([contents.columns[name] for name in forces] or [0 * contents.time], axis=0))
    return bool(all(np.ptp(size) > 0 for size in sizes) and np.corrcoef(sizes)[0, 1] > SAME)


def _site(rest: str, mechanism: Mechanism) -> str:
    """The site on a moving body that a wrench is named after; "" if there is none."""
    own, tree = words(rest), mechanism.tree
    moving = {tree.names[k] for i in tree.moving for k in tree.carried(i)}
    named = [s for s, (body, _) in mechanism.sites.items() if body in moving and likeness(own, words(s)) >= 0.99]
    return named[0] if len(named) == 1 else ""


def _mount(group: Group, mechanism: Mechanism) -> None:
    """Adds the pose of the site that a wrench is named after."""
    body, pose = mechanism.site(group.name)
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    group.entries["body"] = Entry(body, "the model has a site of that name on it")
    group.entries["position"] = Entry(pose[:3, 3].round(9).tolist(), "of that site")
    group.entries["rpy_deg"] = Entry((angles.round(7) + 0.0).tolist(), "of that site")


def _bare(name: str) -> str:
    """A name without its unit, whose letters would be mistaken for a component."""
    return re.sub(r"\s*[\[(][^\])]*[\])]\s*$|[\W_]+(k?Nm?m?)$", "", name)


def _entries(contents: LogContents, parts: Parts) -> dict[str, Entry]:
    """Lines on the columns of a wrench and their units."""

    def listed(kind: str) -> list[str]:
        return [parts.get((kind, axis), "") for axis in "xyz"]

    there = {kind for kind, _ in parts}
    entries = {"force": Entry(listed("force"), "named so", SURE)} if "force" in there else {}
    moment = "torque"
    if {"point", "force", "torque"} <= there:
        moment = "torque" if _is_about_origin(contents, parts) else "free_moment"
        if moment == "free_moment":
            why = "named so; what has no column is 0 m"
            entries["point"] = Entry([name or 0.0 for name in listed("point")], why)
    if "torque" in there:
        about = {"torque": "about the origin", "free_moment": "about the point, since p × F does not explain it"}
        entries[moment] = Entry(listed("torque"), f"named so; {about[moment]}")
    for key, kind, quantity in (
        ("unit", "force", "force"),
        ("torque_unit", "torque", "torque"),
        ("point_unit", "point", "length"),
    ):
        if key == "point_unit" and "point" not in entries:
            continue
        columns = [name for name in listed(kind) if name]
        units = {unit_of(quantity, words(name).unit) for name in columns} - {""}
        if len(units) == 1 and not any(name in contents.units for name in columns):
            entries[key] = Entry(units.pop(), "by the names")
        elif key == "point_unit" and not any(name in contents.units for name in columns):
            # The point is meaningless while nobody stands on the plate; the median assumes contact half of the time.
            size = max(float(np.median(np.abs(contents.columns[name]))) for name in columns if name in contents.columns)
            if size > 10:
                entries[key] = Entry("mm", f"half of the time it is {size:.3g} or more away")
    return entries


def _is_about_origin(contents: LogContents, parts: Parts) -> bool:
    """True where moments are those of the force at the point of application, about the origin."""

    def of(kind: str) -> np.ndarray:
        columns = [contents.columns.get(parts.get((kind, axis), ""), np.zeros(len(contents.time))) for axis in "xyz"]
        return np.stack(columns, axis=1)

    force, moment, arm = of("force"), of("torque"), np.cross(of("point"), of("force"))
    pairs = [k for k in range(3) if np.ptp(moment[:, k]) > 0 and np.ptp(arm[:, k]) > 0 and np.ptp(force) > 0]
    left = [1 - np.corrcoef(moment[:, k], arm[:, k])[0, 1] ** 2 for k in pairs]
    # About the point there is at most one component, along the plate's normal.
    return len([x for x in left if x < ABOUT_ORIGIN]) > 1


def _place(belief: Belief, group: Group, mechanism: Mechanism, held: bool) -> None:
    """Adds the body that a wrench other than the ground's acts on; if that is open, the wrench stays a remark."""
    if "point" in group.entries or not held:
        group.entries["frame"] = Entry("world", "a point of application rests in the world" if held else "plates rest")
        _stand(belief, group, mechanism)
        return
    own = words(group.name)
    likes = {body: likeness(own, words(body)) for body in mechanism.tree.names}
    best = max(likes, key=lambda body: likes[body])
    near = [body for body in likes if likes[body] > likes[best] - NEAR]
    if likes[best] >= LIKE and len(near) == 1:
        group.entries["body"] = Entry(best, f"named alike ({100 * likes[best]:.0f} %)")
    else:
        group.entries["body"] = Entry("?", f"one of {', '.join(mechanism.tree.names)}", DOUBTFUL)
        belief.open.append(f"The name of the wrench '{group.name}' does not state the body that it acts on.")


def _stand(belief: Belief, group: Group, mechanism: Mechanism) -> None:
    """Adds the bodies that may stand on a plate."""
    tree = mechanism.tree
    carrying = {tree.names[body.parent] for body in tree.bodies if body.parent >= 0}
    feet = [name for name in tree.names if FEET.search(name)]
    among = feet or [name for name in tree.names if name not in carrying]
    what = "named like feet" if feet else "bodies that carry no other"
    if sides := words(group.name).sides:
        among = [name for name in among if words(name).sides == sides] or among
    if len(among) == 1:
        group.entries["on"] = Entry(among[0], what)
    elif 1 < len(among) <= 8:
        group.entries["on"] = Entry(AUTO, "the body nearest to the force, in every episode")
        group.entries["among"] = Entry(among, what)
    else:
        group.entries["on"] = Entry("?", f"one of {', '.join(tree.names)}", DOUBTFUL)
        belief.open.append(f"It is open which body stands on '{group.name}'.")


def place_wrenches(model: Model) -> None:
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
            sizes = {body: _ratio(x, inside[body][:, part]) for body in left}
            _carry(group, model, left, sizes)
        elif 1 - at_base < (ENOUGH if _has_size(x, ground[:, part]) else ENOUGH_OF_WRENCHES):
            group.entries["body"] = Entry("?", "the body beyond the sensor", DOUBTFUL)
            belief.open.append(
                f"It is open where the wrench '{group.own_name}' is measured. The model explains {explained(at_base)} "
                f"of it as the ground's, and {explained(left.get(best, 1.0))} as that of what '{best}' carries."
            )
            _rename(belief, group)
        if group.is_inner:
            body = str(group.entries["body"].value)
            _turn_inner(group, model, inside[body])
            if belief.of("torque") or any(not other.is_inner for other in belief.groups.values()):
                group.entries["body"].sure = DOUBTFUL
                belief.notes.append(
                    f"The wrench '{group.name}' is that of what '{body}' carries. It stays a remark for `payload`, "
                    "since `identify` would take it for a contact."
                )


def _has_size(measured: np.ndarray, predicted: np.ndarray) -> bool:
    """True where columns are as large as the prediction, in some unit."""
    ratio = float(np.linalg.norm(measured)) / max(float(np.linalg.norm(predicted)), 1e-12)
    return any(1 / SIZE < ratio * unit < SIZE for unit in (1e-3, 1.0, 1e3))


def _ratio(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Size of columns without their means over that of the prediction without its."""
    there = float(np.linalg.norm(predicted - predicted.mean(axis=0)))
    return float(np.linalg.norm(measured - measured.mean(axis=0))) / max(there, 1e-12)


def _rename(belief: Belief, group: Group) -> None:
    """Gives a wrench that is not the ground's its own name."""
    belief.groups.pop(group.name)
    group.name, group.is_open = group.own_name, False
    belief.groups[group.name] = group


def _carry(group: Group, model: Model, left: Mapping[str, float], sizes: Mapping[str, float]) -> None:
    """Puts a wrench on the body beyond its sensor: named like it, or else of the likeliest weight."""
    best, group.is_inner = min(left, key=lambda body: left[body]), True
    alike = [body for body in left if CLEAR * left[body] <= left[best] + TINY]
    rigid = [body for body in alike if model.mover(body) == model.mover(best)]
    named = [body for body in alike if likeness(words(group.own_name), words(body)) >= LIKE]
    body = named[0] if len(named) == 1 else min(rigid, key=lambda body: abs(np.log(max(sizes[body], 1e-12))))
    why = f"the model explains {explained(left[body])} of it as the wrench of what '{body}' carries"
    sure = LIKELY if len(named) == 1 or len(rigid) == len(alike) else DOUBTFUL
    group.entries["body"] = Entry(body, why, sure)
    if sure == DOUBTFUL:
        model.belief.open.append(f"The wrench '{group.own_name}' may be that of what {' or '.join(alike)} carries.")
    _rename(model.belief, group)


def _turn_inner(group: Group, model: Model, predicted: np.ndarray) -> None:
    """Sets units, sign and axes of a sensor's wrench by the model; its offsets do not matter."""
    for key, part in (("force", slice(0, 3)), ("torque", slice(3, 6))):
        if key in group.entries:
            ratio = _ratio(model.level(group.entries[key].value), predicted[:, part])
            set_unit(model.belief, model.contents, [group], key, ratio)
    if "force" not in group.entries:
        return
    force = model.level(group.entries["force"].value)
    with suppress(ExcitationError):
        # The direction of gravity decides, whatever the payload weighs.
        fit = weighed(np.hstack([force, 0 * force]), -predicted[:, :3])
        if fit.opposite:
            group.entries["applied_to_link"] = Entry(False, "the opposite sign fits gravity")
        if fit.angle > TURNED and "rpy_deg" not in group.entries:
            angles = Rotation.from_matrix(fit.rotation.T).as_euler("xyz", degrees=True)
            near = 90 * np.round(angles / 90)
            angles = np.where(np.abs(angles - near) < SNAPPED, near, angles).round(1) + 0.0
            group.entries["rpy_deg"] = Entry(angles.tolist(), "its axes in those of the body fit gravity")


def set_unit(belief: Belief, contents: LogContents, groups: Sequence[Group], kind: str, ratio: float) -> bool:
    """Sets the unit of forces or moments by their size, unless it is known, and returns True if it is not the SI unit.

    Args:
        belief: The belief, for a note on a size that no unit explains.
        contents: The log.
        groups: The wrenches.
        kind: `force` or `torque`.
        ratio: Size of the columns over what the model predicts in SI units.
    """
    key, choices = OF_SIZE[kind]
    unit = min(choices, key=lambda u: abs(np.log(max(ratio, 1e-12) / choices[u])))
    if abs(np.log(max(ratio, 1e-12) / choices[unit])) > np.log(HALF_WAY):
        belief.notes.append(
            f"The {kind}s have {ratio:.2g} times the size in {next(iter(choices))} that the model predicts, "
            "which no other unit explains."
        )
        return False
    changed = False
    for group in groups:
        columns = [name for k in (kind, "free_moment") if k in group.entries for name in group.entries[k].value]
        if key not in group.entries and any(columns) and not any(name in contents.units for name in columns):
            why = f"in {unit} it has {ratio / choices[unit]:.2g} times the size that the model predicts"
            group.entries[key] = Entry(unit, why)
            changed = changed or choices[unit] != 1
    return changed


def set_turn(group: Group, check: FrameCheck, frame: str) -> None:
    """Sets the sign and the axes of a wrench that a check suggests."""
    error = f"{100 * check.error_turned:.0f} % of the prediction is off then, as it stands {100 * check.error:.0f} %"
    if check.suspicious and check.sign < 0:
        group.entries["applied_to_link"] = Entry(False, f"the opposite sign: {error}")
    if check.suspicious and not np.array_equal(check.rotation, np.eye(3)):
        # A frame that is not turned states no angles; others are multiples of 90°.
        angles = Rotation.from_matrix(check.rotation).as_euler("xyz", degrees=True).round(9) + 0.0
        group.entries["rpy_deg"] = Entry(angles.tolist(), f"its axes in those of the {frame}: {error}")
        if "frame" in group.entries:
            group.entries["frame"] = Entry("plate", "axes other than the world's")
            group.entries["position"] = Entry([0, 0, 0], "the world's origin")


def is_doubtful(group: Group) -> bool:
    """True where a line of a wrench is doubtful, or force and torque are both missing; it is written as a remark."""
    return any(entry.sure == DOUBTFUL for entry in group.entries.values()) or not (
        {"force", "torque"} & group.entries.keys()
    )
