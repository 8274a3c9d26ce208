"""Groups of columns by their names: wrenches with the bodies that they may act on, orientations, and a base's poses."""

import re
from collections.abc import Iterable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.guesses.belief import BASE, DOUBTFUL, SURE, Belief, ColumnGroup, TableEntry, named
from experiments.guesses.log_contents import LONG
from experiments.guesses.scores import decisions, exact_names, is_named_after
from experiments.guesses.words import LIKE, families, likeness, most_alike, unit_of, without_unit, words
from ident.estimation.recorded_motion import UNIT
from ident.files.column import CURRENT
from ident.recordings.channels import Component, wrench_groups
from ident.recordings.plates import AUTO
from ident.recordings.wrench import GROUND

FEET = re.compile(r"foot|calcn|feet|sole|heel", re.IGNORECASE)
"""Names of bodies that stand on the ground."""

GROUNDS = re.compile(r"ground|base|plate|floor", re.IGNORECASE)
"""Names of the wrench at the base."""

SAME = 0.999
"""Correlation above which columns, or the sizes of two forces, are two readings of the same."""

BASES = re.compile(r"pelvis|base|root|trunk|torso|float", re.IGNORECASE)
"""Names of bodies that move freely."""

TURNS = r"(?:quaternion|quat|orientation|rotation|rot|position|pos|q)?"

MOVES = r"(?:position|pos|translation|trans|p|t)?"
"""Words between the name of a group of columns and its component."""

Parts = dict[Component, str]
"""Columns by component."""


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
    moving = {tree.names[k] for i in tree.moving for k in tree.carried(i)}
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


def add_poses(belief: Belief, base: str | None) -> None:
    """Adds columns of ball joints, and of a moving base.

    Args:
        belief: The belief to extend.
        base: Name of the body whose frame is {0}; None if the base does not move.
    """
    groups = _grouped(belief, TURNS, "wxyz")
    norms = {rest: np.linalg.norm(belief.log.table(names), axis=1) for rest, names in groups.items()}
    groups = {rest: names for rest, names in groups.items() if (np.abs(norms[rest] - 1) < UNIT).all()}
    balls = [joint for joint in belief.kinds if joint not in belief.axes]
    for own in decisions({(rest, ball): likeness(words(rest), words(ball)) for rest in groups for ball in balls}):
        if own.columns:
            belief.ask(f"The orientation of '{own.joint}' may be in {' or in '.join(own.columns)}.")
            continue
        why, sure = named(own.score)
        entry = TableEntry(groups.pop(own.column), f"{why}, with a norm of one", sure)
        belief.poses[f"joints.{own.joint}"] = ColumnGroup(own.joint, {"position": entry})
    if base is not None and belief.held:
        _add_base(belief, groups, base)


def _add_base(belief: Belief, groups: Mapping[str, list[str]], base: str) -> None:
    """Adds the poses of the base, if one quaternion named like it has a position beside it."""
    log, places = belief.log, _grouped(belief, MOVES, "xyz")
    alike = [rest for rest in groups if BASES.search(rest) or likeness(words(rest), words(base)) >= LIKE]
    bases = [rest for rest in alike if rest in places and not log.columns.keys().isdisjoint(groups[rest])]
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
