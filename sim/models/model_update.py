"""Models with other inertial parameters: φ written into MJCF, URDF and OpenSim files, with all else unchanged."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeAlias

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import WORDS, typed
from ident.arguments import check_type, checked_target, described
from ident.errors import InputError, ModelError
from ident.files.atomic import replacing
from ident.geometry.inertia import entries
from ident.mechanism.drives import Drive
from ident.mechanism.mechanism import Mechanism
from ident.tolerances import ROUNDING
from sim.models.inertials import (
    Inertial,
    Update,
    bodies_in_order,
    by_body,
    check_physical,
    compiled_as_stated,
    inertial_of,
    overrides,
    remove_overrides,
    set_inertials,
    shortened,
    stated_parts,
)
from sim.models.model_drives import bodies_of, changed_drives, changed_servos, state_drives, state_servos, urdf_dynamics
from sim.models.model_mechanism import Origin
from sim.models.mujoco_model import body_parameters, mechanism_bodies, parameters_from_model
from sim.models.notes import body_name, refusals
from sim.models.opensim_model import OpenSimOrigin, is_opensim, write_opensim
from sim.models.urdf import model_from_urdf
from sim.models.xml_files import ModelFile, digits, parsed, restated, text_of

Editable: TypeAlias = mujoco.MjSpec | str | Path
"""A model that can be updated: a specification, or the path of an MJCF or URDF file."""

EXPANDED = ("include", "replicate", "attach", "composite", "flexcomp")
"""Elements of MJCF that generate bodies which the file does not list."""

ENTRIES = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
"""Attributes of `<inertia>` and their indices in the matrix."""

Stated = tuple[float, np.ndarray, np.ndarray]
"""Mass, centre of mass, and inertia about it."""


class Bodies(Protocol):
    """An object with a φ, such as `ident.parameters.consistency.ConsistentParameters`.

    If it has `comments` on the bodies too, these are written beside them, and numbers are short.
    """

    @property
    def phi(self) -> np.ndarray:
        """Stacked φ (10 b,)."""


@typed("phi")
def updated_spec(mechanism: Mechanism, phi: np.ndarray | Bodies) -> mujoco.MjSpec:
    """The model of a mechanism with other inertial parameters.

    Compiler settings that would change them (`inertiafromgeom`, `settotalmass`, …) are switched off; bodies outside the
    mechanism then state their previous inertias explicitly.

    Args:
        mechanism: The mechanism, from a specification, which is copied, or from a file.
        phi: φ of its bodies, with welds not merged (10 b,), or an object with a φ.

    Returns:
        The specification, compiled.

    Raises:
        ModelError: The mechanism is from a compiled model or none, or MuJoCo cannot read or compile the model.
        InputError: φ does not fit its bodies, or a body is not physical.
    """
    origin, source, phi = _given(mechanism, phi)
    spec = specification(source, origin.packages)
    _write_into(spec, _inertials(spec, origin, phi))
    _check(_compiled(spec, source), "The model", phi, origin)
    return spec


@typed("path", "mechanism", "phi")
def write_model(
    path: str | Path,
    mechanism: Mechanism,
    phi: np.ndarray | Bodies,
    drives: Mapping[str, Drive] | None = None,
    displaced: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Writes the model of a mechanism with other inertial parameters: URDF or OpenSim by the suffix, else MJCF.

    Only numbers with another value change, missing elements are added, and every other byte of the file stays; so does
    a body whose φ differs by rounding only. In MJCF a new inertia is stated by its principal axes, in another folder
    the folders of meshes and textures change as well, and settings of the compiler that override inertias are removed.
    Files with `EXPANDED` elements, specifications, and URDF as MJCF are written by MuJoCo, which rounds numbers other
    than these to six digits.

    Args:
        path: File to write; its folder must exist.
        mechanism: The mechanism, from a URDF or an OpenSim file if that is to be written.
        phi: φ of its bodies, with welds not merged (10 b,), or an object with a φ.
        drives: Friction, rotor inertias, stiffnesses and gains of position actuators by joint, as
            `Estimate.drives_updated`; by default they stay as they are. URDF has friction only, and of OpenSim's files
            drives stay as they are.
        displaced: Displacements of joints in their parents' frames, m (3,), by the names of the bodies that they carry,
            as `Estimate.displaced`; by default joints stay where they are.

    Raises:
        ModelError: As for `updated_spec`, the file does not read back as φ, or a drive is negative or of no joint.
        InputError: As for `updated_spec`, a URDF or OpenSim file is requested for a model in another format, or a
            displacement is none.
    """
    path = checked_target(path, "the path of a file to write")
    check_type("mechanism", mechanism, Mechanism, WORDS["Mechanism"])
    if unknown := [body for body in displaced or {} if body not in mechanism.tree.names]:
        names = ", ".join(mechanism.tree.names)
        raise InputError(
            f"displaced needs the names of bodies that joints carry, got '{unknown[0]}'; bodies are {names}."
        )
    update = Update(_numbers(phi), drives or {}, displaced or {}, getattr(phi, "comments", {}))
    if isinstance(mechanism.source, OpenSimOrigin):
        write_opensim(path, mechanism, update)
        return
    origin, source, _ = _given(mechanism, phi)
    if is_opensim(path):
        raise InputError(f"An OpenSim file can only be made from an OpenSim file; write '{path.stem}.xml' instead.")
    urdf = path.suffix.lower() == ".urdf"
    if urdf and (isinstance(source, mujoco.MjSpec) or not _is_urdf(source)):
        raise InputError(f"A URDF file can only be made from a URDF file; write '{path.stem}.xml' instead.")
    data = _urdf(origin, update) if urdf else _mjcf(origin, source, update, path.parent)
    with replacing(path) as temporary:
        temporary.write_bytes(data)
        spec = model_from_urdf(temporary, meshes=False) if urdf else specification(temporary)
        _check(_compiled(spec, path, as_stated=urdf), path, update.phi, origin, update.tolerance)


