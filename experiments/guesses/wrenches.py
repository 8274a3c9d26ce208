"""Columns of wrenches: groups by name, reference points of moments, and the bodies that wrenches may act on."""

import re

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import DOUBTFUL, SURE, Belief, Entry, Group
from experiments.guesses.families import families
from experiments.guesses.log_contents import LogContents
from experiments.guesses.names import is_named_after
from experiments.guesses.words import LIKE, NEAR, likeness, unit_of, words
from ident.files.column import CURRENT
from ident.mechanism.mechanism import Mechanism
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
    arrays = {len(each.names) for each in families(names) if each.kind == "position" and each.template.endswith(".#")}
    for rest, components in wrench_groups(list(bare)).items():
        parts = {key: bare[name] for key, name in components.items()}
        changes = any(name in contents.columns for name in parts.values())
        # Three torques beside three positions are an array of joints.
        of_joints = {kind for kind, _ in parts} == {"torque"} and {3} == arrays & {len(kinds)}
        if sum(kind != "point" for kind, _ in parts) < 2 or not changes or of_joints:
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
    return re.sub(r"\s*[\[(][^\])\d]*[\])]\s*$|[\W_]+(m?k?Nm?m?)$", "", name)


def _entries(contents: LogContents, parts: Parts) -> dict[str, Entry]:
    """Lines on the columns of a wrench and their units."""

    def listed(kind: str) -> list[str]:
        return [parts.get((kind, axis), "") for axis in "xyz"]

    there = {kind for kind, _ in parts}
    entries = {"force": Entry(listed("force"), "named so", SURE)} if "force" in there else {}
    moment, about = "torque", "about the origin"
    if {"point", "force", "torque"} <= there and not _is_about_origin(contents, parts):
        moment, about = "free_moment", "about the point, since p × F does not explain it"
        entries["point"] = Entry([name or 0.0 for name in listed("point")], "named so; what has no column is 0 m")
    if "torque" in there:
        entries[moment] = Entry(listed("torque"), f"named so; {about}")
    quantities = (("unit", "force", "force"), ("torque_unit", "torque", "torque"), ("point_unit", "point", "length"))
    for key, kind, quantity in quantities:
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


def is_doubtful(group: Group) -> bool:
    """True where a line of a wrench is doubtful, or force and torque are both missing; it is written as a remark."""
    return any(entry.sure == DOUBTFUL for entry in group.entries.values()) or not (
        {"force", "torque"} & group.entries.keys()
    )
