"""Drives written into models: friction, rotor inertias, stiffnesses and servos, as far as a format has them."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping

import mujoco
import numpy as np

from ident.mechanism.drives import Drive, checked_drives
from sim.models.model_drives import acting_on, freedom_names, law
from sim.models.names import joint_name, name_of
from sim.models.xml_places import digits

ATTRIBUTES = {"damping": "viscous", "frictionloss": "coulomb", "armature": "rotor", "stiffness": "stiffness"}
"""Attributes of a joint in MJCF, and those of a `Drive`."""

DYNAMICS = {"damping": "damping", "frictionloss": "friction"}
"""Attributes of `<dynamics>` in URDF by those of MJCF."""

SAME = 1e-12
"""Relative difference that counts as rounding."""


def changed_drives(model: mujoco.MjModel, drives: Mapping[str, Drive]) -> dict[int, dict[str, float]]:
    """New values of MJCF's attributes of joints, by the joints' ids; those of a ball are means over its freedoms.

    Args:
        model: The model, compiled.
        drives: Drives by the names of freedoms; joints without one stay as they are.

    Raises:
        ModelError: There is no such freedom, or a number is negative or not finite.
    """
    names = {j: freedom_names(model, j) for j in range(model.njnt)}
    checked_drives(drives, [name for own in names.values() for name in own])
    changed = dict[int, dict[str, float]]()
    for j, own in names.items():
        if not (given := [drives[name] for name in own if name in drives]):
            continue
        new = {key: float(np.mean([getattr(each, of) for each in given])) for key, of in ATTRIBUTES.items()}
        old = _stated(model, j)
        if values := {key: x for key, x in new.items() if abs(x - old[key]) > SAME * max(abs(x), abs(old[key]))}:
            changed[j] = values
    return changed


def changed_servos(model: mujoco.MjModel, drives: Mapping[str, Drive]) -> dict[int, tuple[float, float]]:
    """New gains kp and kv of position actuators, by the actuators' ids; arguments as for `changed_drives`."""
    changed = dict[int, tuple[float, float]]()
    for j in range(model.njnt):
        if (drive := drives.get(joint_name(model, j))) is None:
            continue
        new = {each.name: (each.kp, each.kv) for each in drive.actuators if each.kind == "position"}
        for a in acting_on(model, j):
            old, name = law(model, a), name_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR, a)
            if old.get("kp") and name in new and not np.allclose(new[name], (old["kp"], old["kv"]), rtol=SAME, atol=0):
                changed[a] = new[name]
    return changed


def state_servos(root: ET.Element, changed: Mapping[int, tuple[float, float]]) -> None:
    """Sets the gains of position actuators of an MJCF document, whatever their classes have."""
    actuators = [each for section in root.findall("actuator") for each in section]
    for a, (kp, kv) in changed.items():
        if actuators[a].tag == "position":
            actuators[a].attrib.pop("dampratio", None)
            actuators[a].attrib |= {"kp": digits([kp]), "kv": digits([kv])}
        else:
            actuators[a].attrib |= {"gainprm": digits([kp]), "biasprm": digits([0, -kp, -kv])}


def _stated(model: mujoco.MjModel, j: int) -> dict[str, float]:
    """Values of `ATTRIBUTES` of a joint in a compiled model."""
    dof = int(model.jnt_dofadr[j])
    of_dofs = {"damping": model.dof_damping, "frictionloss": model.dof_frictionloss, "armature": model.dof_armature}
    return {key: float(np.ravel(x[dof])[0]) for key, x in of_dofs.items()} | {
        "stiffness": float(np.ravel(model.jnt_stiffness[j])[0])
    }


def state_drives(root: ET.Element, changed: Mapping[int, Mapping[str, float]]) -> None:
    """Sets attributes of joints of an MJCF document, whatever their classes have."""
    bodies = [body for world in root.findall("worldbody") for body in world.iter("body")]
    joints = [joint for body in bodies for joint in _own_joints(body)]
    for j, values in changed.items():
        for key, value in values.items():
            joints[j].set(key, digits([value]))
        if {"damping", "stiffness"} & values.keys():
            joints[j].attrib.pop("springdamper", None)


def _own_joints(element: ET.Element) -> Iterator[ET.Element]:
    """Joints of a body, or of a frame in it, but not of the bodies on it."""
    for child in element:
        if child.tag in ("joint", "freejoint"):
            yield child
        elif child.tag == "frame":
            yield from _own_joints(child)


def urdf_dynamics(model: mujoco.MjModel, changed: Mapping[int, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """New values of the attributes of `<dynamics>` in URDF by joint, which has neither rotor inertias nor springs."""
    each = ((j, {DYNAMICS[key]: x for key, x in own.items() if key in DYNAMICS}) for j, own in changed.items())
    return {joint_name(model, j): own for j, own in each if own}