def _given(mechanism: Mechanism, phi: np.ndarray | Bodies) -> tuple[Origin, Editable, np.ndarray]:
    """Origin of a mechanism, its editable file or specification, and φ."""
    origin = mechanism.source
    if isinstance(origin, OpenSimOrigin):
        raise ModelError(f"{origin.path}: an OpenSim file has no MuJoCo specification; it is written by write_model.")
    if not isinstance(origin, Origin) or origin.text is None:
        raise ModelError(
            "Only a model that came as a file or as a specification can be updated, not a compiled one or none."
        )
    return origin, origin.text, _numbers(phi)


def _numbers(phi: np.ndarray | Bodies) -> np.ndarray:
    """φ as an array.

    Raises:
        InputError: It has no numbers.
    """
    try:
        return np.asarray(getattr(phi, "phi", phi), float)
    except (TypeError, ValueError):
        needed = "phi needs φ of the bodies (10 b,), or an object with a φ, such as estimate.consistent()"
        raise InputError(f"{needed}; got {described(phi)}.") from None


def specification(source: Editable, packages: Sequence[Path] = ()) -> mujoco.MjSpec:
    """A copy of a specification, or the specification of an MJCF or URDF file, with meshes from folders of packages.

    Raises:
        ModelError: The file does not exist, or MuJoCo cannot read it.
    """
    if isinstance(source, mujoco.MjSpec):
        return source.copy()
    if _is_urdf(source):
        return model_from_urdf(source, packages)
    with refusals(source):
        return mujoco.MjSpec.from_file(str(source))


def _members(origin: Origin) -> dict[str, int]:
    """Ids of the bodies of a mechanism, by name."""
    return {body_name(origin.model, b): b for b in mechanism_bodies(origin.model, origin.base, origin.beyond)}


def _changed(origin: Origin, members: Mapping[str, int], update: Update) -> dict[str, np.ndarray]:
    """φ (10,) of the bodies that differ from those of the model, by name."""
    return update.changed([*members], lambda name: body_parameters(origin.model, members[name]))


def _inertials(spec: mujoco.MjSpec, origin: Origin, phi: np.ndarray) -> dict[int, Inertial]:
    """Inertias to write, by the bodies' ids: those of the mechanism, and others that would change otherwise."""
    model, members, inertials = origin.model, _members(origin), dict[int, Inertial]()
    if overrides(spec):
        for b in set(range(1, model.nbody)) - set(members.values()):
            body = model.body(b)
            inertials[b] = Inertial(body.mass[0], body.ipos.copy(), body.iquat.copy(), body.inertia.copy())
    for name, own in by_body([*members], phi).items():
        check_physical(name, own)
        inertials[members[name]] = inertial_of(*stated_parts(own))
    return inertials


def _write_into(spec: mujoco.MjSpec, inertials: dict[int, Inertial]) -> None:
    if overrides(spec):
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        spec.compiler.settotalmass, spec.compiler.balanceinertia = -1, False
        spec.compiler.boundmass = spec.compiler.boundinertia = 0
    set_inertials(spec, inertials)


