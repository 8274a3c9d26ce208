"""Drives of joints in MuJoCo's models, read and written: friction, rotor inertia, springs and actuators."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.mechanism.drives import NO_DRIVE, Actuator, Drive, checked_drives
from ident.tolerances import ROUNDING
from sim.models.notes import joint_name, name_of, note
from sim.models.xml_files import restated

_FREE, _BALL = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
_ON_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_FIXED_GAIN, _NO_DYNAMICS = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtDyn.mjDYN_NONE)
_BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))


def drives_of_model(
    model: mujoco.MjModel, freedoms: Collection[str], transmissions: Mapping[str, Sequence[Actuator]] | None = None
) -> dict[str, Drive]:
    """Drives of those freedoms that have one, as `mj_inverse` takes them, by the freedoms' names.

    Args:
        model: The compiled model, with defaults and classes in its numbers.
        freedoms: Names of the freedoms of a tree.
        transmissions: Further actuators by their joints' names.

    Warns:
        ModelNote: A spring or a friction is not linear, an actuator's rotor or friction is not on a hinge or slide, or
            its force is no linear function of command, length and velocity.
    """
    joints = [j for j in range(model.njnt) if set(freedom_names(model, j)) & set(freedoms)]
    out: dict[str, Drive] = {}
    for j in joints:
        names, geared = freedom_names(model, j), (transmissions or {}).get(joint_name(model, j), ())
        actuators = (*_actuators(model, j), *geared) if len(names) == 1 else ()
        for name, drive in zip(names, _drives(model, j, actuators), strict=True):
            if drive != NO_DRIVE and name in freedoms:
                out[name] = drive
    _note_left_out(model, joints)
    return out


def freedom_names(model: mujoco.MjModel, j: int) -> tuple[str, ...]:
    """Names of a joint's freedoms in the tree of the model, in the order of MuJoCo's velocities."""
    name, kind = joint_name(model, j), model.jnt_type[j]
    slides = tuple(f"{name}:{axis}" for axis in "xyz") if kind == _FREE else ()
    return (*slides, *(f"{name}.{axis}" for axis in "xyz")) if kind in (_FREE, _BALL) else (name,)


def _drives(model: mujoco.MjModel, j: int, actuators: tuple[Actuator, ...]) -> Iterator[Drive]:
    """The drives of a joint's freedoms."""
    first, stiffness = int(model.jnt_dofadr[j]), float(model.jnt_stiffness[j])
    for dof, reference in enumerate(_references(model, j), first):
        yield Drive(
            viscous=float(model.dof_damping[dof]),
            coulomb=float(model.dof_frictionloss[dof]),
            rotor=float(model.dof_armature[dof]),
            stiffness=stiffness,
            springref=float(reference) if stiffness else 0.0,
            actuators=actuators,
        )


def _references(model: mujoco.MjModel, j: int) -> np.ndarray:
    """Coordinates of a joint's freedoms at which its spring is at rest."""
    at, kind = model.qpos_spring[model.jnt_qposadr[j] :], model.jnt_type[j]
    slides, size = (3, 4) if kind == _FREE else (0, 4) if kind == _BALL else (1, 0)
    turned = Rotation.from_quat(at[slides : slides + size], scalar_first=True).as_rotvec() if size else []
    return np.concatenate([at[:slides], turned])


def _actuators(model: mujoco.MjModel, j: int) -> Iterator[Actuator]:
    """Actuators on a hinge or slide, also by fixed tendons."""
    for a in acting_on(model, j):
        own: dict[str, Any] = {
            "gear": float(model.actuator_gear[a, 0]),
            "rotor": float(_values(model, "actuator_armature", a)[0]),
            "viscous": float(_values(model, "actuator_damping", a)[0]),
            "forcerange": tuple(model.actuator_forcerange[a].tolist()) if model.actuator_forcelimited[a] else None,
        }
        yield Actuator(name_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR, a), **own, **law(model, a))
    for a in np.flatnonzero(model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)).tolist():
        t = int(model.actuator_trnid[a, 0])
        wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
        if j in [model.wrap_objid[w] for w in wraps if model.wrap_type[w] == mujoco.mjtWrap.mjWRAP_JOINT]:
            # Its force depends on other joints as well.
            yield Actuator(name_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR, a), gain=0.0)


def law(model: mujoco.MjModel, a: int) -> dict[str, Any]:
    """Gains of an actuator's force, all zero if it is not linear in command, length and velocity."""
    linear = model.actuator_gaintype[a] == _FIXED_GAIN and model.actuator_biastype[a] in _BIASES
    if not linear or model.actuator_dyntype[a] != _NO_DYNAMICS or model.actuator_plugin[a] >= 0:
        return {"gain": 0.0}
    bias, kp, kv = model.actuator_biasprm[a, :3].tolist()
    return {"gain": float(model.actuator_gainprm[a, 0]), "kp": 0.0 - kp, "kv": 0.0 - kv, "bias": bias}


