"""Point and weld constraints of an OpenSim model: two points or frames on bodies that coincide."""

import xml.etree.ElementTree as ET
from collections.abc import Collection

from ident.errors import ModelError
from ident.mechanism.constraint import Coincidence
from ident.mechanism.tree import Tree
from sim.models.notes import note
from sim.models.opensim.coordinates import CLOSING, WELD, enforced
from sim.models.opensim.document import label, text
from sim.models.opensim.frames import Frames, offset, socket


def point_constraints(model: ET.Element, frames: Frames, tree: Tree, ignore: Collection[str]) -> list[Coincidence]:
    """Point and weld constraints between bodies of a tree.

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
    for element in (each for each in enforced(model, ignore) if each.tag in CLOSING):
        bodies, poses = list[str](), list[tuple[float, ...]]()
        for k in "12":
            reference = socket(element, f"frame{k}") or socket(element, f"body_{k}") or text(element, f"body_{k}")
            place = frames.place(reference, element)
            pose = place.pose @ offset(element, f"location_body_{k}", f"orientation_body_{k}")
            bodies.append(place.body)
            poses.append(tuple(pose.ravel().tolist()))
        inside = [body in tree.names for body in bodies]
        if any(inside) and not all(inside):
            raise ModelError(
                f"{label(element)} reaches outside the mechanism, whose equations lack its force; leave it out with "
                f"--ignore {element.get('name')} (in Python, ignore=['{element.get('name')}'])."
            )
        if all(inside):
            ends = (bodies[0], bodies[1]), (poses[0], poses[1])
            out.append(Coincidence(str(element.get("name")), *ends, whole=element.tag == WELD))
    if out:
        note(f"By {', '.join(each.name for each in out)}, joints without a column follow from the others.")
    return out
