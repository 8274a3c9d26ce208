"""Joints of OpenSim files, their turns and slides, and coordinates: free ones, locked ones and followers."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.errors import ModelError
from ident.mechanism.loops import Coincidence
from sim.models.opensim_elements import (
    GROUND,
    IDENTITY,
    Curve,
    Frames,
    PlacedFrame,
    curve,
    flag,
    function_of,
    label,
    named,
    number,
    numbers,
    objects,
    offset,
    socket,
    text,
)

_SIMPLE = {
    "WeldJoint": (),
    "PinJoint": (("turn", 2, 0),),
    "SliderJoint": (("slide", 0, 0),),
    "UniversalJoint": (("turn", 0, 0), ("turn", 1, 1)),
    "GimbalJoint": (("turn", 0, 0), ("turn", 1, 1), ("turn", 2, 2)),
    "BallJoint": (("turn", 0, 0), ("turn", 1, 1), ("turn", 2, 2)),
    "PlanarJoint": (("slide", 0, 1), ("slide", 1, 2), ("turn", 2, 0)),
    "FreeJoint": (*(("slide", k, 3 + k) for k in range(3)), *(("turn", k, k) for k in range(3))),
}
"""Turns and slides of joints other than `CustomJoint`: kind, axis, and index of the coordinate that moves them."""

AXES = ("translation1", "translation2", "translation3", "rotation1", "rotation2", "rotation3")
"""The axes of a `CustomJoint`, in the order in which they move the child."""


class ElementaryMotion(NamedTuple):
    """One turn or slide of a joint.

    Attributes:
        turns: True for a turn.
        axis: Its direction, of unit length (3,).
        coordinate: Name of the coordinate that moves it, "" if it does not move.
        curve: The function of the coordinate, or the constant.
        name: Its name in messages.
    """

    turns: bool
    axis: np.ndarray
    coordinate: str
    curve: Curve
    name: str

    @property
    def twist(self) -> np.ndarray:
        """Its twist in the frame that it moves (6,)."""
        return np.concatenate([np.zeros(3), self.axis] if self.turns else [self.axis, np.zeros(3)])


def coordinate_elements(joint: ET.Element) -> list[ET.Element]:
    """The `<Coordinate>` elements of a joint, in their order."""
    inside = objects(joint, "CoordinateSet") or objects(joint, "coordinates")
    return [element for element in inside if element.tag == "Coordinate"]


def factors(joint: ET.Element) -> list[ElementaryMotion]:
    """The turns and slides of a joint.

    Raises:
        ModelError: The joint is of an unsupported kind, is reversed, lacks coordinates, or has a wrong axis.
    """
    if flag(joint, "reverse", False):
        raise ModelError(f"{label(joint)} is reversed, which is not read; exchange its frames.")
    if joint.tag == "CustomJoint":
        return _custom(joint)
    if joint.tag not in _SIMPLE:
        raise ModelError(f"{label(joint)}: joints that are read are CustomJoint, {', '.join(_SIMPLE)}.")
    rows = _SIMPLE[joint.tag]
    names = [named(element) for element in coordinate_elements(joint)]
    if len(names) != len(rows):
        raise ModelError(f"{label(joint)} needs {len(rows)} coordinates, got {len(names)}: {', '.join(names)}.")
    return [
        ElementaryMotion(kind == "turn", np.eye(3)[axis], names[k], IDENTITY, f"{joint.get('name')}, {names[k]}")
        for kind, axis, k in rows
    ]


def _custom(joint: ET.Element) -> list[ElementaryMotion]:
    names = [named(element) for element in coordinate_elements(joint)]
    spatial = joint.find("SpatialTransform")
    axes = {} if spatial is None else {axis.get("name"): axis for axis in spatial.findall("TransformAxis")}
    if missing := [axis for axis in AXES if axis not in axes]:
        raise ModelError(
            f"{label(joint)} needs a <SpatialTransform> with six <TransformAxis>; {missing[0]} is missing."
        )
    return [_axis(joint, axes[axis], names) for axis in AXES]


def _axis(joint: ET.Element, element: ET.Element, names: list[str]) -> ElementaryMotion:
    """One axis of a `CustomJoint`."""
    kind = element.get("name", "")
    where = f"{joint.get('name')}, {kind}"
    direction = numbers(element, "axis", 3)
    if not direction.any():
        raise ModelError(f"{where}: {label(element)} needs an axis other than zero.")
    used = text(element, "coordinates").split()
    if len(used) > 1 or not set(used) <= set(names):
        raise ModelError(
            f"{where}: an axis moves by one coordinate of its joint at most, one of {', '.join(names) or 'none'}; got "
            f"'{' '.join(used)}'."
        )
    function = function_of(element)
    by = curve(function) if function is not None else IDENTITY if used else Curve.polynomial([0])
    if not used and (by.exact is None or by.exact.degree()):
        raise ModelError(f"{where}: a function of no coordinate is a <Constant>, got <{getattr(function, 'tag', '')}>.")
    unit = direction / np.linalg.norm(direction)
    return ElementaryMotion(kind.startswith("rotation"), unit, used[0] if used else "", by, where)


@dataclass(frozen=True)
class Link:
    """A joint of the file with its frames.

    Attributes:
        joint: The joint.
        parent: Frame F on the parent.
        child: Frame M on the child.
        factors: Its turns and slides.
    """

    joint: ET.Element
    parent: PlacedFrame
    child: PlacedFrame
    factors: list[ElementaryMotion]


def _links(model: ET.Element, frames: Frames) -> Iterator[Link]:
    """The joints of a model, from `JointSet` or, in OpenSim 3, from their child bodies."""
    joints = [(joint, "") for joint in objects(model, "JointSet")]
    for name, body in frames.bodies.items():
        inside = [child for group in body.findall("Joint") for child in group if isinstance(child.tag, str)]
        joints += [(joint, name) for joint in inside]
    for joint, carrier in joints:
        parent, child = frames.joint_ends(joint, carrier)
        if child.body == GROUND:
            raise ModelError(f"{label(joint)} needs a body for its child, got the ground; exchange its frames.")
        yield Link(joint, parent, child, factors(joint))


def links_in_order(model: ET.Element, frames: Frames) -> list[Link]:
    """The joints of a model, one for each body, parents before children and otherwise in the order of the bodies.

    Raises:
        ModelError: A joint cannot be read, closes a loop, or is not connected to the ground.
    """
    by_body: dict[str, Link] = {}
    for link in _links(model, frames):
        if link.child.body in by_body:
            raise ModelError(f"{label(link.joint)} closes a loop: another joint carries '{link.child.body}' as well.")
        by_body[link.child.body] = link
    placed, waiting, out = {GROUND}, list(frames.bodies), list[Link]()
    while waiting:
        ready = [name for name in waiting if name in by_body and by_body[name].parent.body in placed]
        if not ready:
            raise ModelError(f"No chain of joints leads from the ground to {', '.join(waiting)}.")
        placed.add(ready[0])
        waiting.remove(ready[0])
        out.append(by_body[ready[0]])
    return out


USUAL = (-np.pi, np.pi)
"""Range over which functions are fitted if neither the coordinate nor a table has one."""


CLOSING = {"PointConstraint": False, "WeldConstraint": True}
"""Tags of constraints that close loops, True for those that hold frames together, not points."""


@dataclass(frozen=True)
class Coordinate:
    """A coordinate of the file.

    Attributes:
        name: Its name.
        default: Its default value, rad or m.
        locked: True if it stays there.
        range: Its range, rad or m; None if unlimited.
    """

    name: str
    default: float
    locked: bool
    range: tuple[float, float] | None

    @classmethod
    def of(cls, element: ET.Element) -> "Coordinate":
        """The coordinate of a `<Coordinate>` element."""
        low, high = numbers(element, "range", 2, "-inf inf") if text(element, "range") else (-np.inf, np.inf)
        # Files state no limits as large ones.
        limits = (float(low), float(high)) if -1e3 < low < high < 1e3 else None
        return cls(named(element), number(element, "default_value", "0"), flag(element, "locked", False), limits)


@dataclass(frozen=True)
class Dependence:
    """A coordinate as a function of a free one.

    Attributes:
        leader: Name of the free coordinate, None for a coordinate that does not move.
        curve: The function, of the leader's coordinate.
    """

    leader: str | None
    curve: Curve

    def then(self, outer: Curve) -> "Dependence":
        """Dependence of a function of the coordinate."""
        after = self.curve.of_value(outer)
        return Dependence(self.leader if after.exact is None or after.exact.degree() else None, after)


def dependences(
    model: ET.Element, coordinates: Mapping[str, Coordinate], ignore: Collection[str]
) -> dict[str, Dependence]:
    """Dependence of each coordinate: on itself, on another one, or constant if it is locked.

    Args:
        model: The model.
        coordinates: All coordinates by name.
        ignore: Names of constraints to leave out.

    Raises:
        ModelError: A constraint neither closes a loop nor is between two coordinates, or dependences are circular.
    """
    couplers = _couplers(model, coordinates, ignore)
    out: dict[str, Dependence] = {}

    def resolve(name: str, below: tuple[str, ...] = ()) -> Dependence:
        if name in below:
            raise ModelError(f"The coordinates {', '.join(below)} follow each other in a circle.")
        if name not in out:
            if coordinates[name].locked:
                out[name] = Dependence(None, Curve.polynomial([coordinates[name].default]))
            elif name in couplers:
                leader, function = couplers[name]
                out[name] = resolve(leader, (*below, name)).then(function)
            else:
                out[name] = Dependence(name, IDENTITY)
        return out[name]

    for name in coordinates:
        resolve(name)
    return out


def enforced(model: ET.Element, ignore: Collection[str]) -> list[ET.Element]:
    """Constraints of a model that are switched on, of which none is ignored.

    Raises:
        ModelError: A constraint to ignore does not exist.
    """
    constraints = [c for c in objects(model, "ConstraintSet") if flag(c, "isEnforced", True)]
    constraints = [c for c in constraints if not flag(c, "isDisabled", False)]
    if unknown := set(ignore) - {c.get("name", "") for c in constraints}:
        raise ModelError(
            f"The model has no enforced constraint named {', '.join(sorted(unknown))}; it has "
            f"{', '.join(c.get('name', '') for c in constraints) or 'none'}."
        )
    return [c for c in constraints if c.get("name", "") not in ignore]


def _couplers(
    model: ET.Element, coordinates: Mapping[str, Coordinate], ignore: Collection[str]
) -> dict[str, tuple[str, Curve]]:
    """Leaders and functions of the coordinates that constraints make dependent, by name."""
    couplers = dict[str, tuple[str, Curve]]()
    for element in (each for each in enforced(model, ignore) if each.tag not in CLOSING):
        if element.tag != "CoordinateCouplerConstraint":
            raise ModelError(
                f"The equations of a tree do not hold the forces of {label(element)}; leave it out with --ignore "
                f"{element.get('name')} (in Python, ignore=['{element.get('name')}'])."
            )
        leaders = text(element, "independent_coordinate_names").split()
        follower = text(element, "dependent_coordinate_name")
        if len(leaders) != 1 or not {*leaders, follower} <= set(coordinates):
            raise ModelError(
                f"{label(element)} makes one coordinate of the model depend on one other, got '{follower}' on "
                f"'{' '.join(leaders)}'."
            )
        if follower in couplers:
            raise ModelError(
                f"{label(element)} makes '{follower}' depend on '{leaders[0]}', another constraint on "
                f"'{couplers[follower][0]}'; leave one out with --ignore."
            )
        function = _coupling(element).scaled(number(element, "scale_factor", "1"))
        couplers[follower] = leaders[0], function
    return couplers


def _coupling(element: ET.Element) -> Curve:
    """The function of a coupler constraint."""
    inner = element.find("coupled_coordinates_function")
    function = function_of(element if inner is None else inner)
    children = [] if inner is None else [child for child in inner if isinstance(child.tag, str)]
    if function is None and not children:
        raise ModelError(f"{label(element)} needs a <coupled_coordinates_function>.")
    return curve(children[0] if function is None else function)


def needed_span(leader: Coordinate, function: Curve) -> tuple[float, float]:
    """Range of a leader's coordinate over which a function of it is needed: its own range, limited to a table's."""
    low, high = leader.range or function.span or USUAL
    first, last = function.span or (low, high)
    return (max(low, first), min(high, last)) if max(low, first) < min(high, last) else (low, high)


def point_constraints(model: ET.Element, frames: Frames, ignore: Collection[str]) -> list[Coincidence]:
    """Point and weld constraints between bodies of a model, but for some that are left out by name."""
    out = list[Coincidence]()
    for element in (each for each in enforced(model, ignore) if each.tag in CLOSING):
        bodies, poses = list[str](), list[tuple[float, ...]]()
        for k in "12":
            reference = socket(element, f"frame{k}") or socket(element, f"body_{k}") or text(element, f"body_{k}")
            place = frames.place(reference, element)
            pose = place.pose @ offset(element, f"location_body_{k}", f"orientation_body_{k}")
            bodies.append(place.body)
            poses.append(tuple(pose.ravel().tolist()))
        out.append(Coincidence(str(element.get("name")), tuple(bodies), tuple(poses), CLOSING[element.tag]))
    return out
