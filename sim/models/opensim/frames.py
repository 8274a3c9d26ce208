"""Frames of an OpenSim model: bodies, the ground, and frames offset from others, by the names that joints use."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ModelError
from ident.geometry import se3
from sim.models.opensim.document import label, named, numbers, objects, text, with_owner

GROUND = "ground"


@dataclass(frozen=True)
class Place:
    """A frame on a body.

    Attributes:
        body: Name of the body, `GROUND` for the ground.
        pose: Pose of the frame in the body's (4, 4).
    """

    body: str
    pose: np.ndarray


class Frames:
    """Frames of a model by name, with their poses."""

    def __init__(self, model: ET.Element) -> None:
        self.bodies = {named(element): element for element in objects(model, "BodySet") if element.tag == "Body"}
        self.bodies.pop(GROUND, None)
        self._offsets = {
            (owner, named(element)): element
            for owner, element in with_owner(model)
            if element.tag == "PhysicalOffsetFrame"
        }

    def joint_ends(self, joint: ET.Element, carrier: str = "") -> tuple[Place, Place]:
        """The frames F on the parent and M on the child that a joint connects.

        Args:
            joint: The joint.
            carrier: Name of the joint's child body, in files of OpenSim 3, where joints are inside bodies.

        Raises:
            ModelError: A frame is not in the model.
        """
        if carrier:
            parent = self.place(text(joint, "parent_body"), joint)
            return Place(parent.body, offset(joint, "location_in_parent", "orientation_in_parent")), Place(
                carrier, offset(joint, "location", "orientation")
            )
        return self.place(socket(joint, "parent_frame"), joint), self.place(socket(joint, "child_frame"), joint)

    def place(self, reference: str, user: ET.Element, below: tuple[str, ...] = ()) -> Place:
        """Body and pose of a frame that an element refers to by a name or path, as `/bodyset/pelvis` or `hip_offset`.

        Raises:
            ModelError: There is no such frame, there are several, or frames depend on each other in a circle.
        """
        *owners, name = reference.split("/")
        if name == GROUND or name in self.bodies:
            return Place(name, np.eye(4))
        owner = owners[-1] if owners and owners[-1] not in ("", "..", ".") else user.get("name", "")
        alike = [key for key in self._offsets if key[1] == name]
        key = (owner, name) if (owner, name) in alike else alike[0] if len(alike) == 1 else None
        if key is None or reference in below:
            raise ModelError(
                f"{label(user)} needs a frame of the model; '{reference}' is {'several' if len(alike) > 1 else 'none'}."
            )
        element = self._offsets[key]
        parent = self.place(socket(element, "parent"), element, (*below, reference))
        return Place(parent.body, parent.pose @ offset(element, "translation", "orientation"))


def markers(model: ET.Element, frames: Frames) -> dict[str, Place]:
    """Markers of a model by their names."""
    out = {}
    for element in objects(model, "MarkerSet"):
        reference = text(element, "body") or socket(element, "parent_frame")
        place = frames.place(reference, element)
        shift = se3.pose(np.eye(3), numbers(element, "location", 3, "0 0 0"))
        out[named(element)] = Place(place.body, place.pose @ shift)
    return out


def socket(element: ET.Element, name: str) -> str:
    """Name or path in a socket of an element; earlier files of OpenSim 4 have another tag for it."""
    return text(element, f"socket_{name}") or text(element, f"socket_{name}_connectee_name")


def offset(element: ET.Element, position: str, angles: str) -> np.ndarray:
    """A pose from a position and body-fixed x, y, z angles."""
    turns = Rotation.from_euler("XYZ", numbers(element, angles, 3, "0 0 0"))
    return se3.pose(turns.as_matrix(), numbers(element, position, 3, "0 0 0"))
