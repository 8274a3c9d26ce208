"""URDF files with other inertias: numbers replaced in the file's bytes, missing elements added, all else kept."""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sim.models.inertials import Update, shortened, stated_parts
from sim.models.model_drives import SAME
from sim.models.xml_files import Edit, Element, digits, edited, root_of, text_of, with_comment

ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Attributes of `<inertia>` and their indices in the matrix."""

_WORD = re.compile(rb"\S+")


def updated_urdf(
    path: Path, links: Mapping[str, np.ndarray], dynamics: Mapping[str, Mapping[str, float]], update: Update
) -> bytes:
    """Bytes of a URDF file with other inertias of some links, and other friction and places of some joints.

    An inertia stays in the axes in which the file states it. A massless link keeps its centre of mass.

    Args:
        path: The file, which has already been read as a model.
        links: φ (10,) of the links, about their frames, by name.
        dynamics: Attributes of the joints' `<dynamics>`, by name.
        update: Comments on links with inertias, and displacements of joints.

    Raises:
        ModelError: The file is in UTF-16 or UTF-32, or has elements in entities.
    """
    data = text_of(path)
    root = root_of(path, data)
    of_links, of_joints = (_first_of_each_name(root, tag) for tag in ("link", "joint"))
    comments, displaced = update.comments, update.displaced
    edits = [e for name, phi in links.items() for e in _edits(data, of_links[name], phi, comments.get(name, ""))]
    for name in comments.keys() - links.keys():
        if (inertial := of_links[name].child("inertial")) is not None:
            edits.append(with_comment(data, inertial, comments[name]))
    for name, attributes in dynamics.items():
        edits += _dynamics_edits(data, of_joints[name], {key: [value] for key, value in attributes.items()})
    for joint in of_joints.values():
        child = joint.child("child")
        if child and (name := child.attributes.get("link", "")) in displaced:
            edits += _origin_edits(data, joint, displaced[name])
    return edited(data, edits)


def _origin_edits(data: bytes, joint: Element, shift: np.ndarray) -> Iterator[Edit]:
    """Edits that displace the origin of a joint."""
    origin = joint.child("origin")
    stated = (origin.attributes.get("xyz", "") if origin else "").split() or ["0"] * 3
    place = [x if not dx else float(x) + dx for x, dx in zip(map(float, stated), shift.tolist(), strict=True)]
    if origin is None:
        yield joint.with_first(data, b"<origin" + _attribute("xyz", place) + b"/>")
    else:
        yield from _attribute_edits(data, origin, {"xyz": place}, max(map(abs, place)))


def _first_of_each_name(root: Element, tag: str) -> dict[str, Element]:
    places: dict[str, Element] = {}
    for place in root.below(tag):
        places.setdefault(place.attributes.get("name", ""), place)
    return places


def _dynamics_edits(data: bytes, joint: Element, attributes: Mapping[str, Sequence[float]]) -> Iterator[Edit]:
    """Edits that set attributes of a joint's `<dynamics>`."""
    if (dynamics := joint.child("dynamics")) is not None:
        yield from _attribute_edits(data, dynamics, attributes, max(abs(values[0]) for values in attributes.values()))
    elif any(values[0] for values in attributes.values()):
        text = b"".join(_attribute(key, values) for key, values in attributes.items())
        yield joint.with_first(data, b"<dynamics" + text + b"/>")


def _edits(data: bytes, link: Element, phi: np.ndarray, comment: str) -> Iterator[Edit]:
    """Edits that set the φ of a link, with a comment and short numbers if there is one."""
    inertial = link.child("inertial")
    if not phi[0] and inertial is None:
        return
    mass, center, inertia = stated_parts(phi)
    R = _axes(inertial)
    inertia = R.T @ inertia @ R
    if comment and phi[0]:
        mass, center, inertia = shortened(mass, center, inertia)
    if comment and inertial is not None and not inertial.closed:
        yield with_comment(data, inertial, comment)
    numbers: dict[str, tuple[dict[str, Sequence[float]], float]] = {
        "origin": ({"xyz": center.tolist()} if phi[0] else {}, max(abs(center))),
        "mass": ({"value": [mass]}, mass),
        "inertia": ({key: [float(inertia[at])] for key, at in ENTRIES.items()}, max(abs(phi[4:]))),
    }
    missing = f"<!-- {comment} -->".encode() if comment and (inertial is None or inertial.closed) else b""
    for tag, (attributes, size) in numbers.items():
        place = None if inertial is None else inertial.child(tag)
        if place is not None:
            yield from _attribute_edits(data, place, attributes, size)
        elif any(any(values) for values in attributes.values()):
            missing += b"<" + tag.encode() + b"".join(_attribute(*each) for each in attributes.items()) + b"/>"
    if inertial is None:
        yield link.with_first(data, b"<inertial>" + missing + b"</inertial>")
    elif missing:
        yield inertial.with_first(data, missing)


def _axes(inertial: Element | None) -> np.ndarray:
    """Rotation from the axes of a stated inertia to the link's (3, 3)."""
    origin = None if inertial is None else inertial.child("origin")
    stated = "" if origin is None else origin.attributes.get("rpy", "")
    return Rotation.from_euler("xyz", np.array((stated.strip() or "0 0 0").split(), float)).as_matrix()


def _attribute_edits(
    data: bytes, place: Element, attributes: Mapping[str, Sequence[float]], size: float
) -> Iterator[Edit]:
    """Edits of the numbers that change by more than rounding, and of missing attributes."""
    missing = b""
    for key, values in attributes.items():
        span = place.attribute(data, key)
        if span is not None:
            yield from _number_edits(data, span, values, SAME * size)
        elif max(map(abs, values)) > SAME * size:
            missing += _attribute(key, values)
    if missing:
        yield place.with_attributes(data, missing)


def _number_edits(data: bytes, span: tuple[int, int], values: Sequence[float], near: float) -> Iterator[Edit]:
    """Edits of the numbers of one attribute; an empty attribute means zeros."""
    words = [match.span() for match in _WORD.finditer(data, *span)]
    if len(words) == len(values):
        for word, value in zip(words, values, strict=True):
            if not abs(_number(data[slice(*word)]) - value) <= near:
                yield Edit(*word, digits([value]).encode())
    elif words or max(map(abs, values)) > near:
        yield Edit(*span, digits(values).encode())


def _number(word: bytes) -> float:
    """A number of a file; NaN if it is written with entities."""
    try:
        return float(word)
    except ValueError:
        return np.nan


def _attribute(key: str, values: Sequence[float]) -> bytes:
    return b" " + key.encode() + b'="' + digits(values).encode() + b'"'
