"""Mechanisms from OpenSim files, and these files with other inertias and places of joints."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arguments import checked_coordinates
from ident.errors import InputError, ModelError, about
from ident.files.atomic import replacing
from ident.geometry.inertia import entries, parameters_from_com, symmetric
from ident.mechanism.loops import Constraints
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.setup import OF_PEOPLE
from sim.models.inertials import Update, by_body, is_balanced, stated_parts
from sim.models.notes import constrained, note
from sim.models.opensim_elements import (
    Frames,
    label,
    markers,
    model_element,
    number,
    numbers,
    offset,
    socket,
    text,
)
from sim.models.opensim_joints import Link, links_in_order, point_constraints
from sim.models.opensim_skeleton import Skeleton
from sim.models.xml_files import ModelFile, parsed, restated, text_of

STANDARD_GRAVITY = "0 -9.80665 0"
"""Default gravity, m/s²; y points up."""

MOMENTS = ("xx", "yy", "zz", "xy", "xz", "yz")
"""Entries of an inertia, in the order of OpenSim 4 and of φ."""


@dataclass(frozen=True, eq=False)
class OpenSimOrigin:
    """Origin of a mechanism, its `source`.

    Attributes:
        path: The file.
        base: Name of the body whose frame is {0}, None for the ground's.
        beyond: Names of bodies at which the mechanism ends.
    """

    path: Path
    base: str | None
    beyond: tuple[str, ...]


def is_opensim(source: object) -> bool:
    """True if a source is the path of an OpenSim file."""
    return isinstance(source, str | Path) and Path(source).suffix.lower() == ".osim"


def mechanism_from_opensim(
    path: str | Path,
    base: str | None = None,
    beyond: Sequence[str] = (),
    *,
    ignore: Collection[str] = (),
    fix: Mapping[str, float | Sequence[float]] | Sequence[str] | None = None,
) -> Mechanism:
    """Mechanism of an OpenSim file.

    Coordinates become hinges and slides of their names. Locked ones stay at their default. Joints that are moved by
    functions of a coordinate, or whose coordinate a `CoordinateCouplerConstraint` makes dependent, become followers.
    `PointConstraint`s and `WeldConstraint`s close loops. Markers become sites. Axes are
    those of the file, with y up in most; muscles, springs, geometry and contacts are left out.

    Args:
        path: The file, of OpenSim 3 or 4.
        base: Name of the body whose frame is {0}, as for `sim.mechanism`; so are the other arguments.
        beyond: Names of bodies that, with all their descendants, are not part of the mechanism.
        ignore: Names of constraints to leave out.
        fix: Coordinates that do not move, each with its value, or empty for its default.

    Returns:
        The mechanism, with `OpenSimOrigin` as its source.

    Warns:
        ModelNote: Tabulated functions were replaced by polynomials, or an inertia is impossible for a rigid body.

    Raises:
        ModelError: Something in the file cannot be read; the message names it.
    """
    origin, fix = OpenSimOrigin(Path(path), base, tuple(beyond)), checked_coordinates("fix", () if fix is None else fix)
    model = model_element(origin.path, parsed(origin.path))
    with about(origin.path):
        frames = Frames(model)
        skeleton = Skeleton.of(model, frames, ignore)
        tree, gravity = skeleton.tree, numbers(model, "gravity", 3, STANDARD_GRAVITY)
        if base is not None:
            # Gravity is in the axes of a base at rest; for a moving base, whose poses are recorded, in the ground's.
            tree, R = skeleton.based(base)
            gravity = gravity if R is None else R.T @ gravity
        tree = _without(tree, origin.beyond)
        rest = {name: q if len(q) else [skeleton.default(name)] for name, q in fix.items()}
        # The model itself holds locked coordinates at their default.
        held = [name for name in rest if len(fix[name]) or not skeleton.coordinates[name].locked]
        tree = tree.fixed({name: rest[name] for name in held})
        bodies = [tree.names[i] for i in tree.inertial]
        prior = np.concatenate([body_parameters(frames.bodies[name]) for name in bodies])
        _note_inertias(frames, bodies)
        ranges = {joint: limits for joint in tree.joints if (limits := skeleton.limits(joint)) is not None}
        places = markers(model, frames)
        sites = {name: (place.body, place.pose) for name, place in places.items() if place.body in bodies}
        read = Mechanism(tree, gravity, prior if prior.any() else None, sites, ranges, origin)
        posture = {joint: np.array([skeleton.default(joint)]) for joint in tree.joints}
        constraints = Constraints(tuple(point_constraints(model, frames, ignore)), posture).within(tree)
        return replace(constrained(read, constraints), centre_std=OF_PEOPLE).rested()


def _without(tree: Tree, beyond: Sequence[str]) -> Tree:
    """The tree without the named bodies and their descendants."""
    gone = {k for i, name in enumerate(tree.names) if name in beyond for k in tree.carried(i)}
    kept = [i for i in range(len(tree.bodies)) if i not in gone]
    if not kept:
        raise ModelError("The model has no body besides the ground.")
    return Tree(tree.part(kept))


def body_parameters(element: ET.Element) -> np.ndarray:
    """φ of a `<Body>` about its frame (10,)."""
    mass = number(element, "mass", "0")
    if mass < 0:
        raise ModelError(f"{label(element)} needs a mass that is not negative, got {mass:g}.")
    if text(element, "inertia"):
        entries = numbers(element, "inertia", 6)
    else:
        entries = np.array([number(element, f"inertia_{key}", "0") for key in MOMENTS])
    return parameters_from_com(mass, numbers(element, "mass_center", 3, "0 0 0"), symmetric(entries))


def _note_inertias(frames: Frames, bodies: Sequence[str]) -> None:
    """Notes bodies with an impossible inertia."""
    odd = []
    for name in bodies:
        element = frames.bodies[name]
        mass, center = number(element, "mass", "0"), numbers(element, "mass_center", 3, "0 0 0")
        own = body_parameters(element) - parameters_from_com(mass, center, np.zeros((3, 3)))
        if not is_balanced(np.linalg.eigvalsh(symmetric(own[4:]))):
            odd.append(name)
    if odd:
        note(f"The inertia stated for {', '.join(odd)} is taken as it is, but no rigid body has it (A + B < C).")


def write_opensim(path: Path, mechanism: Mechanism, update: Update) -> None:
    """Writes the file of a mechanism with other inertial parameters, and perhaps other places of joints.

    Args:
        path: File to write; its folder must exist.
        mechanism: The mechanism, from an OpenSim file.
        update: Its new values; drives stay as they are.

    Raises:
        ModelError: A joint has no offset frame to displace, or the file is in UTF-16 or UTF-32, has elements in
            entities, or does not read back as φ.
        InputError: φ does not fit the bodies, one is not physical, or the path does not end in `.osim`.
    """
    origin: OpenSimOrigin = mechanism.source
    if path.suffix.lower() != ".osim":
        raise InputError(f"An OpenSim model is written as an OpenSim file; write '{path.stem}.osim' instead.")
    file = ModelFile(origin.path, text_of(origin.path))
    model = model_element(origin.path, file.root)
    frames = Frames(model)
    bodies = frames.bodies
    changed = update.changed(mechanism.bodies, lambda name: body_parameters(bodies[name]))
    for name, own in changed.items():
        _state(bodies[name], own, short=name in update.comments)
    update.comment(changed, bodies.get)
    links = {link.child.body: link for link in links_in_order(model, frames)} if update.displaced else {}
    for name, shift in update.displaced.items():
        _displace(origin.path, links[name], shift)
    with replacing(path) as temporary:
        temporary.write_bytes(file.changed())
        after = Frames(model_element(temporary, parsed(temporary))).bodies
        for name, own in by_body(mechanism.bodies, update.phi).items():
            if abs(body_parameters(after[name]) - own).max() > update.tolerance * abs(own).max():
                raise ModelError(f"{path}: the parameters of '{name}' do not read back as they were written.")


def _displace(path: Path, link: Link, shift: np.ndarray) -> None:
    """Displaces a joint in the frame of the body that it is on."""
    offsets = {each.get("name"): each for each in link.joint.iterfind("frames/PhysicalOffsetFrame")}
    frame = offsets.get(socket(link.joint, "parent_frame").rpartition("/")[2], link.joint)
    names = ("location_in_parent", "orientation_in_parent") if frame is link.joint else ("translation", "orientation")
    if (stated := frame.find(names[0])) is None:
        whose = f"the joint that carries '{link.child.body}'"
        raise ModelError(f"{path}: {whose} has no offset frame of its own; add one on its parent.")
    own = offset(frame, *names)
    _set(stated, own[:3, 3] + own[:3, :3] @ link.parent.pose[:3, :3].T @ shift)


def _state(body: ET.Element, phi: np.ndarray, *, short: bool) -> None:
    """States the φ of a body, perhaps with short numbers."""
    mass, center, inertia = stated_parts(phi, short=short)
    numbers: dict[str, Iterable[float]] = {"mass": [mass], "mass_center": center}
    if body.find("inertia") is not None or not any(body.find(f"inertia_{key}") is not None for key in MOMENTS):
        numbers["inertia"] = entries(inertia)
    else:
        numbers |= {f"inertia_{key}": [x] for key, x in zip(MOMENTS, entries(inertia), strict=True)}
    missing = 0
    for tag, values in numbers.items():
        element = body.find(tag)
        if element is None:
            element = ET.Element(tag)
            body.insert(missing, element)
            missing += 1
        _set(element, values)


def _set(element: ET.Element, values: Iterable[float]) -> None:
    """Sets the numbers in an element; comments between them go if they change."""
    stated, new = element.text, restated(element.text, values)
    if new.split() != (stated or "").split():
        element[:] = []
        element.text = new
