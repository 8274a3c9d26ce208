"""The MJCF scenes. Only these files declare bodies, joint limits, servos, sensors and their noise levels.

`arm.csv` is a log of the scene `arm` with a load of 0.5 kg on its tool, simulated by `docs.tools.noise_recordings`.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from importlib.resources import files
from math import radians
from typing import TYPE_CHECKING

from ident.errors import InputError

if TYPE_CHECKING:
    import mujoco
    import numpy as np

BASES = {"double_pendulum": "base", "bowing": "foot", "humanoid": "pelvis", "arm": "base"}
"""Name of the body whose frame is {0}, by scene."""

NAMES = tuple(BASES)
"""Names for `load`, one for each mechanism's MJCF file in this package."""

VARIED = ("double_pendulum",)
"""Scenes that can have a tilt and contacts."""

CONTACTS = {"pad": "end", "handle": "link1_end"}
"""Surroundings in contact with a load cell, one MJCF file each, and the load cell's site if there are several contacts.
A single contact has its load cell at the site `end` of the last link."""


def load(name: str, *, tilt_deg: float = 0.0, azimuth_deg: float = 0.0, contact: str | None = None) -> "mujoco.MjSpec":
    """Scene as an editable specification; those in `VARIED` optionally with a tilt or contacts.

    Args:
        name: One of `NAMES`.
        tilt_deg: Angle between every hinge axis of the mechanism and its design, which is X for the double pendulum.
        azimuth_deg: Direction towards which X turns, measured from +Y to +Z.
        contact: One of `CONTACTS`, or several separated by spaces, each with a load cell on another link.

    Returns:
        The specification; `.compile()` makes the model, after that `.to_xml()` the MJCF text.

    Raises:
        InputError: The scene or the contact does not exist, the angles are out of range, or the scene has no variants.
    """
    import mujoco

    if name not in NAMES:
        raise InputError(f"No scene is named '{name}'; the scenes are {', '.join(NAMES)}.")
    if name not in VARIED and (tilt_deg or azimuth_deg or contact is not None):
        raise InputError(f"The scene '{name}' has neither tilt nor contact to choose; {', '.join(VARIED)} has.")
    cells = {} if contact is None else load_cells(contact)
    root = _mjcf(name)
    hinges = [joint.get("name", "") for joint in root.iter("joint") if joint.get("name")]
    _touch(root, cells)
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    return tilted(spec, hinges, tilt_deg, azimuth_deg)


def tilted(spec: "mujoco.MjSpec", joints: Sequence[str], tilt_deg: float, azimuth_deg: float) -> "mujoco.MjSpec":
    """Turns the axes of some joints of a specification, as described for `load`, and returns it.

    Raises:
        InputError: The angles are out of range.
    """
    if not (-360 <= azimuth_deg <= 360 and 0 <= tilt_deg < 90):
        raise InputError(
            f"A tilt needs an angle from 0° to below 90° and an azimuth of at most 360°, got {tilt_deg:.6g}° towards "
            f"{azimuth_deg:.6g}°."
        )
    if tilt_deg:
        turn = _tilt(radians(tilt_deg), radians(azimuth_deg))
        for joint in joints:
            spec.joint(joint).axis = turn @ spec.joint(joint).axis
    return spec


def load_cells(contact: str) -> dict[str, str]:
    """Site of the load cell of each contact; its name is the prefix of the channels.

    Args:
        contact: One of `CONTACTS`, or several separated by spaces.

    Returns:
        In the order of `CONTACTS`: `contact` for a single one, `contact_NAME` for each of several.

    Raises:
        InputError: A contact does not exist or occurs twice.
    """
    names = contact.split()
    for name in names or [contact]:
        if name not in CONTACTS:
            raise InputError(f"No contact is named '{name}'; the contacts are {', '.join(CONTACTS)}.")
    if len(set(names)) < len(names):
        raise InputError(f"Several contacts need to be different ones, got '{contact}'.")
    return {name: f"contact_{name}" if len(names) > 1 else "contact" for name in CONTACTS if name in names}


def _touch(root: ET.Element, cells: Mapping[str, str]) -> None:
    """Adds the surroundings and their load cells to a scene; if there are several, all their names have suffixes."""
    several = len(cells) > 1
    for more in _mjcf("link1_end").iter("body") if several else ():
        next(body for body in root.iter("body") if body.get("name") == more.get("name")).extend(more)
    for surroundings, cell in cells.items():
        place = CONTACTS[surroundings] if several else "end"
        link, site = next((body, site) for body in root.iter("body") for site in body.findall(f"site[@name='{place}']"))
        suffix = cell.removeprefix("contact")
        addition = _mjcf("load_cell", suffix)
        next(addition.iter("body")).attrib.update({k: v for k, v in site.items() if k in ("pos", "euler")})
        _merge(root, addition, link)
        _merge(root, _mjcf(surroundings, suffix), next(root.iter("worldbody")))


def _mjcf(name: str, suffix: str = "") -> ET.Element:
    """Root element of one of the files, with a suffix added to the names of a load cell's elements."""
    text = files(__name__).joinpath(f"{name}.xml").read_text(encoding="utf-8")
    return ET.fromstring(re.sub('"(load_cell|tip|contact)', rf'"\1{suffix}', text))


def _merge(root: ET.Element, addition: ET.Element, parent: ET.Element) -> None:
    """Adds another file's bodies to a body of this one, and its other sections at the end, like MJCF's include."""
    for section in addition:
        if section.tag == "worldbody":
            parent.extend(section)
        else:
            root.append(section)


def _tilt(angle: float, azimuth: float) -> "np.ndarray":
    """Smallest rotation that turns X to `(cos, sin cos azimuth, sin sin azimuth)` of the angle."""
    import mujoco
    import numpy as np

    rotation = np.zeros(9)
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.array([0.0, -np.sin(azimuth), np.cos(azimuth)]), angle)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)
