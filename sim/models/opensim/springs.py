"""Springs and dampers of coordinates in OpenSim files, as drives."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from ident.errors import ModelError
from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.tree import Tree
from sim.models.notes import note
from sim.models.opensim.document import flag, label, number, objects, text
from sim.models.opensim.skeleton import Skeleton

CLOSE = 1e-3
"""Distance of a limit from the end of a range, rad or m, within which they are the same: degrees are rounded."""


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
    return low > limits[0] + CLOSE or high < limits[1] - CLOSE
