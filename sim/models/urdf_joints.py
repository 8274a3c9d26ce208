"""Joints of URDF files beyond what MuJoCo reads: mimic joints, and the transmissions of their actuators."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path

import mujoco
import numpy as np

from ident.errors import ModelError
from ident.mechanism.drives import Actuator
from sim.models.notes import note
from sim.models.xml_files import parsed

SINGLE = ("revolute", "continuous", "prismatic")
"""Types of joints with one coordinate, which alone mimic and are mimicked."""

Mimics = dict[str, tuple[str, float, float]]
"""Joint that each one mimics, multiplier and offset, by the name of the one that mimics."""


def taken_mimics(path: Path, root: ET.Element) -> Mimics:
    """Mimic joints of a file, whose elements are taken out of it; those of fixed joints have no effect.

    Warns:
        ModelNote: Some name joints that the file does not have, and have no effect either.

    Raises:
        ModelError: One names no joint with one coordinate, itself, or another mimic joint, or a number is not finite.
    """
    mimics, joints = Mimics(), root.findall("joint")
    single = [joint.get("name", "") for joint in joints if joint.get("type") in SINGLE]
    names, astray = {joint.get("name", "") for joint in joints}, dict[str, str]()
    for joint in joints:
        name, own = joint.get("name", ""), joint.findall("mimic")
        for element in own:
            joint.remove(element)
        leads = [element.get("joint", "") for element in own]
        if not own or name not in single:
            continue
        if len(own) == 1 and leads[0] and leads[0] not in names:
            astray[name] = leads[0]
            continue
        if len(own) > 1 or leads[0] == name or leads[0] not in single:
            raise ModelError(
                f"{path}: joint '{name}' has to mimic one other joint out of "
                f"{', '.join(each for each in single if each != name) or 'none'}, not {' and '.join(map(repr, leads))}."
            )
        mimics[name] = leads[0], _number(path, name, own[0], "multiplier"), _number(path, name, own[0], "offset")
    if astray:
        each = ", ".join(f"'{name}' ('{lead}')" for name, lead in astray.items())
        note(f"{path} has no joint of the name that these mimic, so that they move by themselves: {each}.")
    for name in mimics:
        if mimics[name][0] in mimics:
            raise ModelError(f"{path}: {_chained(mimics, name)}")
    return mimics


def _number(path: Path, name: str, element: ET.Element, key: str) -> float:
    text = element.get(key) or {"multiplier": "1", "offset": "0"}[key]
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise ModelError(f"{path}: the mimic of joint '{name}' needs a finite {key}, got '{text}'.")
    return value


def _chained(mimics: Mapping[str, tuple[str, float, float]], name: str) -> str:
    """Sentence on a mimic of a mimic, with what to write in its place."""
    first, gain, shift = mimics[name]
    lead = first
    for _ in mimics:
        lead, own, offset = mimics[lead]
        gain, shift = gain * own, gain * offset + shift
        if lead not in mimics:
            write = f'<mimic joint="{lead}" multiplier="{gain:.6g}" offset="{shift:.6g}"/>'
            return f"joint '{name}' mimics '{first}', which mimics another joint itself; write {write}."
    return f"joint '{name}' mimics '{first}', which follows from '{name}' in turn; leave one <mimic> out."


def add_mimics(spec: mujoco.MjSpec, mimics: Mimics) -> None:
    """Adds mimic joints to a specification, as equality constraints with their joints' names."""
    for name, (lead, multiplier, offset) in mimics.items():
        each = spec.add_equality(name=f"mimic_{name}", type=mujoco.mjtEq.mjEQ_JOINT, name1=name, name2=lead)
        each.data[:5] = offset, multiplier, 0, 0, 0


REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
"""Tags of a reduction in a transmission, or in its actuator or joint: those of ROS 1 and ROS 2."""


def transmissions(path: str | Path) -> dict[str, tuple[Actuator, ...]]:
    """Actuators by their joints' names, with the reductions as gears; none for files other than URDF.

    Transmissions of several joints or actuators, such as differentials, are left out.

    Raises:
        ModelError: A reduction is no number, or zero.
    """
    root, out = parsed(Path(path)), dict[str, tuple[Actuator, ...]]()
    if root.tag != "robot":
        return out
    for element in root.iter("transmission"):
        joints, actuators = element.findall("joint"), element.findall("actuator")
        if len(joints) != 1 or len(actuators) > 1:
            continue
        joint = joints[0].get("name", "")
        name = (actuators or [element])[0].get("name", "")
        out[joint] = (*out.get(joint, ()), Actuator(name, _reduction(path, element)))
    return out


def _reduction(path: str | Path, transmission: ET.Element) -> float:
    """Reduction of a transmission, 1 if it states none."""
    stated = next(_stated(transmission), "1")
    try:
        value = float(stated)
    except ValueError:
        value = np.nan
    if not np.isfinite(value) or value == 0:
        raise ModelError(
            f"{path}: transmission '{transmission.get('name', '')}' needs a reduction that is a finite number other "
            f"than 0, got '{stated}'."
        )
    return value


def _stated(transmission: ET.Element) -> Iterator[str]:
    """Yields the texts of a transmission's reductions."""
    for element in (transmission, *transmission.findall("actuator"), *transmission.findall("joint")):
        for tag in REDUCTIONS:
            if text := (element.findtext(tag) or "").strip():
                yield text
