"""Files about marked models: settings of markers, OpenSim's models, and models written with a person's lengths."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np

from ident.annotations import Needs, Point, Positive, one_of
from ident.errors import InputError, ModelError, about
from ident.files.atomic import replacing
from ident.files.limits import made, toml
from ident.files.table import UNITS
from ident.mechanism.body import BASE, Body, Follower
from ident.tolerances import ROUNDING
from sim.models.inertials import remove_overrides
from sim.models.model_update import set_asset_folders
from sim.models.notes import refusals
from sim.models.opensim.reading import mechanism_from_opensim
from sim.models.xml_files import digits

UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
}
"""Rotations from a laboratory whose vertical axis is the key to one with Z upwards."""


@dataclass(frozen=True)
class MarkerPlace:
    """Site or position of a marker on the model.

    Attributes:
        site: Name of a site, "" if a body is named.
        body: Name of a body, "" if a site is named.
        position: Position in the body's frame, m; None if a site is named.
        weight: Weight of the squared distance.
    """

    site: str = ""
    body: str = ""
    position: Point | None = None
    weight: Positive = 1.0

    def __post_init__(self) -> None:
        if self.site and (self.body or self.position is not None):
            raise InputError("needs a site, or a body with a position, got both.")
        if bool(self.body) != (self.position is not None):
            raise InputError("needs the name of a body and a position [x, y, z] in m on it.")


@dataclass(frozen=True)
class ScaleTable:
    """Table `[scale]`.

    Attributes:
        groups: Names of bodies that share a scale factor.
    """

    groups: Annotated[tuple[tuple[str, ...], ...], Needs("a list of lists of bodies", lambda _: True)] = ()


@dataclass(frozen=True)
class Settings:
    """Settings of a file.

    Attributes:
        unit: Unit of a table, None if not stated.
        up: Axis of the laboratory that points up, None if not stated.
        markers: Sites or positions of markers, by label.
        scale: Bodies that share a scale factor.
    """

    unit: Annotated[str, one_of(UNITS["length"])] | None = None
    up: Annotated[str, one_of(UP)] | None = None
    markers: Mapping[str, MarkerPlace] = field(default_factory=dict)
    scale: ScaleTable = ScaleTable()


def read_settings(path: Path) -> Settings:
    """Reads a file of settings.

    Raises:
        InputError: The file is missing or malformed; the message names the entry.
    """
    entries = toml(path, "settings of markers need")
    with about(path):
        settings = made(Settings, "", entries)
    named = {k: x if x.site or x.body else replace(x, site=k) for k, x in settings.markers.items()}
    return replace(settings, markers=named)


def opensim_spec(
    path: str | Path, fix: Mapping[str, Sequence[float]]
) -> tuple[mujoco.MjSpec, dict[str, Follower], str]:
    """The bodies of an OpenSim file, with its markers as sites.

    Args:
        path: The file.
        fix: Coordinates that do not move, each with its value, or empty for its default.

    Returns:
        The specification, not yet compiled; functions of followers, by the joints' names; and the axis of the ground
        that points up, `x`, `y` or `z`.

    Raises:
        ModelError: Something in the file cannot be read; the message names it.
    """
    arm = mechanism_from_opensim(path, fix=fix)
    spec, followers = mujoco.MjSpec(), dict[str, Follower]()
    spec.compiler.degree = False
    bodies: list[mujoco.MjsBody] = []
    for body in arm.tree.bodies:
        parent = spec.worldbody if body.parent == BASE else bodies[body.parent]
        bodies.append(_added(parent, body, arm.ranges.get(body.joint)))
        if body.follows:
            followers[f"{body.name}:follows"] = body.follows
    places = dict(zip(arm.tree.names, bodies, strict=True))
    for name, (carrier, pose) in arm.sites.items():
        places[carrier].add_site(name=name, pos=pose[:3, 3])
    return spec, followers, "xyz"[int(np.abs(arm.gravity).argmax())] if arm.gravity.any() else "y"


def _added(parent: mujoco.MjsBody, body: Body, limits: tuple[float, float] | None) -> mujoco.MjsBody:
    """Adds a body with its joint to another one, and returns it."""
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(body.home[:3, :3]).ravel())
    out = parent.add_body(name=body.name, pos=body.home[:3, 3], quat=quat)
    out.explicitinertial = True
    # MuJoCo needs some, kg and kg m².
    out.mass, out.inertia = 1e-3, np.full(3, 1e-3)
    if not body.moves:
        return out
    linear, angular = body.twist[:3], body.twist[3:]
    joint = out.add_joint(name=body.joint or f"{body.name}:follows")
    if body.turns:
        joint.type, joint.axis, joint.pos = mujoco.mjtJoint.mjJNT_HINGE, angular, np.cross(angular, linear)
    else:
        joint.type, joint.axis = mujoco.mjtJoint.mjJNT_SLIDE, linear
    if limits is not None:
        joint.range, joint.limited = limits, mujoco.mjtLimited.mjLIMITED_TRUE
    return out


def write_scaled(path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Writes a specification with the positions and inertias of a model of the same bodies, with all digits.

    Args:
        path: MJCF file to write; its folder must exist. Meshes and textures are those of the specification.
        spec: The specification, compiled before.
        model: The model with other lengths.

    Raises:
        ModelError: MuJoCo does not read the file back as the model.
    """
    with refusals("The model"):
        root = ET.fromstring(spec.to_xml())
    remove_overrides(root)
    bodies = [body for world in root.findall("worldbody") for body in (world, *world.iter("body"))]
    for b, body in enumerate(bodies):
        _place(model, b, body)
    set_asset_folders(root, spec, Path(spec.modelfiledir), path.parent)
    with replacing(path) as temporary:
        temporary.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
        with refusals(path):
            written = mujoco.MjModel.from_xml_path(str(temporary))
        _check(path, written, model)


