"""OpenSim files (.osim) of versions 3 and 4: their elements, and numbers in them, with errors that name the place."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ident.errors import ModelError
from sim.models.urdf import parsed

OLDEST = 30000
"""The first version of the format that is read, as the file states it."""

LARGEST = 1e100
"""Numbers of a model are smaller, so that products of them are finite."""


def model_element(path: Path) -> ET.Element:
    """The `<Model>` of an OpenSim file.

    Raises:
        ModelError: The file does not exist, is no XML, no OpenSim model, or older than version 3.
    """
    root = parsed(path)
    model = root.find("Model")
    if root.tag != "OpenSimDocument" or model is None:
        raise ModelError(f"{path}: an OpenSim file is an <OpenSimDocument> with a <Model>, this one a <{root.tag}>.")
    version = root.get("Version", "")
    if not version.isdecimal() or int(version) < OLDEST:
        raise ModelError(
            f"{path}: files of OpenSim 3 and later are read (Version {OLDEST} or more), this one is '{version}'; let "
            "OpenSim open and save it."
        )
    return model


def objects(parent: ET.Element | None, kind: str) -> list[ET.Element]:
    """What a set such as `BodySet` of an element holds, in `<objects>` or, as OpenSim 4 has it in places, directly."""
    group = None if parent is None else parent.find(kind)
    if group is None:
        return []
    inner = group.find("objects")
    return [child for child in (group if inner is None else inner) if isinstance(child.tag, str)]


def label(element: ET.Element) -> str:
    """How an element is called in a message: `<PinJoint name="knee">`."""
    return f'<{element.tag} name="{element.get("name", "")}">'


def text(element: ET.Element, tag: str, default: str = "") -> str:
    """Text of a child, without blanks around it."""
    return (element.findtext(tag) or "").strip() or default


def numbers(element: ET.Element, tag: str, size: int | None = None, default: str | None = None) -> np.ndarray:
    """Numbers that a child of an element holds.

    Args:
        element: The element.
        tag: The child's.
        size: How many there have to be, None for any number.
        default: What a file that leaves them out means.

    Raises:
        ModelError: They are missing, no finite numbers, or of another number.
    """
    stated = text(element, tag) or default
    try:
        values = np.array((stated or "").split(), float)
    except ValueError:
        values = np.array([np.nan])
    if stated is None or not (abs(values) < LARGEST).all() or (size is not None and len(values) != size):
        wanted = "finite numbers" if size is None else "a finite number" if size == 1 else f"{size} finite numbers"
        raise ModelError(f"{label(element)} needs {wanted} in <{tag}>, got '{(stated or '')[:60]}'.")
    return values


def number(element: ET.Element, tag: str, default: str | None = None) -> float:
    """The number that a child holds; errors as for `numbers`."""
    return float(numbers(element, tag, 1, default)[0])


def flag(element: ET.Element, tag: str, default: bool) -> bool:
    """Whether a child says `true`."""
    return text(element, tag, str(default)).lower() == "true"


def named(element: ET.Element) -> str:
    """Name of an element.

    Raises:
        ModelError: It has none.
    """
    name = element.get("name", "").strip()
    if not name:
        raise ModelError(f"Every <{element.tag}> of an OpenSim model needs a name; one has none.")
    return name


def with_owner(element: ET.Element, owner: str = "") -> Iterator[tuple[str, ET.Element]]:
    """All elements below one, each with the name of the nearest one above it that has a name."""
    for child in element:
        if isinstance(child.tag, str):
            yield owner, child
            yield from with_owner(child, child.get("name") or owner)