def _mjcf(origin: Origin, source: Editable, update: Update, folder: Path) -> bytes:
    """Content of an updated MJCF file in a folder."""
    members, spec = _members(origin), specification(source, origin.packages)
    overriding, changed = overrides(spec), _changed(origin, members, update)
    inertials = _inertials(spec, origin, update.phi)
    _write_into(spec, inertials)
    _compiled(spec, source)
    if isinstance(source, mujoco.MjSpec) or _is_generated(parsed(Path(source))):
        file = ModelFile(Path("The model"), spec.to_xml().encode())
    else:
        file = ModelFile(Path(source), text_of(Path(source)))
        if not overriding:
            inertials = {members[name]: inertials[members[name]] for name in changed}
    root, bodies = file.root, bodies_of(file.root)
    phi = by_body([*members], update.phi)
    short = {members[name]: stated_parts(phi[name], short=True) for name in update.comments}
    for b, inertial in inertials.items():
        _state(bodies[b], inertial, short.get(b))
    update.comment(changed, lambda name: bodies[members[name]])
    if overriding:
        remove_overrides(root)
    _displace(bodies, spec, {members[name]: shift for name, shift in update.displaced.items()})
    state_drives(root, changed_drives(origin.model, update.drives))
    state_servos(root, changed_servos(origin.model, update.drives))
    home = Path(spec.modelfiledir if isinstance(source, mujoco.MjSpec) else Path(source).parent)
    if isinstance(source, mujoco.MjSpec) or home.resolve() != folder.resolve():
        set_asset_folders(root, spec, home, folder)
    return file.changed()


def _is_generated(root: ET.Element) -> bool:
    """True if a file does not list the bodies of its model as MJCF."""
    return root.tag == "robot" or any(root.find(f".//{tag}") is not None for tag in EXPANDED)


def _state(body: ET.Element, inertial: Inertial, short: Stated | None) -> None:
    """States the inertia of a body, with short numbers if there are any."""
    mass, pos, quat, moments = inertial
    numbers: dict[str, Iterable[float]] = {"mass": [mass], "pos": pos, "quat": quat, "diaginertia": moments}
    if short is not None:
        mass, pos, inertia = short
        numbers = {"mass": [mass], "pos": pos, "fullinertia": entries(inertia)}
    stated = body.find("inertial")
    if stated is None:
        stated = ET.Element("inertial")
        body.insert(0, stated)
    stated.attrib = {key: restated(stated.get(key), values) for key, values in numbers.items()}


def _displace(bodies: Mapping[int, ET.Element], spec: mujoco.MjSpec, shifts: Mapping[int, np.ndarray]) -> None:
    """Displaces bodies, by their ids, in the frames of their parents; the file may state them in frames of its own."""
    specified = list(bodies_in_order(spec.worldbody))
    for b, shift in shifts.items():
        own = specified[b]
        stated = own.pos.copy()
        # MuJoCo 3.3 does not tell whether a body has a frame.
        if getattr(own, "frame", own) is not None:
            # Steps along the axes in which the file states the place, as MuJoCo turns them into the parent's.
            places = []
            for step in (*np.eye(3), np.zeros(3)):
                own.pos = stated + step
                places.append(spec.compile().body_pos[b].copy())
            shift = (np.array(places[:3]) - places[3]) @ shift
        bodies[b].set("pos", restated(bodies[b].get("pos"), stated + shift))


def set_asset_folders(root: ET.Element, spec: mujoco.MjSpec, home: Path, folder: Path) -> None:
    """Sets the folders of meshes and textures to those of a specification in `home`, for a file in another folder.

    They are relative, so that both may be moved, where the two have more than the root in common.
    """
    if not root.findall("asset/*[@file]"):
        return
    for compiler in root.findall("compiler"):
        for key in ("assetdir", "meshdir", "texturedir"):
            compiler.attrib.pop(key, None)
    folders = {key: _from(folder.resolve(), (home / getattr(spec, key)).resolve()) for key in ("meshdir", "texturedir")}
    root.insert(0, ET.Element("compiler", folders))


def _from(folder: Path, other: Path) -> str:
    """Path of another folder, relative to one if they have more than the root in common."""
    near = folder.anchor == other.anchor and len(Path(os.path.commonpath([folder, other])).parts) > 1
    return Path(os.path.relpath(other, folder)).as_posix() if near else str(other)


def _urdf(origin: Origin, update: Update) -> bytes:
    """Content of a mechanism's URDF file with φ of the bodies that change; the others may be unphysical."""
    dynamics = urdf_dynamics(origin.model, changed_drives(origin.model, update.drives))
    return _updated_urdf(Path(str(origin.text)), _changed(origin, _members(origin), update), dynamics, update)


