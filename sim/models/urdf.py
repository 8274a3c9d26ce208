"""MuJoCo models from URDF files, without fusing links and without requiring meshes."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ModelError
from ident.geometry.inertia import symmetric
from sim.models.inertials import Inertial, bodies_in_order, inertial_of, set_inertials
from sim.models.notes import refusals
from sim.models.urdf_joints import add_mimics, taken_mimics
from sim.models.urdf_meshes import keep_meshes, leave_out
from sim.models.xml_files import parsed

LARGEST = 1e100
"""Upper limit of an inertia's numbers, so that products of them are finite."""

WORLD = "world"
"""Parent link that need not be declared: MuJoCo's world."""


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
    add_mimics(spec, mimics)
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
        if not (abs(values) < LARGEST).all() or (element == "mass" and values[0] < 0):
            raise ModelError(
                f"{path}: link '{link.get('name')}' needs finite numbers and no negative mass; its {element} is "
                f"{stated}."
            )
        return values

    R = Rotation.from_euler("xyz", numbers("origin", "rpy", "0 0 0")).as_matrix()
    inertia = symmetric(numbers("inertia", "ixx iyy izz ixy ixz iyz", "0"))
    return inertial_of(numbers("mass", "value", "0")[0], numbers("origin", "xyz", "0 0 0"), R @ inertia @ R.T)
