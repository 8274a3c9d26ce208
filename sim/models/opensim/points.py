"""Point constraints of an OpenSim model: two points on bodies that coincide."""

import xml.etree.ElementTree as ET
from collections.abc import Collection

import numpy as np

from ident.errors import ModelError
from ident.geometry import se3
from ident.mechanism.constraint import Coincidence
from ident.mechanism.tree import Tree
from sim.models.notes import note
from sim.models.opensim.coordinates import POINT, enforced
from sim.models.opensim.document import label, numbers, text
from sim.models.opensim.frames import Frames


def point_constraints(model: ET.Element, frames: Frames, tree: Tree, ignore: Collection[str]) -> list[Coincidence]:
    """Point constraints between bodies of a tree.

    Args:
        model: The model.
        frames: Its frames.
        tree: The tree; constraints of which neither body is in it have no effect.
        ignore: Names of constraints to leave out.

    Warns:
        ModelNote: There are some.

    Raises:
        ModelError: One holds a body of the tree to the ground or another body, whose force the equations lack.
    """
    out = list[Coincidence]()
    for element in (each for each in enforced(model, ignore) if each.tag == POINT):
        bodies, poses = list[str](), list[tuple[float, ...]]()
        for end in ("body_1", "body_2"):
            reference = text(element, f"socket_{end}") or text(element, f"socket_{end}_connectee_name")
            place = frames.place(reference or text(element, end), element)
            point = se3.pose(np.eye(3), numbers(element, f"location_{end}", 3, "0 0 0"))
            bodies.append(place.body)
            poses.append(tuple((place.pose @ point).ravel().tolist()))
        inside = [body in tree.names for body in bodies]
        if any(inside) and not all(inside):
            raise ModelError(
                f"{label(element)} reaches outside the mechanism, whose equations lack its force; leave it out with "
                f"--ignore {element.get('name')} (in Python, ignore=['{element.get('name')}'])."
            )
        if all(inside):
            out.append(Coincidence(str(element.get("name")), (bodies[0], bodies[1]), (poses[0], poses[1])))
    if out:
        note(f"By {', '.join(each.name for each in out)}, joints without a column follow from the others.")
    return out
