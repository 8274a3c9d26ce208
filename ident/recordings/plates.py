"""Force plates and handles that rest in the world, from entries of a mapping file or OpenSim's ExternalLoads."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.annotations import NotNegative
from ident.arguments import is_number
from ident.errors import LogError, about
from ident.files import limits
from ident.files.table import Columns, short
from ident.geometry.se3 import pose as pose_of
from ident.recordings.stated import factor_of, several
from ident.recordings.wrench import GROUND, Sensor
from ident.tolerances import HUGE

KEYS = ("frame", "corners", "origin", "on", "among", "expected", "point", "point_unit", "free_moment", "threshold")
"""Keys of a wrench whose frame rests in the world, in addition to those of any wrench."""

FRAMES = ("body", "world", "plate")
"""Axes of a wrench: those of the frame that moves with the body, the world's, or the plate's own."""

AUTO = "auto"
"""Value of `on` for a body that is to be found by its force."""

THRESHOLD = 20.0
"""Largest force up to which a plate may count as unloaded unless stated, N: centres of pressure are quotients of noise
there on most plates."""

RECTANGLE = 0.01
"""Largest deviation of corners from a rectangle, relative to its shorter side; a tape measure is more accurate."""

LOADS = ".xml"
"""Suffix of OpenSim's files of external loads."""

GROUND_FRAMES = ("", "ground", "/ground")
"""OpenSim's names for the ground's frame, in which forces and points must be expressed."""

SIDES = (("_r", "_l"), ("_l", "_r"))
"""Ends of the names of bodies on the right and the left."""


@dataclass(frozen=True, eq=False)
class Plate:
    """A force plate or handle that rests in the world.

    Attributes:
        pose: Pose of the frame of its readings in the world (4, 4).
        bodies: Bodies that may be on it; none for the ground wrench.
        threshold: Force up to which its readings are set to zero, N; None for `THRESHOLD`, or for none where those up
            to it are no noise.
        point: Coordinates of the point of application, NaN for those that have columns, m (3,); None if moments are
            about the frame's origin.
        expected: Body that is stated to be on it, out of several; "" if none is.
    """

    pose: np.ndarray
    bodies: tuple[str, ...]
    threshold: float | None
    point: np.ndarray | None
    expected: str = ""

    def sensor(self, applied_to_link: bool) -> Sensor:
        """Sensor at its pose, for the first of its bodies."""
        if not self.bodies:
            return Sensor(None, self.pose, applied_to_link)
        return Sensor(self.bodies[0], self.pose, applied_to_link, "world")


def plate(name: str, entry: Mapping[str, Any], bodies: Sequence[str]) -> Plate | None:
    """The plate of a wrench's entry; None if its frame moves with a body.

    Raises:
        LogError: The entry contradicts itself, is incomplete, or names a body that the mechanism does not have.
    """
    where = f"wrenches.{name}"
    frame = limits.choice(f"{where}.frame", entry.get("frame", "body"), FRAMES)
    if frame == "body":
        if extra := [key for key in KEYS[1:] if key in entry]:
            raise LogError(f'[{where}] has \'{extra[0]}\', which takes a frame that rests: "plate" or "world".')
        return None
    on, point = _bodies(name, entry, bodies), _point(where, entry)
    pose = _in_world(where, entry) if frame == "world" else _of_plate(where, entry)
    low = None if point is not None or len(on) > 1 else 0.0
    if "threshold" in entry:
        low = limits.value_of(f"{where}.threshold", entry["threshold"], NotNegative, "a force in N, zero or more")
    expected = entry.get("expected", "")
    if "expected" in entry and (len(on) < 2 or expected not in on):
        raise LogError(
            f'{where}.expected needs one of the bodies among which on = "{AUTO}" looks, got {short(expected)}.'
        )
    return Plate(pose, on, low, point, str(expected))


def _columns_of_point(where: str, entry: Mapping[str, Any]) -> list[str]:
    """Names of the columns of the point of application, "" for coordinates that are numbers."""
    point = entry["point"]
    known = isinstance(point, list) and all(
        x.strip() if isinstance(x, str) else is_number(x) and abs(x) < HUGE for x in point
    )
    if not known or len(point) != 3:
        needed = "three coordinates, each a column or a number in m"
        too_large = limits.too_large([x for x in point if is_number(x)] if isinstance(point, list) else [])
        raise LogError(f"{where}.point needs {needed}, got {short(point)}{too_large}.")
    return [x if isinstance(x, str) else "" for x in point]


