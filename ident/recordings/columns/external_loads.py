"""OpenSim's ExternalLoads: the columns of force, point and moment of each plate, and the body on it."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ident.errors import LogError
from ident.files.table import short
from ident.recordings.columns.plates import AUTO

LOADS = ".xml"
"""Suffix of OpenSim's files of external loads."""

GROUND = ("", "ground", "/ground")
"""OpenSim's names for the ground's frame, in which forces and points must be expressed."""

SIDES = (("_r", "_l"), ("_l", "_r"))
"""Ends of the names of bodies on the right and the left."""

QUANTITIES = {"force": "force_identifier", "point": "point_identifier", "free_moment": "torque_identifier"}
"""Elements that hold the prefix of the columns' names; x, y and z follow."""


def external_loads(path: Path, bodies: Sequence[str]) -> dict[str, Any]:
    """Entries as in a mapping file: a plate for each `<ExternalForce>`, in the world's axes.

    Such files easily name the wrong foot. The body on a plate is therefore found by its force, among the named bodies
    and their counterparts on the other side; a note says where the file has another.

    Args:
        path: The file.
        bodies: Names of the mechanism's bodies.

    Raises:
        LogError: The file is missing or malformed, has no force, or one that is not in the ground's frame, lacks
            columns, or acts on a body that the mechanism does not have.
    """
    try:
        root = ET.parse(path).getroot()
    except OSError:
        raise LogError(f"{path}: OpenSim's ExternalLoads are an XML file that exists.") from None
    except (ET.ParseError, LookupError, ValueError) as error:
        raise LogError(f"{path}: no XML that can be read: {error}.") from None
    loads = root if root.tag == "ExternalLoads" else root.find("ExternalLoads")
    forces = [] if loads is None else [force for force in loads.iter("ExternalForce") if _acts(force)]
    if not forces:
        raise LogError(
            f"{path}: OpenSim's ExternalLoads have an <ExternalForce> that acts, this <{root.tag}> has none."
        )
    try:
        named = {force.get("name", "") or f"plate{k}": force for k, force in enumerate(forces, start=1)}
        if len(named) < len(forces):
            raise LogError("every <ExternalForce> needs a name of its own.")
        stated = {name: _body(name, force, bodies) for name, force in named.items()}
        among = _with_other_sides(list(stated.values()), bodies)
        return {"wrenches": {name: _plate(name, force, stated[name], among) for name, force in named.items()}}
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def _plate(name: str, force: ET.Element, body: str, among: Sequence[str]) -> dict[str, Any]:
    """Entry of one force."""
    for frame in ("force_expressed_in_body", "point_expressed_in_body"):
        if (stated := _text(force, frame)) not in GROUND:
            raise LogError(f"<ExternalForce name=\"{name}\"> needs the ground as its {frame}, got '{short(stated)}'.")
    entry: dict[str, Any] = {"frame": "world"}
    for quantity, tag in QUANTITIES.items():
        if not (begin := _text(force, tag)):
            raise LogError(f'<ExternalForce name="{name}"> needs a <{tag}>, what the names of its columns begin with.')
        entry[quantity] = [f"{begin}{axis}" for axis in "xyz"]
    if len(among) == 1:
        return entry | {"on": body}
    return entry | {"on": AUTO, "among": list(among), "expected": body}


def _body(name: str, force: ET.Element, bodies: Sequence[str]) -> str:
    """Body that a force acts on, by the file."""
    body = _text(force, "applied_to_body").rpartition("/")[2]
    if body not in bodies:
        raise LogError(
            f"<ExternalForce name=\"{name}\"> acts on '{short(body)}', which is no body of the model; those are "
            f"{', '.join(bodies)}."
        )
    return body


def _with_other_sides(named: Sequence[str], bodies: Sequence[str]) -> list[str]:
    """Bodies and their counterparts on the other side, each once."""
    both = [body.removesuffix(end) + other for body in named for end, other in SIDES if body.endswith(end)]
    return list(dict.fromkeys([*named, *(body for body in both if body in bodies)]))


def _acts(force: ET.Element) -> bool:
    return _text(force, "appliesForce") != "false" and _text(force, "isDisabled") != "true"


def _text(element: ET.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()
