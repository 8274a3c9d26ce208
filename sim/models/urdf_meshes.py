"""Meshes of URDF files: search for their files, and removal of those that are missing or that MuJoCo cannot read."""

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote, urlsplit

import mujoco

from ident.display.brief import listed
from ident.errors import ModelError
from sim.models.notes import note, refusals

PACKAGES = ("package", "model")
"""Schemes of names in a package, as `package://PACKAGE/meshes/link.stl`."""

SEARCHED = ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")
"""Environment variables of ROS 1 and ROS 2 with folders that contain packages, or that are packages."""

NAMED = 3
"""Number of meshes that a note names at most."""


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
                f"{_number(nowhere)} not found, and left out of collisions and pictures: {listed(nowhere, NAMED)}; "
                "--packages FOLDER names where their packages are."
            )
        if faults:
            note(
                f"{_number(faults)} not what MuJoCo reads, and left out of collisions and pictures: "
                f"{listed(faults, NAMED)}; STL, OBJ and MSH files will do."
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