def pose_of_corners(where: str, corners: np.ndarray) -> np.ndarray:
    """Pose of a plate's frame: in the middle of its surface, z = x × y, as in C3D files (4, 4).

    Args:
        where: Name of the corners in messages.
        corners: Corners in the plate's quadrants +x+y, -x+y, -x-y and +x-y, m (4, 3).

    Raises:
        LogError: They are not those of a rectangle.
    """
    x, y = corners[0] - corners[1] + corners[3] - corners[2], corners[0] - corners[3] + corners[1] - corners[2]
    ends, across = np.linalg.norm([x, y], axis=1), np.cross(x, y)
    skew = np.linalg.norm(corners[0] - corners[1] + corners[2] - corners[3])
    if ends.min() == 0 or max(skew, abs(x @ y) / ends.max()) > RECTANGLE * ends.min():
        raise LogError(
            f"{where} needs the corners of a rectangle, in the plate's quadrants +x+y, -x+y, -x-y, +x-y, m; got "
            f"{short(corners.tolist())}."
        )
    ex, ez = x / ends[0], across / np.linalg.norm(across)
    return pose_of(np.stack([ex, np.cross(ez, ex), ez], axis=1), corners.mean(axis=0))


def _bodies(name: str, entry: Mapping[str, Any], bodies: Sequence[str]) -> tuple[str, ...]:
    where, on = f"wrenches.{name}", entry.get("on")
    if "body" in entry:
        raise LogError(f"[{where}] rests in the world: the body that touches it is stated by 'on', not by 'body'.")
    if "among" in entry and on != AUTO:
        raise LogError(f'{where}.among belongs to on = "{AUTO}"; got on = {short(on)}.')
    if name == GROUND:
        if on is not None:
            raise LogError(f"[{where}] needs no 'on': the ground acts at the base; got {short(on)}.")
        return ()
    if on != AUTO:
        return (limits.choice(f"{where}.on", on, (*bodies, AUTO)),)
    among = entry.get("among")
    if not isinstance(among, list) or len(among) < 2 or any(among.count(body) > 1 for body in among):
        raise LogError(
            f'{where}.among, which on = "{AUTO}" needs, is a list of the two bodies or more that may be on it, as '
            f"{short(list(bodies[-2:]))}; got {'none' if among is None else short(among)}."
        )
    return tuple(limits.choice(f"{where}.among", body, bodies) for body in among)


def _point(where: str, entry: Mapping[str, Any]) -> np.ndarray | None:
    """Coordinates of the point of application that are numbers (3,); None without a point."""
    if ("point" in entry) != ("free_moment" in entry):
        there, lacks = ("point", "free_moment") if "point" in entry else ("free_moment", "point")
        raise LogError(f"[{where}] has '{there}' without '{lacks}'; moments about the frame's origin are its 'torque'.")
    if "point" not in entry:
        return None
    if "torque" in entry:
        raise LogError(f"[{where}] needs 'torque', moments about its origin, or 'point' and 'free_moment', got both.")
    for kind, least in (("force", all), ("free_moment", any)):
        names = entry.get(kind)
        if isinstance(names, list) and not least(names):
            raise LogError(f"{where}.{kind} needs columns beside a point of application, got {short(names)}.")
    _columns_of_point(where, entry)
    return np.array([np.nan if isinstance(x, str) else x for x in entry["point"]], float)


def _in_world(where: str, entry: Mapping[str, Any]) -> np.ndarray:
    if extra := [key for key in ("quaternion", "rpy_deg", "corners", "origin") if key in entry]:
        raise LogError(f"[{where}] is in the world's axes, and '{extra[0]}' would turn them: say frame = \"plate\".")
    if "point" in entry and "position" in entry:
        raise LogError(f"[{where}] has its point in the world's frame, which leaves no use for 'position'.")
    return limits.pose(where, entry)


def _of_plate(where: str, entry: Mapping[str, Any]) -> np.ndarray:
    if "corners" not in entry:
        if "position" not in entry:
            raise LogError(f"[{where}] needs the plate's pose in the world: 'position' with a rotation, or 'corners'.")
        if "origin" in entry:
            raise LogError(f"{where}.origin belongs to 'corners'; 'position' says where the frame's origin is.")
        return limits.pose(where, entry)
    if extra := [key for key in ("position", "quaternion", "rpy_deg") if key in entry]:
        raise LogError(f"[{where}] needs 'corners' or '{extra[0]}', got both.")
    corners = entry["corners"]
    if not isinstance(corners, list) or len(corners) != 4:
        raise LogError(f"{where}.corners needs four points [x, y, z] in the world, m, got {short(corners)}.")
    T = pose_of_corners(f"{where}.corners", np.array([limits.vector(f"{where}.corners", x, 3) for x in corners]))
    T[:3, 3] += T[:3, :3] @ limits.vector(f"{where}.origin", entry.get("origin", [0, 0, 0]), 3)
    return T


def columns_of(where: str, entry: Mapping[str, Any]) -> dict[str, Columns]:
    """Columns of a wrench's entry, by the keys of a mapping."""
    keys = ("force", "torque", "unit", "torque_unit", "position", "quaternion", "rpy_deg", "body", "applied_to_link")
    limits.check_keys(f"[{where}]", entry, (*keys, *KEYS))
    columns = {
        key: several(key, entry.get(kind, ["", "", ""]), 3, *factor_of(where, entry, unit, kind), gaps=True)
        for key, kind, unit in ((f"{where}.force", "force", "unit"), (f"{where}.torque", "torque", "torque_unit"))
    }
    if "point" in entry:
        length, point = factor_of(where, entry, "point_unit", "length"), _columns_of_point(where, entry)
        columns[f"{where}.point"] = several(f"{where}.point", point, 3, *length, gaps=True)
    if "free_moment" in entry:
        moment, key = factor_of(where, entry, "torque_unit", "torque"), f"{where}.free_moment"
        columns[key] = several(key, entry["free_moment"], 3, *moment, gaps=True)
    if not any(name for several in columns.values() for name in several.names):
        raise LogError(f"[{where}] needs at least one column under force or torque.")
    return columns


