"""OpenSim files with other inertias and places of joints, all other bytes kept."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ident.display.brief import INTERVALS
from ident.errors import InputError, ModelError
from ident.files.atomic import replacing
from ident.geometry.inertia import entries
from ident.mechanism.mechanism import Mechanism
from sim.models.inertials import Update, differs, is_physical, stated_parts
from sim.models.opensim.elements import Frames, model_element, offset, text
from sim.models.opensim.joints import Link, links_in_order
from sim.models.opensim.reading import MOMENTS, OpenSimOrigin, body_parameters
from sim.models.xml_files import ModelFile, parsed, restated, set_comment, text_of


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
    before = frames.bodies
    names, phi = mechanism.bodies, update.phi
    if phi.shape != (10 * len(names),) or not np.isfinite(phi).all() or not set(names) <= set(before):
        raise InputError(
            f"The bodies {', '.join(names)} need {10 * len(names)} finite parameters, welds kept, got {phi.shape}."
        )
    new = dict(zip(names, phi.reshape(-1, 10), strict=True))
    changed = {name: own for name, own in new.items() if differs(own, body_parameters(before[name]))}
    for name, own in changed.items():
        if own.any() and not is_physical(own):
            raise InputError(f"The parameters of '{name}' are not those of a physical body.")
        _state(before[name], own, short=name in update.comments)
    for name in changed.keys() | update.comments.keys():
        set_comment(before[name], INTERVALS, update.comments.get(name, ""))
    links = {link.child.body: link for link in links_in_order(model, frames)} if update.displaced else {}
    for name, shift in update.displaced.items():
        _displace(origin.path, links[name], shift)
    with replacing(path) as temporary:
        temporary.write_bytes(file.changed())
        after = Frames(model_element(temporary, parsed(temporary))).bodies
        for name, own in new.items():
            if abs(body_parameters(after[name]) - own).max() > update.tolerance * abs(own).max():
                raise ModelError(f"{path}: the parameters of '{name}' do not read back as they were written.")


def _displace(path: Path, link: Link, shift: np.ndarray) -> None:
    """Displaces a joint in the frame of the body that it is on."""
    frame = text(link.joint, "socket_parent_frame").rpartition("/")[2]
    offsets = [each for each in link.joint.iterfind("frames/PhysicalOffsetFrame") if each.get("name") == frame]
    places = [(link.joint, "location_in_parent", "orientation_in_parent")]
    for place in (*places, *((each, "translation", "orientation") for each in offsets)):
        if (stated := place[0].find(place[1])) is not None:
            own = offset(*place)
            _set(stated, own[:3, 3] + own[:3, :3] @ link.parent.pose[:3, :3].T @ shift)
            return
    body = link.child.body
    raise ModelError(f"{path}: the joint that carries '{body}' has no offset frame of its own; add one on its parent.")


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