def _check(model: mujoco.MjModel, what: object, phi: np.ndarray, origin: Origin, tolerance: float = 1e-9) -> None:
    """Raises an error unless a model has φ, to a tolerance relative to each body's largest parameter."""
    written = parameters_from_model(model, origin.base, origin.beyond)
    if written.shape == phi.shape:
        error, size = (np.abs(x).reshape(-1, 10).max(axis=1) for x in (written - phi, phi))
        if (error <= tolerance * size).all():
            return
    raise ModelError(f"{what}: MuJoCo does not read the parameters back as they were written.")


def _compiled(spec: mujoco.MjSpec, source: Editable, *, as_stated: bool = False) -> mujoco.MjModel:
    name = "The model" if isinstance(source, mujoco.MjSpec) else source
    if as_stated:
        return compiled_as_stated(spec, name)
    with refusals(name):
        return spec.compile()


def _is_urdf(path: str | Path) -> bool:
    return parsed(Path(path)).tag == "robot"


def _updated_urdf(
    path: Path, links: Mapping[str, np.ndarray], dynamics: Mapping[str, Mapping[str, float]], update: Update
) -> bytes:
    """Bytes of a URDF file with other inertias of some links, and other friction and places of some joints.

    An inertia stays in the axes in which the file states it. A massless link keeps its centre of mass.

    Args:
        path: The file, which has already been read as a model.
        links: φ (10,) of the links, about their frames, by name.
        dynamics: Attributes of the joints' `<dynamics>`, by name.
        update: Comments on links with inertias, and displacements of joints.

    Raises:
        ModelError: The file is in UTF-16 or UTF-32, or has elements in entities.
    """
    file = ModelFile(path, text_of(path))
    # Of those with one name the first counts.
    of_links, of_joints = (
        {each.get("name", ""): each for each in reversed(file.root.findall(tag))} for tag in ("link", "joint")
    )
    for name, phi in links.items():
        _state_link(of_links[name], phi, short=name in update.comments)
    update.comment(links, lambda name: of_links[name].find("inertial"))
    for name, attributes in dynamics.items():
        values = {key: [value] for key, value in attributes.items()}
        _set_child(of_joints[name], 0, "dynamics", values, max(map(abs, attributes.values())))
    carrying = {each.get("link", ""): joint for joint in of_joints.values() for each in joint.iterfind("child")}
    for name, shift in update.displaced.items():
        place = _of_origin(carrying[name], "xyz") + shift
        _set_child(carrying[name], 0, "origin", {"xyz": place.tolist()}, abs(place).max())
    return file.changed()


def _state_link(link: ET.Element, phi: np.ndarray, *, short: bool) -> None:
    """States the φ of a link, perhaps with short numbers."""
    inertial = link.find("inertial")
    if inertial is None:
        if not phi[0]:
            return
        inertial = ET.Element("inertial")
        link.insert(0, inertial)
    mass, center, inertia = stated_parts(phi)
    R = Rotation.from_euler("xyz", _of_origin(inertial, "rpy")).as_matrix()
    inertia = R.T @ inertia @ R
    if short and phi[0]:
        mass, center, inertia = shortened(mass, center, inertia)
    if phi[0]:
        _set_child(inertial, 0, "origin", {"xyz": center.tolist()}, max(abs(center)))
    _set_child(inertial, 1, "mass", {"value": [mass]}, mass)
    moments = {key: [float(inertia[at])] for key, at in ENTRIES.items()}
    _set_child(inertial, 2, "inertia", moments, max(abs(phi[4:])))


def _of_origin(element: ET.Element, key: str) -> np.ndarray:
    """Position, `xyz`, or angles, `rpy`, in the `<origin>` of an inertia or a joint, zero if it states none (3,)."""
    origin = element.find("origin")
    stated = "" if origin is None else origin.get(key, "")
    return np.array(stated.split() or np.zeros(3), float)


def _set_child(
    parent: ET.Element, index: int, tag: str, attributes: Mapping[str, Sequence[float]], size: float
) -> None:
    """Sets attributes of a child, to rounding relative to a size; zeros are not stated where nothing is."""
    child = parent.find(tag)
    if child is None:
        if any(any(values) for values in attributes.values()):
            parent.insert(index, ET.Element(tag, {key: digits(values) for key, values in attributes.items()}))
        return
    for key, values in attributes.items():
        if key in child.attrib or max(map(abs, values)) > ROUNDING * size:
            child.set(key, restated(child.get(key), values, size))
