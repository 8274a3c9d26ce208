"""URDF files with other inertias: numbers replaced in the file's bytes, missing elements added, all else kept."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from sim.models.inertials import Update, shortened, stated_parts
from sim.models.xml_files import SAME, ModelFile, digits, restated, text_of

ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Attributes of `<inertia>` and their indices in the matrix."""


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
    file = ModelFile(path, text_of(path))
    # Of those with one name the first counts.
    of_links, of_joints = (
        {each.get("name", ""): each for each in reversed(file.root.findall(tag))} for tag in ("link", "joint")
    )
    for name, phi in links.items():
        _state(of_links[name], phi, short=name in update.comments)
    update.comment(links, lambda name: of_links[name].find("inertial"))
    for name, attributes in dynamics.items():
        values = {key: [value] for key, value in attributes.items()}
        _set(of_joints[name], 0, "dynamics", values, max(map(abs, attributes.values())))
    for joint in of_joints.values():
        child = joint.find("child")
        if child is not None and (name := child.get("link", "")) in update.displaced:
            origin = joint.find("origin")
            stated = "" if origin is None else origin.get("xyz", "")
            place = np.array(stated.split() or np.zeros(3), float) + update.displaced[name]
            _set(joint, 0, "origin", {"xyz": place.tolist()}, abs(place).max())
    return file.changed()


def _state(link: ET.Element, phi: np.ndarray, *, short: bool) -> None:
    """States the φ of a link, perhaps with short numbers."""
    inertial = link.find("inertial")
    if inertial is None:
        if not phi[0]:
            return
        inertial = ET.Element("inertial")
        link.insert(0, inertial)
    mass, center, inertia = stated_parts(phi)
    R = _axes(inertial)
    inertia = R.T @ inertia @ R
    if short and phi[0]:
        mass, center, inertia = shortened(mass, center, inertia)
    if phi[0]:
        _set(inertial, 0, "origin", {"xyz": center.tolist()}, max(abs(center)))
    _set(inertial, 1, "mass", {"value": [mass]}, mass)
    moments = {key: [float(inertia[at])] for key, at in ENTRIES.items()}
    _set(inertial, 2, "inertia", moments, max(abs(phi[4:])))


def _axes(inertial: ET.Element) -> np.ndarray:
    """Rotation from the axes of a stated inertia to the link's (3, 3)."""
    origin = inertial.find("origin")
    stated = "" if origin is None else origin.get("rpy", "")
    return Rotation.from_euler("xyz", np.array(stated.split() or np.zeros(3), float)).as_matrix()


def _set(parent: ET.Element, index: int, tag: str, attributes: Mapping[str, Sequence[float]], size: float) -> None:
    """Sets attributes of a child, to rounding relative to a size; zeros are not stated where nothing is."""
    child = parent.find(tag)
    if child is None:
        if any(any(values) for values in attributes.values()):
            parent.insert(index, ET.Element(tag, {key: digits(values) for key, values in attributes.items()}))
        return
    for key, values in attributes.items():
        if key in child.attrib or max(map(abs, values)) > SAME * size:
            child.set(key, restated(child.get(key), values, size))
