"""MuJoCo models from URDF files: links as they are, meshes that may be missing, mimic joints, and transmissions."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from math import isfinite
from pathlib import Path
from urllib.parse import unquote, urlsplit

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.display.brief import listed
from ident.errors import ModelError
from ident.files.table import FAR
from ident.geometry.inertia import symmetric
from ident.mechanism.drives import Actuator
from sim.models.inertials import Inertial, bodies_in_order, inertial_of, set_inertials
from sim.models.notes import note, refusals
from sim.models.xml_files import parsed

SINGLE = ("revolute", "continuous", "prismatic")
"""Types of joints with one coordinate, which alone mimic and are mimicked."""

Mimics = dict[str, tuple[str, float, float]]
"""Joint that each one mimics, multiplier and offset, by the name of the one that mimics."""

REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
"""Tags of a reduction in a transmission, or in its actuator or joint: those of ROS 1 and ROS 2."""

WORLD = "world"
"""Parent link that need not be declared: MuJoCo's world."""


def taken_mimics(path: Path, root: ET.Element) -> Mimics:
    """Mimic joints of a file, whose elements are taken out of it; those of fixed joints have no effect.

    Warns:
        ModelNote: Some name joints that the file does not have, and have no effect either.

    Raises:
        ModelError: One names no joint with one coordinate, itself, or another mimic joint, or a number is not finite.
    """
    mimics, joints, astray = Mimics(), root.findall("joint"), list[str]()
    names = {joint.get("name", "") for joint in joints}
    stated = {x.get("name", ""): x.findall("mimic") for x in joints if x.get("type") in SINGLE}
    leading = [name for name, own in stated.items() if not {each.get("joint") for each in own} & names]
    for joint in joints:
        for element in joint.findall("mimic"):
            joint.remove(element)
    for name, own in stated.items():
        leads = [element.get("joint", "") for element in own]
        if len(own) == 1 and leads[0] and leads[0] not in names:
            astray.append(f"'{name}' ('{leads[0]}')")
        elif len(own) > 1 or not {*leads} <= {*leading}:
            raise ModelError(
                f"{path}: joint '{name}' has to mimic one joint that moves by itself, out of "
                f"{', '.join(each for each in leading if each != name) or 'none'}, "
                f"not {' and '.join(map(repr, leads))}{_instead(path, name, stated, leading)}."
            )
        elif own:
            mimics[name] = leads[0], *_law(path, name, own[0])
    if astray:
        note(f"{path} has no joint of the name that these mimic, so that they move by themselves: {', '.join(astray)}.")
    return mimics


def _law(path: Path, name: str, mimic: ET.Element) -> tuple[float, float]:
    """Multiplier and offset of a joint's `<mimic>`."""
    multiplier, offset = (
        _finite(mimic.get(key) or usual, f"{path}: the mimic of joint '{name}' needs a finite {key}")
        for key, usual in (("multiplier", "1"), ("offset", "0"))
    )
    return multiplier, offset


def _instead(path: Path, name: str, stated: Mapping[str, list[ET.Element]], leading: Sequence[str]) -> str:
    """The `<mimic>` that a joint needs which mimics another one's, "" if it mimics something else."""
    (first, *others), follower = stated[name], stated[name][0].get("joint", "")
    between = stated.get(follower, [])
    if others or len(between) != 1 or (lead := between[0].get("joint", "")) not in leading:
        return ""
    (a, b), (c, d) = _law(path, name, first), _law(path, follower, between[0])
    return f'; write <mimic joint="{lead}" multiplier="{a * c:.12g}" offset="{a * d + b:.12g}"/> instead'


def _finite(stated: str, needed: str, *, zero: bool = True) -> float:
    """A finite number of a file; `needed` says what is, if it is none, or zero where that is not allowed."""
    try:
        value = float(stated)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or not (value or zero):
        raise ModelError(f"{needed}, got '{stated}'.")
    return value


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
    parts = (transmission, *transmission.findall("actuator"), *transmission.findall("joint"))
    texts = ((part.findtext(tag) or "").strip() for part in parts for tag in REDUCTIONS)
    needed = "needs a reduction that is a finite number other than 0"
    return _finite(
        next(filter(None, texts), "1"), f"{path}: transmission '{transmission.get('name', '')}' {needed}", zero=False
    )


