"""Joints of OpenSim files: their turns and slides, and the order in which they carry bodies."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.errors import ModelError
from sim.models.opensim.elements import GROUND, Frames, PlacedFrame, flag, label, named, numbers, objects, text
from sim.models.opensim.functions import IDENTITY, Curve, curve, function_of

_SIMPLE = {
    "WeldJoint": (),
    "PinJoint": (("turn", 2, 0),),
    "SliderJoint": (("slide", 0, 0),),
    "UniversalJoint": (("turn", 0, 0), ("turn", 1, 1)),
    "GimbalJoint": (("turn", 0, 0), ("turn", 1, 1), ("turn", 2, 2)),
    "BallJoint": (("turn", 0, 0), ("turn", 1, 1), ("turn", 2, 2)),
    "PlanarJoint": (("slide", 0, 1), ("slide", 1, 2), ("turn", 2, 0)),
    "FreeJoint": (*(("slide", k, 3 + k) for k in range(3)), *(("turn", k, k) for k in range(3))),
}
"""Turns and slides of joints other than `CustomJoint`: kind, axis, and index of the coordinate that moves them."""

AXES = ("translation1", "translation2", "translation3", "rotation1", "rotation2", "rotation3")
"""The axes of a `CustomJoint`, in the order in which they move the child."""


class ElementaryMotion(NamedTuple):
    """One turn or slide of a joint.

    Attributes:
        turns: True for a turn.
        axis: Its direction, of unit length (3,).
        coordinate: Name of the coordinate that moves it, "" if it does not move.
        curve: The function of the coordinate, or the constant.
        name: Its name in messages.
    """

    turns: bool
    axis: np.ndarray
    coordinate: str
    curve: Curve
    name: str

    @property
    def twist(self) -> np.ndarray:
        """Its twist in the frame that it moves (6,)."""
        return np.concatenate([np.zeros(3), self.axis] if self.turns else [self.axis, np.zeros(3)])


def coordinate_elements(joint: ET.Element) -> list[ET.Element]:
    """The `<Coordinate>` elements of a joint, in their order."""
    inside = objects(joint, "CoordinateSet") or objects(joint, "coordinates")
    return [element for element in inside if element.tag == "Coordinate"]


def factors(joint: ET.Element) -> list[ElementaryMotion]:
    """The turns and slides of a joint.

    Raises:
        ModelError: The joint is of an unsupported kind, is reversed, lacks coordinates, or has a wrong axis.
    """
    if flag(joint, "reverse", False):
        raise ModelError(f"{label(joint)} is reversed, which is not read; exchange its frames.")
    if joint.tag == "CustomJoint":
        return _custom(joint)
    if joint.tag not in _SIMPLE:
        raise ModelError(f"{label(joint)}: joints that are read are CustomJoint, {', '.join(_SIMPLE)}.")
    rows = _SIMPLE[joint.tag]
    names = [named(element) for element in coordinate_elements(joint)]
    if len(names) != len(rows):
        raise ModelError(f"{label(joint)} needs {len(rows)} coordinates, got {len(names)}: {', '.join(names)}.")
    return [
        ElementaryMotion(kind == "turn", np.eye(3)[axis], names[k], IDENTITY, f"{joint.get('name')}, {names[k]}")
        for kind, axis, k in rows
    ]


def _custom(joint: ET.Element) -> list[ElementaryMotion]:
    names = [named(element) for element in coordinate_elements(joint)]
    spatial = joint.find("SpatialTransform")
    axes = {} if spatial is None else {axis.get("name"): axis for axis in spatial.findall("TransformAxis")}
    if missing := [axis for axis in AXES if axis not in axes]:
        raise ModelError(
            f"{label(joint)} needs a <SpatialTransform> with six <TransformAxis>; {missing[0]} is missing."
        )
    return [_axis(joint, axes[axis], names) for axis in AXES]


def _axis(joint: ET.Element, element: ET.Element, names: list[str]) -> ElementaryMotion:
    """One axis of a `CustomJoint`."""
    kind = element.get("name", "")
    where = f"{joint.get('name')}, {kind}"
    direction = numbers(element, "axis", 3)
    if not direction.any():
        raise ModelError(f"{where}: {label(element)} needs an axis other than zero.")
    used = text(element, "coordinates").split()
    if len(used) > 1 or not set(used) <= set(names):
        raise ModelError(
            f"{where}: an axis moves by one coordinate of its joint at most, one of {', '.join(names) or 'none'}; got "
            f"'{' '.join(used)}'."
        )
    function = function_of(element)
    by = curve(function) if function is not None else IDENTITY if used else Curve.polynomial([0])
    if not used and (by.exact is None or by.exact.degree()):
        raise ModelError(f"{where}: a function of no coordinate is a <Constant>, got <{getattr(function, 'tag', '')}>.")
    unit = direction / np.linalg.norm(direction)
    return ElementaryMotion(kind.startswith("rotation"), unit, used[0] if used else "", by, where)


@dataclass(frozen=True)
class Link:
    """A joint of the file with its frames.

    Attributes:
        joint: The joint.
        parent: Frame F on the parent.
        child: Frame M on the child.
        factors: Its turns and slides.
    """

    joint: ET.Element
    parent: PlacedFrame
    child: PlacedFrame
    factors: list[ElementaryMotion]


def _links(model: ET.Element, frames: Frames) -> Iterator[Link]:
    """The joints of a model, from `JointSet` or, in OpenSim 3, from their child bodies."""
    joints = [(joint, "") for joint in objects(model, "JointSet")]
    for name, body in frames.bodies.items():
        inside = [child for group in body.findall("Joint") for child in group if isinstance(child.tag, str)]
        joints += [(joint, name) for joint in inside]
    for joint, carrier in joints:
        parent, child = frames.joint_ends(joint, carrier)
        if child.body == GROUND:
            raise ModelError(f"{label(joint)} needs a body for its child, got the ground; exchange its frames.")
        yield Link(joint, parent, child, factors(joint))


def links_in_order(model: ET.Element, frames: Frames) -> list[Link]:
    """The joints of a model, one for each body, parents before children and otherwise in the order of the bodies.

    Raises:
        ModelError: A joint cannot be read, closes a loop, or is not connected to the ground.
    """
    by_body: dict[str, Link] = {}
    for link in _links(model, frames):
        if link.child.body in by_body:
            raise ModelError(f"{label(link.joint)} closes a loop: another joint carries '{link.child.body}' as well.")
        by_body[link.child.body] = link
    placed, waiting, out = {GROUND}, list(frames.bodies), list[Link]()
    while waiting:
        ready = [name for name in waiting if name in by_body and by_body[name].parent.body in placed]
        if not ready:
            raise ModelError(f"No chain of joints leads from the ground to {', '.join(waiting)}.")
        placed.add(ready[0])
        waiting.remove(ready[0])
        out.append(by_body[ready[0]])
    return out