def acting_on(model: mujoco.MjModel, j: int) -> list[int]:
    """Ids of the actuators on a joint."""
    on_joints = np.isin(model.actuator_trntype, _ON_JOINTS)
    return np.flatnonzero(on_joints & (model.actuator_trnid[:, 0] == j)).tolist()


def _values(model: mujoco.MjModel, key: str, at: int) -> np.ndarray:
    """Numbers of one element in an array of the model, zero where MuJoCo's version has no such array."""
    return np.atleast_1d(getattr(model, key)[at]) if hasattr(model, key) else np.zeros(1)


def _note_left_out(model: mujoco.MjModel, joints: Sequence[int]) -> None:
    """Notes joints with springs, friction or rotors that their drives leave out."""
    if odd := [joint_name(model, j) for j in joints if _has_more(model, j)]:
        note(
            f"The drives of {', '.join(odd)} are more than a spring, friction and a rotor with one number each; "
            "predicted joint torques leave the rest out."
        )
    acting = {a: name_of(model, mujoco.mjtObj.mjOBJ_ACTUATOR, a) for j in joints for a in acting_on(model, j)}
    if names := [name for a, name in acting.items() if not law(model, a)["gain"]]:
        note(
            f"The forces of {', '.join(names)} are no gain times a command less linear feedback; they are not computed "
            "from commands."
        )


def _has_more(model: mujoco.MjModel, j: int) -> bool:
    """True if a joint has a spring, friction or a rotor that its drive leaves out."""
    acting, dof = acting_on(model, j), int(model.jnt_dofadr[j])
    places = [("jnt_stiffnesspoly", j), ("jnt_springyield", j), ("dof_dampingpoly", dof)]
    places += [("actuator_dampingpoly", a) for a in acting]
    if model.jnt_type[j] in (_FREE, _BALL):
        places += [(f"actuator_{key}", a) for key in ("armature", "damping") for a in acting]
    return any(_values(model, *place).any() for place in places)


ATTRIBUTES = {"damping": "viscous", "frictionloss": "coulomb", "armature": "rotor", "stiffness": "stiffness"}
"""Attributes of a joint in MJCF, and those of a `Drive`."""


def stated_at(model: mujoco.MjModel, key: str, j: int) -> tuple[np.ndarray, int]:
    """Array of a compiled model with one of `ATTRIBUTES`, and the place of a joint's first number in it."""
    of_joint = key == "stiffness"
    return getattr(model, f"{'jnt' if of_joint else 'dof'}_{key}"), j if of_joint else int(model.jnt_dofadr[j])


DYNAMICS = {"damping": "damping", "frictionloss": "friction"}
"""Attributes of `<dynamics>` in URDF by those of MJCF."""


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
        old = {key: float(np.ravel(array[at])[0]) for key in new for array, at in [stated_at(model, key, j)]}
        if values := {key: x for key, x in new.items() if abs(x - old[key]) > ROUNDING * max(abs(x), abs(old[key]))}:
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
            if (
                old.get("kp")
                and name in new
                and not np.allclose(new[name], (old["kp"], old["kv"]), rtol=ROUNDING, atol=0)
            ):
                changed[a] = new[name]
    return changed


def bodies_of(root: ET.Element) -> dict[int, ET.Element]:
    """Bodies of an MJCF document by their ids, without the world."""
    return dict(enumerate((body for world in root.findall("worldbody") for body in world.iter("body")), 1))


def state_servos(root: ET.Element, changed: Mapping[int, tuple[float, float]]) -> None:
    """Sets the gains of position actuators of an MJCF document, whatever their classes have."""
    actuators = [each for section in root.findall("actuator") for each in section if isinstance(each.tag, str)]
    for a, (kp, kv) in changed.items():
        own = actuators[a]
        if own.tag == "position":
            own.attrib.pop("dampratio", None)
            gains: dict[str, list[float]] = {"kp": [kp], "kv": [kv]}
        else:
            gains = {"gainprm": [kp], "biasprm": [0.0, -kp, -kv]}
        own.attrib |= {key: restated(own.get(key), numbers) for key, numbers in gains.items()}


def state_drives(root: ET.Element, changed: Mapping[int, Mapping[str, float]]) -> None:
    """Sets attributes of joints of an MJCF document, whatever their classes have."""
    joints = [joint for body in bodies_of(root).values() for joint in _own_joints(body)]
    for j, values in changed.items():
        for key, value in values.items():
            joints[j].set(key, restated(joints[j].get(key), [value]))
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
