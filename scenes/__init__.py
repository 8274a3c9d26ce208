"""The MJCF scenes. Bodies, joint limits, servos, sensors and their noise levels are declared there and nowhere else."""

import xml.etree.ElementTree as ET
from importlib.resources import files

import mujoco
import numpy as np

NAMES = ("double_pendulum", "humanoid")
"""Names that `load` knows, one for each mechanism's MJCF file in this package."""

VARIED = ("double_pendulum",)
"""Those of them that can be tilted and touched."""

CONTACTS = ("pad", "handle")
"""Surroundings that touch the load cell at the end of the last link, one MJCF file each."""


def load(name: str, *, tilt_deg: float = 0.0, azimuth_deg: float = 0.0, contact: str | None = None) -> mujoco.MjSpec:
    """A scene as an editable specification; those in `VARIED` with a tilt or a contact on request.

    Args:
        name: One of `NAMES`.
        tilt_deg: Angle by which every hinge axis of the mechanism is turned away from its design, from X for the
            double pendulum.
        azimuth_deg: Direction towards which X turns, measured from +Y to +Z.
        contact: One of `CONTACTS`, to put a load cell at the site `end` and something to touch beside it.

    Returns:
        The specification; `.compile()` makes the model, after that `.to_xml()` the MJCF text.

    Raises:
        ValueError: The scene or the contact does not exist, the angles make no sense, or the scene has no variants.
    """
    if name not in NAMES:
        raise ValueError(f"No scene is named '{name}'; the scenes are {', '.join(NAMES)}.")
    if name not in VARIED and (tilt_deg or azimuth_deg or contact is not None):
        raise ValueError(f"The scene '{name}' has neither tilt nor contact to choose; {', '.join(VARIED)} has.")
    if contact is not None and contact not in CONTACTS:
        raise ValueError(f"No contact is named '{contact}'; the contacts are {', '.join(CONTACTS)}.")
    if not (-360 <= azimuth_deg <= 360 and 0 <= tilt_deg < 90):
        raise ValueError(
            f"A tilt needs an angle from 0° to below 90° and an azimuth of at most 360°, got {tilt_deg:.6g}° towards "
            f"{azimuth_deg:.6g}°."
        )
    root = _mjcf(name)
    hinges = [joint.get("name") for joint in root.iter("joint") if joint.get("name")]
    if contact is not None:
        link, end = next((body, site) for body in root.iter("body") for site in body.findall("site[@name='end']"))
        cell = _mjcf("load_cell")
        next(cell.iter("body")).set("pos", end.attrib["pos"])
        _merge(root, cell, link)
        _merge(root, _mjcf(contact), next(root.iter("worldbody")))
    spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    if tilt_deg:
        turn = _tilt(np.radians(tilt_deg), np.radians(azimuth_deg))
        for hinge in hinges:
            spec.joint(hinge).axis = turn @ spec.joint(hinge).axis
    return spec


def _mjcf(name: str) -> ET.Element:
    return ET.fromstring(files(__name__).joinpath(f"{name}.xml").read_text(encoding="utf-8"))


def _merge(root: ET.Element, addition: ET.Element, parent: ET.Element) -> None:
    """Adds another file's bodies to a body of this one, and its other sections to the end, as MJCF's include does."""
    for section in addition:
        if section.tag == "worldbody":
            parent.extend(section)
        else:
            root.append(section)


def _tilt(angle: float, azimuth: float) -> np.ndarray:
    """Rotation that takes X to `(cos, sin cos azimuth, sin sin azimuth)` the short way."""
    rotation = np.zeros(9)
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.array([0.0, -np.sin(azimuth), np.cos(azimuth)]), angle)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)
