"""Elements and numbers of OpenSim files (.osim) of versions 3 and 4, with errors that name the element."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ident.errors import ModelError
from sim.models.urdf import parsed

OLDEST = 30000
"""The oldest version of the format that is read, in the file's notation."""

LARGEST = 1e100
"""Upper limit of a model's numbers, so that products of them are finite."""


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
    """Elements of a set such as `BodySet`, in `<objects>` or, in some sets of OpenSim 4, directly."""
    group = None if parent is None else parent.find(kind)
    if group is None:
        return []
    inner = group.find("objects")
    return [child for child in (group if inner is None else inner) if isinstance(child.tag, str)]


def label(element: ET.Element) -> str:
    """Label of an element in messages: `<PinJoint name="knee">`."""
    return f'<{element.tag} name="{element.get("name", "")}">'


def text(element: ET.Element, tag: str, default: str = "") -> str:
    """Text of a child, without surrounding blanks."""
    return (element.findtext(tag) or "").strip() or default


def numbers(element: ET.Element, tag: str, size: int | None = None, default: str | None = None) -> np.ndarray:
    """Numbers in a child of an element.

    Args:
        element: The element.
        tag: Tag of the child.
        size: Required count, None for any.
        default: Default if the file leaves them out.

    Raises:
        ModelError: They are missing, not finite, or of another count.
    """
    stated = text(element, tag) or default
    try:
        values = np.array((stated or "").split(), float)
    except ValueError:
        values = np.array([np.nan])
    if stated is None or not (abs(values) < LARGEST).all() or (size is not None and len(values) != size):
        expected = "finite numbers" if size is None else "a finite number" if size == 1 else f"{size} finite numbers"
        raise ModelError(f"{label(element)} needs {expected} in <{tag}>, got '{(stated or '')[:60]}'.")
    return values


def number(element: ET.Element, tag: str, default: str | None = None) -> float:
    """The number in a child of an element; errors as for `numbers`."""
    return float(numbers(element, tag, 1, default)[0])


def flag(element: ET.Element, tag: str, default: bool) -> bool:
    """True if a child has the text `true`.

    Raises:
        ModelError: It has neither that nor `false`.
    """
    value = text(element, tag, str(default)).lower()
    if value not in ("true", "false"):
        raise ModelError(f"{label(element)} needs true or false in <{tag}>, got '{value[:60]}'.")
    return value == "true"


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
    """All descendants of an element, each with the name of its nearest named ancestor."""
    for child in element:
        if isinstance(child.tag, str):
            yield owner, child
            yield from with_owner(child, child.get("name") or owner)