def sensor(name: str, entry: Mapping[str, Any], bodies: Sequence[str], plate: Plate | None) -> Sensor:
    """Sensor of a wrench's entry, of a plate or on a body that it moves with."""
    where, body = f"wrenches.{name}", entry.get("body")
    if name == GROUND and body is not None:
        raise LogError(f"[{where}] needs no body: the ground acts at the base; got {short(body)}.")
    if name != GROUND and plate is None and body not in bodies:
        raise LogError(f"[{where}] needs a body, one of {', '.join(bodies)}; got {short(body)}.")
    applied = limits.value_of(f"{where}.applied_to_link", entry.get("applied_to_link", True), bool)
    return Sensor(body, limits.pose(where, entry), applied) if plate is None else plate.sensor(applied)


QUANTITIES = {"force": "force_identifier", "point": "point_identifier", "free_moment": "torque_identifier"}
"""Elements that hold the prefix of the columns' names; x, y and z follow."""


def external_loads(path: Path, bodies: Sequence[str]) -> dict[str, Any]:
    """Entries as in a mapping file: a plate for each `<ExternalForce>`, in the world's axes.

    Such files easily name the wrong foot. The body on a plate is therefore found by its force, among the named bodies
    and their counterparts on the other side; a note says where the file has another.

    Args:
        path: The file.
        bodies: Names of the mechanism's bodies.

    Raises:
        LogError: The file is missing or malformed, has no force, or one that is not in the ground's frame, lacks
            columns, or acts on a body that the mechanism does not have.
    """
    try:
        root = ET.parse(path).getroot()
    except OSError:
        raise LogError(f"{path}: OpenSim's ExternalLoads are an XML file that exists.") from None
    except (ET.ParseError, LookupError, ValueError) as error:
        raise LogError(f"{path}: the file needs to be XML ({error}).") from None
    loads = root if root.tag == "ExternalLoads" else root.find("ExternalLoads")
    forces = [] if loads is None else [force for force in loads.iter("ExternalForce") if _acts(force)]
    if not forces:
        raise LogError(
            f"{path}: OpenSim's ExternalLoads have an <ExternalForce> that acts, this <{root.tag}> has none."
        )
    with about(path):
        by_name = {force.get("name", "") or f"plate{k}": force for k, force in enumerate(forces, start=1)}
        if len(by_name) < len(forces):
            raise LogError("every <ExternalForce> needs a name of its own.")
        stated = {name: _body(name, force, bodies) for name, force in by_name.items()}
        among = _with_other_sides(list(stated.values()), bodies)
        return {"wrenches": {name: _plate(name, force, stated[name], among) for name, force in by_name.items()}}


def _plate(name: str, force: ET.Element, body: str, among: Sequence[str]) -> dict[str, Any]:
    """Entry of one force."""
    for frame in ("force_expressed_in_body", "point_expressed_in_body"):
        if (stated := _text(force, frame)) not in GROUND_FRAMES:
            raise LogError(f"<ExternalForce name=\"{name}\"> needs the ground as its {frame}, got '{short(stated)}'.")
    entry: dict[str, Any] = {"frame": "world"}
    for quantity, tag in QUANTITIES.items():
        if not (begin := _text(force, tag)):
            raise LogError(f'<ExternalForce name="{name}"> needs a <{tag}>, what the names of its columns begin with.')
        entry[quantity] = [f"{begin}{axis}" for axis in "xyz"]
    if len(among) == 1:
        return entry | {"on": body}
    return entry | {"on": AUTO, "among": list(among), "expected": body}


def _body(name: str, force: ET.Element, bodies: Sequence[str]) -> str:
    """Body that a force acts on, by the file."""
    body = _text(force, "applied_to_body").rpartition("/")[2]
    if body not in bodies:
        raise LogError(
            f"<ExternalForce name=\"{name}\"> acts on '{short(body)}', which is no body of the model; those are "
            f"{', '.join(bodies)}."
        )
    return body


def _with_other_sides(named: Sequence[str], bodies: Sequence[str]) -> list[str]:
    """Bodies and their counterparts on the other side, each once."""
    both = [body.removesuffix(end) + other for body in named for end, other in SIDES if body.endswith(end)]
    return list(dict.fromkeys([*named, *(body for body in both if body in bodies)]))


def _acts(force: ET.Element) -> bool:
    return _text(force, "appliesForce") != "false" and _text(force, "isDisabled") != "true"


def _text(element: ET.Element, tag: str) -> str:
    return (element.findtext(tag) or "").strip()
