"""Joints of an OpenSim model with their child bodies, from the ground outwards."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import dataclass

from ident.errors import ModelError
from sim.models.opensim.document import label, objects
from sim.models.opensim.frames import GROUND, Frames, Place
from sim.models.opensim.joints import Factor, factors


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
    parent: Place
    child: Place
    factors: list[Factor]


def _links(model: ET.Element, frames: Frames) -> Iterator[Link]:
    """The joints of a model, from `JointSet` or, in OpenSim 3, from their child bodies."""
    joints = [(joint, "") for joint in objects(model, "JointSet")]
    joints += [(joint, name) for name, body in frames.bodies.items() for joint in _inside(body)]
    for joint, carrier in joints:
        parent, child = frames.joint_ends(joint, carrier)
        if child.body == GROUND:
            raise ModelError(f"{label(joint)} needs a body for its child, got the ground; exchange its frames.")
        yield Link(joint, parent, child, factors(joint))


def _inside(body: ET.Element) -> list[ET.Element]:
    """The joint elements inside a body of OpenSim 3."""
    return [child for group in body.findall("Joint") for child in group if isinstance(child.tag, str)]


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