def model_from_urdf(path: str | Path, packages: Sequence[str | Path] = (), *, meshes: bool = True) -> mujoco.MjSpec:
    """Specification of a URDF file: all links stay separate bodies, including the root, and meshes may be missing.

    Inertias come from `<inertial>` only, unless the file has `<mujoco><compiler inertiafromgeom=…/></mujoco>`: in URDF
    a link without is massless. Joints may have an undeclared `world` as parent.

    Args:
        path: The file.
        packages: Folders of ROS packages that are also searched for meshes, as for `keep_meshes`.
        meshes: False to leave out all meshes.

    Returns:
        The specification, not yet compiled.

    Warns:
        ModelNote: Meshes are left out.

    Raises:
        ModelError: The file does not exist, is no URDF, has a wrong `<mimic>`, or MuJoCo cannot read it.
    """
    root = parsed(Path(path))
    if root.tag != "robot":
        raise ModelError(f"{path}: a URDF file has a <robot>, this one a <{root.tag}>.")
    if root.find("link") is None:
        raise ModelError(f"{path}: a URDF file has a <link> for every body, this one has none.")
    _declare_world(path, root)
    # Readers of MuJoCo drop some of them without a word, by its version.
    mimics = taken_mimics(Path(path), root)
    if meshes:
        keep_meshes(root, Path(path), packages)
    else:
        leave_out(root)
    extension = root.find("mujoco")
    extension = ET.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ET.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib.pop("meshdir", None)
    compiler.set("strippath", "false")
    compiler.attrib.setdefault("inertiafromgeom", "false")
    compiler.attrib.setdefault("discardvisual", "false")
    # MuJoCo would merge the root link into the world, which has no mass, and welded links into their parents.
    compiler.set("fusestatic", "false")
    links = {link.get("name"): link for link in root.findall("link") if link.find("inertial") is not None}
    with refusals(path):
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    for name, (lead, multiplier, offset) in mimics.items():
        equality = spec.add_equality(name=f"mimic_{name}", type=mujoco.mjtEq.mjEQ_JOINT, name1=name, name2=lead)
        equality.data[:5] = offset, multiplier, 0, 0, 0
    # MuJoCo 3.3 ignores the inertia's rpy, and computes principal axes to six digits only.
    ids = {body.name: b for b, body in enumerate(bodies_in_order(spec.worldbody))}
    set_inertials(spec, {ids[name]: _stated(path, link) for name, link in links.items() if name in ids})
    return spec


def _declare_world(path: str | Path, root: ET.Element) -> None:
    """Adds the world as a link if it is an undeclared parent of joints.

    Raises:
        ModelError: Another link is undeclared.
    """
    names = [link.get("name", "") for link in root.findall("link")]
    for joint in root.findall("joint"):
        for end in joint.findall("parent") + joint.findall("child"):
            name = end.get("link", "")
            if name == WORLD and end.tag == "parent" and name not in names:
                ET.SubElement(root, "link", {"name": WORLD})
                names.append(WORLD)
            elif name not in names:
                raise ModelError(
                    f"{path}: joint '{joint.get('name', '')}' has the {end.tag} '{name}', which is no link of the "
                    f"file; its links are {', '.join(names)}."
                )


def _stated(path: str | Path, link: ET.Element) -> Inertial:
    """Inertia in the `<inertial>` of a link of a URDF file."""

    def numbers(element: str, keys: str, otherwise: str) -> np.ndarray:
        child = link.find(f"inertial/{element}")
        attributes = {} if child is None else child.attrib
        stated = " ".join(attributes.get(key, "").strip() or otherwise for key in keys.split())
        try:
            values = np.array(stated.split(), float)
        except ValueError:
            values = np.array([np.nan])
        if not (abs(values) < FAR).all() or (element == "mass" and values[0] < 0):
            raise ModelError(
                f"{path}: link '{link.get('name')}' needs finite numbers and no negative mass; its {element} is "
                f"{stated}."
            )
        return values

    R = Rotation.from_euler("xyz", numbers("origin", "rpy", "0 0 0")).as_matrix()
    inertia = symmetric(numbers("inertia", "ixx iyy izz ixy ixz iyz", "0"))
    return inertial_of(numbers("mass", "value", "0")[0], numbers("origin", "xyz", "0 0 0"), R @ inertia @ R.T)


PACKAGES = ("package", "model")
"""Schemes of names in a package, as `package://PACKAGE/meshes/link.stl`."""

SEARCHED = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
"""Environment variables of ROS 1 and ROS 2 with folders that contain packages, or that are packages."""


def keep_meshes(root: ET.Element, path: Path, packages: Sequence[str | Path] = ()) -> None:
    """Keeps the usable meshes of a URDF file, under their full paths, and notes those that are left out.

    Meshes of a package are searched for in the folders of packages, next to the file, in all folders above it, and in
    those of the environment; other meshes next to the file and in the folders of packages. Visuals stay on links
    without usable collisions only, for pictures, or on all links if the file sets `discardvisual` itself.

    Args:
        root: The `<robot>`, which is changed.
        path: The file.
        packages: Folders that contain packages, or that are packages.

    Warns:
        ModelNote: Meshes are left out.
    """
    compiler = root.find("mujoco/compiler")
    own_visuals = compiler is not None and compiler.get("discardvisual") is not None
    home = path.parent if compiler is None else path.parent / compiler.get("meshdir", "")
    meshes = _Meshes([*dict.fromkeys((home, path.parent)), *map(Path, packages)], path)
    for link in root.iter("link"):
        collisions, visuals = link.findall("collision"), link.findall("visual")
        kept = [part for part in collisions if meshes.settled(part)]
        for part in collisions:
            if part not in kept:
                link.remove(part)
        for part in visuals:
            if (kept and not own_visuals) or not meshes.settled(part, missed=not collisions or own_visuals):
                link.remove(part)
    _leave_textures(root)
    meshes.note_left_out()


