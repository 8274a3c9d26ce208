"""Mechanisms from OpenSim files, with springs as drives."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.arguments import checked_coordinates
from ident.errors import ModelError, about
from ident.geometry.inertia import parameters_from_com, symmetric
from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.loops import Constraints
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.setup import OF_PEOPLE
from sim.models.inertials import is_balanced
from sim.models.notes import constrained, note
from sim.models.opensim.elements import Frames, flag, label, markers, model_element, number, numbers, objects, text
from sim.models.opensim.joints import point_constraints
from sim.models.opensim.skeleton import Skeleton
from sim.models.xml_files import parsed


def drives_of_coordinates(model: ET.Element, skeleton: Skeleton, tree: Tree) -> dict[str, Drive]:
    """Drives of a tree's coordinates by their names: every `SpringGeneralizedForce` that acts on one of them.

    Warns:
        ModelNote: A spring acts on a coordinate that follows another one, or a limit's force inside a range.

    Raises:
        ModelError: The coordinate of a spring does not exist, or one of its numbers is none.
    """
    out, dependent = dict[str, Drive](), list[str]()
    for element, name in _acting(model, "SpringGeneralizedForce"):
        if name not in skeleton.coordinates:
            raise ModelError(f"{label(element)} needs a coordinate of the model, got '{name}'.")
        if name in tree.joints:
            out[name] = _with_spring(out.get(name, NO_DRIVE), element)
        elif not (skeleton.coordinates[name].locked or name in skeleton.tree.joints):
            dependent.append(element.get("name", ""))
    if dependent:
        note(f"The springs {', '.join(dependent)} of coordinates that follow others are left out of joint torques.")
    limits = [
        element.get("name", "")
        for element, name in _acting(model, "CoordinateLimitForce")
        if name in tree.joints and _acts_inside(element, skeleton, tree, name)
    ]
    if limits:
        note(
            f"The forces {', '.join(limits)} begin inside their coordinates' ranges, and are left out of joint torques."
        )
    return {name: drive for name, drive in out.items() if drive != NO_DRIVE}


def _acting(model: ET.Element, kind: str) -> Iterator[tuple[ET.Element, str]]:
    """Yields the forces of a kind that are not switched off, and the names of their coordinates."""
    for element in objects(model, "ForceSet"):
        if element.tag == kind and flag(element, "appliesForce", True) and not flag(element, "isDisabled", False):
            yield element, text(element, "coordinate").rpartition("/")[2]


def _with_spring(drive: Drive, element: ET.Element) -> Drive:
    """A drive with one more spring: several act as one of their common stiffness, at rest at their weighted mean."""
    stiffness, rest = number(element, "stiffness", "0"), number(element, "rest_length", "0")
    viscous = drive.viscous + number(element, "viscosity", "0")
    together = drive.stiffness + stiffness
    if not together:
        return Drive(viscous)
    reference = (drive.stiffness * drive.springref + stiffness * rest) / together
    return Drive(viscous, stiffness=together, springref=reference)


def _acts_inside(element: ET.Element, skeleton: Skeleton, tree: Tree, name: str) -> bool:
    """True if the force at the limits of a coordinate, in degrees for a turn, begins inside the coordinate's range."""
    body = next(body for body in tree.bodies if body.joint == name)
    unit, limits = np.pi / 180 if body.turns else 1.0, skeleton.coordinates[name].range
    if limits is None:
        return False
    low, high = (unit * number(element, f"{end}_limit", inf) for end, inf in (("lower", "-1e9"), ("upper", "1e9")))
    # Degrees are rounded.
    return low > limits[0] + 1e-3 or high < limits[1] - 1e-3


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
    drives: bool = True,
) -> Mechanism:
    """Mechanism of an OpenSim file.

    Coordinates become hinges and slides of their names. Locked ones stay at their default. Joints that are moved by
    functions of a coordinate, or whose coordinate a `CoordinateCouplerConstraint` makes dependent, become followers.
    `PointConstraint`s and `WeldConstraint`s close loops. Markers become sites, springs and dampers of coordinates
    drives. Axes are those of the file, with y up in most; muscles, geometry and contacts are left out.

    Args:
        path: The file, of OpenSim 3 or 4.
        base: Name of the body whose frame is {0}, as for `sim.mechanism`; so are the other arguments.
        beyond: Names of bodies that, with all their descendants, are not part of the mechanism.
        ignore: Names of constraints to leave out.
        fix: Coordinates that do not move, each with its value, or empty for its default.
        drives: False to leave out springs and dampers.

    Returns:
        The mechanism, with `OpenSimOrigin` as its source.

    Warns:
        ModelNote: Tabulated functions were replaced by polynomials, an inertia is impossible for a rigid body, or as
            for `drives_of_coordinates`.

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
            gravity = gravity if skeleton.moves(base) else skeleton.rotation(base).T @ gravity
            tree = skeleton.carried(base)
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
        stated = drives_of_coordinates(model, skeleton, tree) if drives else {}
        read = Mechanism(tree, gravity, prior if prior.any() else None, sites, ranges, origin, drives=stated)
        posture = {joint: np.array([skeleton.default(joint)]) for joint in tree.joints}
        constraints = Constraints(tuple(point_constraints(model, frames, ignore)), posture).within(tree)
        if closing := [row.name for row in constraints.rows]:
            note(f"By {', '.join(closing)}, joints without a column follow from the others.")
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
