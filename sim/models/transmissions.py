"""Actuators of the transmissions in URDF files, which MuJoCo does not read."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ident.errors import ModelError
from ident.mechanism.drives import Actuator
from sim.models.urdf import parsed

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
