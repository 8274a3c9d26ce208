"""URDF files as MuJoCo models, without what MuJoCo does to them: fused links, meshes that have to be there."""

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ModelError
from ident.geometry.inertia import symmetric
from sim.models.inertials import Inertial, bodies_in_order, inertial_of, set_inertials
from sim.models.refusals import refusals

LARGEST = 1e100
"""Numbers of an inertia are smaller, so that products of them are finite."""


def model_from_urdf(path: str | Path) -> mujoco.MjSpec:
    """A URDF file as it comes: all links stay bodies of their own, also the root, and meshes need not be there.

    Visuals and collisions that are meshes are left out, and inertias come from `<inertial>` alone, unless the file's
    own `<mujoco><compiler inertiafromgeom=…/></mujoco>` asks for more: a link without has no mass in URDF.

    Args:
        path: The file.

    Returns:
        The specification, not yet compiled.

    Raises:
        ModelError: The file does not exist, is no URDF, or MuJoCo cannot read it.
    """
    root = parsed(Path(path))
    if root.tag != "robot":
        raise ModelError(f"{path}: a URDF file has a <robot>, this one a <{root.tag}>.")
    if root.find("link") is None:
        raise ModelError(f"{path}: a URDF file has a <link> for every body, this one has none.")
    for link in root.iter("link"):
        for part in link.findall("visual") + link.findall("collision"):
            if part.find(".//mesh") is not None:
                link.remove(part)
    for material in root.iter("material"):
        for texture in material.findall("texture"):
            material.remove(texture)
    extension = root.find("mujoco")
    extension = ET.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ET.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib.setdefault("inertiafromgeom", "false")
    # MuJoCo would merge the root link into the world, which has no mass, and links with their welded carriers.
    compiler.set("fusestatic", "false")
    links = {link.get("name"): link for link in root.findall("link") if link.find("inertial") is not None}
    with refusals(path):
        spec = mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))
    # MuJoCo 3.3 leaves the inertia's rpy out, and finds principal axes to six digits only.
    ids = {body.name: b for b, body in enumerate(bodies_in_order(spec.worldbody))}
    set_inertials(spec, {ids[name]: _stated(path, link) for name, link in links.items() if name in ids})
    return spec


def _stated(path: str | Path, link: ET.Element) -> Inertial:
    """What a link of a URDF file says in its `<inertial>`."""

    def numbers(element: str, keys: str, otherwise: str) -> np.ndarray:
        found = link.find(f"inertial/{element}")
        attributes = {} if found is None else found.attrib
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


def parsed(path: Path) -> ET.Element:
    """Root element of an MJCF, URDF or OpenSim file, comments kept.

    Raises:
        ModelError: The file does not exist, is no XML, or has a name that MuJoCo cannot be told.
    """
    if not path.is_file():
        raise ModelError(f"A model is an MJCF, URDF or OpenSim file that exists, got '{path}'.")
    if str(path).encode(errors="replace").decode() != str(path):
        raise ModelError(f"The name of a model file has to be text in UTF-8, got {str(path)!r}; rename it.")
    try:
        return ET.parse(path, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot()
    except (ET.ParseError, LookupError, ValueError) as error:
        # The last two are of encodings that are unknown, no text, or of several bytes.
        raise ModelError(f"{path}: no XML that can be read: {error}.") from None