def leave_out(root: ET.Element) -> None:
    """Removes all visuals and collisions from a URDF file."""
    for link in root.iter("link"):
        for part in link.findall("collision") + link.findall("visual"):
            link.remove(part)
    _leave_textures(root)


def _leave_textures(root: ET.Element) -> None:
    for material in root.iter("material"):
        for texture in material.findall("texture"):
            material.remove(texture)


class _Meshes:
    """Meshes that a file names, with their paths and errors."""

    def __init__(self, near: Sequence[Path], path: Path) -> None:
        self._near, self._above = near, path.resolve().parents
        self._files: dict[str, Path | None] = {}
        self._faults: dict[tuple[Path, str], str] = {}
        self._lost: dict[str, str] = {}

    def settled(self, part: ET.Element, *, missed: bool = True) -> bool:
        """Sets the full path of the mesh of a visual or a collision; returns False if it has an unusable one.

        Args:
            part: The visual or collision.
            missed: True to note a mesh that cannot be used.
        """
        for mesh in part.iter("mesh"):
            name = mesh.get("filename", "")
            if name not in self._files:
                there = (file.absolute() for file in self._candidates(name) if _is_file(file))
                self._files[name] = next(there, None)
            file = self._files[name]
            fault = "" if file is None else self._fault(file, mesh.get("scale", ""))
            if file is None or fault:
                if missed:
                    self._lost[name] = fault
                return False
            mesh.set("filename", str(file))
        return True

    def _candidates(self, name: str) -> Iterator[Path]:
        """Candidate files for a name, the most likely first."""
        scheme, _, rest = name.partition("://") if "://" in name else ("", "", name)
        if scheme == "file":
            yield Path(unquote(urlsplit(name).path))
        elif scheme in PACKAGES:
            package, _, inside = rest.partition("/")
            yield from (folder / package / inside for folder in (*self._near, *self._above))
            for folder in _environment():
                yield from (folder / package / inside, folder / "share" / package / inside)
                yield from [folder / inside] if folder.name == package else []
            yield from (folder / inside for folder in self._above if _is_package(folder, package))
            yield from (folder / inside for folder in self._near)
        elif not scheme and name:
            yield from (folder / name for folder in self._near)
        # MuJoCo itself uses only the last part of a name.
        yield from [self._near[0] / Path(rest).name] if Path(rest).name else []

    def _fault(self, file: Path, scale: str) -> str:
        """MuJoCo's error on a mesh, "" if it can be used."""
        if (file, scale) not in self._faults:
            spec = mujoco.MjSpec()
            mesh = spec.add_mesh(name="mesh", file=str(file))
            geom = spec.worldbody.add_geom()
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, "mesh"
            try:
                mesh.scale = [float(x) for x in scale.split()] or [1, 1, 1]
                with refusals(file.name):
                    spec.compile()
                self._faults[file, scale] = ""
            except (ModelError, TypeError, ValueError) as error:
                self._faults[file, scale] = str(error)
        return self._faults[file, scale]

    def note_left_out(self) -> None:
        """Notes the meshes that cannot be used."""
        nowhere = [name for name, fault in self._lost.items() if not fault]
        faults = [fault for fault in self._lost.values() if fault]
        if nowhere:
            note(
                f"{_number(nowhere)} not found, and left out of collisions and pictures: {listed(nowhere, 3)}; "
                "--packages FOLDER names where their packages are."
            )
        if faults:
            note(
                f"{_number(faults)} not what MuJoCo reads, and left out of collisions and pictures: "
                f"{listed(faults, 3)}; STL, OBJ and MSH files will do."
            )


def _environment() -> Iterator[Path]:
    for variable in SEARCHED:
        yield from (Path(folder) for folder in os.environ.get(variable, "").split(os.pathsep) if folder)


def _is_file(path: Path) -> bool:
    """True if a file exists; False also for names that are too long."""
    with suppress(OSError):
        return path.is_file()
    return False


def _is_package(folder: Path, name: str) -> bool:
    """True if a folder is the ROS package of a name."""
    try:
        return (ET.parse(folder / "package.xml").getroot().findtext("name") or "").strip() == name
    except (OSError, ET.ParseError, LookupError, ValueError):
        return False


def _number(several: Sequence[str]) -> str:
    return "A mesh is" if len(several) == 1 else f"{len(several)} meshes are"