def _place(model: mujoco.MjModel, b: int, body: ET.Element) -> None:
    """Sets the numbers of a body and of its joints, sites, geoms and inertia."""
    if b:
        _set(body, pos=model.body_pos[b], quat=model.body_quat[b])
    joints = [each for each in body if each.tag in ("joint", "freejoint")]
    for j, joint in zip(np.flatnonzero(model.jnt_bodyid == b), joints, strict=True):
        if joint.tag == "joint" and model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE:
            _set(joint, pos=model.jnt_pos[j], axis=model.jnt_axis[j])
    for s, site in zip(np.flatnonzero(model.site_bodyid == b), body.findall("site"), strict=True):
        _set(site, pos=model.site_pos[s], quat=model.site_quat[s])
    for g, geom in zip(np.flatnonzero(model.geom_bodyid == b), body.findall("geom"), strict=True):
        if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH:
            _set(geom, pos=model.geom_pos[g], size=model.geom_size[g])
    for old in body.findall("inertial"):
        body.remove(old)
    if b and model.body_mass[b]:
        inertial = ET.Element("inertial", mass=repr(float(model.body_mass[b])))
        _set(inertial, pos=model.body_ipos[b], quat=model.body_iquat[b], diaginertia=model.body_inertia[b])
        body.insert(0, inertial)


def _set(element: ET.Element, **numbers: Iterable[float]) -> None:
    """Sets attributes with all digits."""
    for key, values in numbers.items():
        element.set(key, digits(values))


def _check(path: Path, written: mujoco.MjModel, model: mujoco.MjModel) -> None:
    """Refuses a file whose model differs from the given one."""
    for name in ("body_pos", "body_quat", "jnt_pos", "jnt_axis", "site_pos", "body_mass", "body_ipos", "body_inertia"):
        a, b = getattr(written, name), getattr(model, name)
        rows = slice(1, None) if name.startswith("body") else slice(None)
        if a.shape != b.shape or (np.abs(a - b)[rows] > ROUNDING * max(1.0, float(np.abs(b).max(initial=0.0)))).any():
            raise ModelError(f"{path}: MuJoCo does not read the scaled model back as it was written ({name}).")
