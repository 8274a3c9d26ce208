"""OpenSim files with other inertias: masses, centres and inertias replaced in the file's bytes, with all else kept."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import InputError, ModelError
from ident.files.atomic import replacing
from ident.geometry.inertia import entries
from ident.mechanism.mechanism import Mechanism
from sim.models.inertials import Update, is_physical, stated_parts
from sim.models.opensim.elements import Frames, model_element, text
from sim.models.opensim.joints import links_in_order
from sim.models.opensim.reading import MOMENTS, OpenSimOrigin, body_parameters
from sim.models.xml_files import Edit, Element, digits, edited, root_of, with_comment

BODIES = ("Model", "BodySet", "objects", "Body")
"""Path of tags from below the root to a body."""


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
    before = Frames(model_element(origin.path)).bodies
    names, phi = mechanism.bodies, update.phi
    if phi.shape != (10 * len(names),) or not np.isfinite(phi).all() or not set(names) <= set(before):
        raise InputError(
            f"The bodies {', '.join(names)} need {10 * len(names)} finite parameters, welds kept, got {phi.shape}."
        )
    new = dict(zip(names, phi.reshape(-1, 10), strict=True))
    changed = {
        name: own
        for name, own in new.items()
        if not np.allclose(own, body_parameters(before[name]), rtol=1e-12, atol=0)
    }
    for name, own in changed.items():
        if own.any() and not is_physical(own):
            raise InputError(f"The parameters of '{name}' are not those of a physical body.")
    with replacing(path) as temporary:
        temporary.write_bytes(_replaced(origin.path, changed, update))
        after = Frames(model_element(temporary)).bodies
        for name, own in new.items():
            if abs(body_parameters(after[name]) - own).max() > update.tolerance * abs(own).max():
                raise ModelError(f"{path}: the parameters of '{name}' do not read back as they were written.")


def _replaced(path: Path, bodies: Mapping[str, np.ndarray], update: Update) -> bytes:
    """Bytes of a file with other φ (10,) of some bodies, comments, and displaced joints."""
    data, comments = path.read_bytes(), update.comments
    places: dict[str, Element] = {}
    for body in root_of(path, data).below(*BODIES):
        places.setdefault(body.attributes.get("name", "").strip(), body)
    edits = [edit for name, phi in bodies.items() for edit in _edits(data, places[name], phi, short=name in comments)]
    noted = [with_comment(data, places[name], text) for name, text in comments.items()]
    moved = [_offset_edit(path, data, name, shift) for name, shift in update.displaced.items()]
    return edited(data, [*noted, *edits, *moved])


def _offset_edit(path: Path, data: bytes, body: str, shift: np.ndarray) -> Edit:
    """Edit that displaces the joint that carries a body, in the frame of the body's parent."""
    model, root = model_element(path), root_of(path, data)
    link = next(each for each in links_in_order(model, Frames(model)) if each.child.body == body)
    inside = [group for each in root.below(*BODIES) for group in each.below("Joint")]
    joints = [each for group in (*root.below("Model", "JointSet", "objects"), *inside) for each in group.children]
    joint = next(each for each in joints if each.attributes.get("name") == link.joint.get("name"))
    frame = text(link.joint, "socket_parent_frame").rpartition("/")[2]
    for place, names in (
        (joint, ("location_in_parent", "orientation_in_parent")),
        *((each, ("translation", "orientation")) for each in joint.below("frames", "PhysicalOffsetFrame")),
    ):
        stated = place.child(names[0])
        if stated is None or (place is not joint and place.attributes.get("name") != frame):
            continue
        numbers = [np.array(data[x.inside : x.end].split(), float) for x in map(place.child, names) if x]
        own = Rotation.from_euler("XYZ", numbers[1] if len(numbers) > 1 else np.zeros(3)).as_matrix()
        turned = own @ link.parent.pose[:3, :3].T @ shift
        return Edit(stated.inside, stated.end, digits(numbers[0] + turned).encode())
    raise ModelError(f"{path}: the joint that carries '{body}' has no offset frame of its own; add one on its parent.")


def _edits(data: bytes, body: Element, phi: np.ndarray, *, short: bool) -> Iterator[Edit]:
    """Edits of a file's bytes that set a body's φ."""
    mass, center, inertia = stated_parts(phi, short=short)
    numbers: dict[str, Sequence[float]] = {"mass": [mass], "mass_center": center.tolist()}
    if body.child("inertia") or not any(child.tag.startswith("inertia_") for child in body.children):
        numbers["inertia"] = entries(inertia).tolist()
    else:
        numbers |= {f"inertia_{key}": [x] for key, x in zip(MOMENTS, entries(inertia).tolist(), strict=True)}
    missing = b""
    for tag, values in numbers.items():
        words = digits(values).encode()
        whole = b"<" + tag.encode() + b">" + words + b"</" + tag.encode() + b">"
        place = body.child(tag)
        if place is None:
            missing += whole
        elif place.closed:
            yield Edit(place.start, place.inside, whole)
        else:
            yield Edit(place.inside, place.end, words)
    if missing:
        yield body.with_first(data, missing)
