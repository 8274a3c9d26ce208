"""Coordinates of an OpenSim model: free ones, locked ones and followers."""

import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from ident.errors import ModelError
from ident.mechanism.constraint import Coincidence
from ident.mechanism.tree import Tree
from sim.models.notes import note
from sim.models.opensim.elements import Frames, flag, label, named, number, numbers, objects, offset, socket, text
from sim.models.opensim.functions import IDENTITY, Curve, curve, function_of

UNLIMITED = 1e3
"""Ends of a range, in rad or m, from which it counts as unlimited."""

USUAL = (-np.pi, np.pi)
"""Range over which functions are fitted if neither the coordinate nor a table has one."""


WELD = "WeldConstraint"
CLOSING = "PointConstraint", WELD
"""Tags of constraints that close loops."""


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
        limits = (float(low), float(high)) if -UNLIMITED < low < high < UNLIMITED else None
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
    couplers = {}
    for element in (each for each in enforced(model, ignore) if each.tag not in CLOSING):
        if element.tag != "CoordinateCouplerConstraint":
            raise ModelError(
                f"The equations of a tree do not hold the forces of {label(element)}; leave it out with --ignore "
                f"{element.get('name')} (in Python, ignore=['{element.get('name')}'])."
            )
        leaders, follower = (
            text(element, "independent_coordinate_names").split(),
            text(element, "dependent_coordinate_name"),
        )
        if len(leaders) != 1 or not {*leaders, follower} <= set(coordinates):
            raise ModelError(
                f"{label(element)} makes one coordinate of the model depend on one other, got '{follower}' on "
                f"'{' '.join(leaders)}'."
            )
        function = _coupling(element).scaled(number(element, "scale_factor", "1"))
        couplers[follower] = leaders[0], function
    return couplers


def _coupling(element: ET.Element) -> Curve:
    """The function of a coupler constraint."""
    inner = element.find("coupled_coordinates_function")
    function = function_of(element if inner is None else inner)
    if function is None:
        children = [child for child in (element if inner is None else inner) if isinstance(child.tag, str)]
        if inner is not None and children:
            return curve(children[0])
        raise ModelError(f"{label(element)} needs a <coupled_coordinates_function>.")
    return curve(function)


def needed_span(leader: Coordinate, function: Curve) -> tuple[float, float]:
    """Range of a leader's coordinate over which a function of it is needed: its own range, limited to a table's."""
    low, high = leader.range or function.span or USUAL
    first, last = function.span or (low, high)
    return (max(low, first), min(high, last)) if max(low, first) < min(high, last) else (low, high)


def point_constraints(model: ET.Element, frames: Frames, tree: Tree, ignore: Collection[str]) -> list[Coincidence]:
    """Point and weld constraints between bodies of a tree.

    Args:
        model: The model.
        frames: Its frames.
        tree: The tree; constraints of which neither body is in it have no effect.
        ignore: Names of constraints to leave out.

    Warns:
        ModelNote: There are some.

    Raises:
        ModelError: One holds a body of the tree to the ground or another body, whose force the equations lack.
    """
    out = list[Coincidence]()
    for element in (each for each in enforced(model, ignore) if each.tag in CLOSING):
        bodies, poses = list[str](), list[tuple[float, ...]]()
        for k in "12":
            reference = socket(element, f"frame{k}") or socket(element, f"body_{k}") or text(element, f"body_{k}")
            place = frames.place(reference, element)
            pose = place.pose @ offset(element, f"location_body_{k}", f"orientation_body_{k}")
            bodies.append(place.body)
            poses.append(tuple(pose.ravel().tolist()))
        inside = [body in tree.names for body in bodies]
        if any(inside) and not all(inside):
            raise ModelError(
                f"{label(element)} reaches outside the mechanism, whose equations lack its force; leave it out with "
                f"--ignore {element.get('name')} (in Python, ignore=['{element.get('name')}'])."
            )
        if all(inside):
            ends = (bodies[0], bodies[1]), (poses[0], poses[1])
            out.append(Coincidence(str(element.get("name")), *ends, whole=element.tag == WELD))
    if out:
        note(f"By {', '.join(each.name for each in out)}, joints without a column follow from the others.")
    return out
