"""A prior from anthropometric tables: bodies of a mechanism as segments of a person of given mass, height and sex.

The numbers are in `anthropometry.toml`, with their sources.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ident.annotations import Vector
from ident.errors import InputError, ModelError
from ident.geometry.inertia import parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import KNOWN
from ident.setup import OF_PEOPLE

_NUMBERS = tomllib.loads(Path(__file__).with_name("anthropometry.toml").read_text(encoding="utf-8"))

TABLES, SEXES = ("winter", "deleva", "dumas"), ("female", "male")

LANDMARKS = ("upper_trunk", "middle_trunk", "lower_trunk", "torso", "pelvis", "trunk", "head_and_trunk", "hat")
"""Segments whose ends are not, or not necessarily, adjacent joints of a model."""

_LIKE = {"forearm_and_hand": "forearm", "arm": "upper_arm", "leg": "thigh", "shank_and_foot": "shank"}
"""Segments whose spread between persons is that of another one."""

SIDES = ("right", "left", "r", "l")
"""Prefixes or suffixes of a segment's name in the name of a body, separated by `_`."""

ASIDE = 0.5
"""Ratio of the masses on the second and the first child above which a body's distal end is doubtful."""


@dataclass(frozen=True)
class Segment:
    """One segment of a table.

    Attributes:
        mass: Its share of the person's mass.
        center: Distance of the centre of mass from the proximal end, over the length.
        across: Radius of gyration about axes across the segment through that centre, over the length.
        along: Radius of gyration about the segment's own axis, over the length.
        ends: Landmarks at its proximal and at its distal end.
        length: Its length over the person's height, for segments that do not end at a joint; 0 if not published.
    """

    mass: float
    center: float
    across: float
    along: float
    ends: tuple[str, str]
    length: float = 0.0


@cache
def segments(table: str, sex: str) -> dict[str, Segment]:
    """Segments of a table by name.

    Args:
        table: One of `TABLES`.
        sex: One of `SEXES`.

    Raises:
        InputError: There is no such table or sex.
    """
    for value, choices, what in ((table, TABLES, "A table of segments"), (sex, SEXES, "The sex of a table")):
        if value not in choices:
            raise InputError(f"{what} is one of {', '.join(choices)}, got '{value}'.")
    return {"winter": _winter, "deleva": _deleva, "dumas": _dumas}[table](sex)


def spread(name: str, sex: str) -> tuple[float, float]:
    """Standard deviations of a person's segment from a table: spread between persons (Cheng) and between tables.

    Returns:
        Standard deviations of the mass over the mass, and of the centre of mass over the segment's length.
    """
    like = _LIKE.get(name, "trunk" if name in LANDMARKS else name)
    mean, mass, center = _NUMBERS["between_persons"][like]
    alike = [own[name] for own in (segments(table, sex) for table in TABLES) if name in own]
    same_ends = [each for each in alike if each.ends == alike[0].ends and not each.length]
    shares, centers = np.array([each.mass for each in alike]), np.array([each.center for each in same_ends])
    between_shares = float(shares.std(ddof=1) / shares.mean()) if len(shares) > 1 else 0.0
    between_centers = float(centers.std(ddof=1)) if len(centers) > 1 else 0.0
    return float(np.hypot(mass / mean, between_shares)), float(np.hypot(center / 100, between_centers))


def _deleva(sex: str) -> dict[str, Segment]:
    out = {}
    for name, (mass, center, sagittal, transverse, along, length) in _NUMBERS["deleva"][sex].items():
        # A joint does not end these.
        over_height = length / _NUMBERS["stature"][sex] if name in ("head", "hand", "trunk") else 0.0
        out[name] = Segment(mass, center, _mean(sagittal, transverse), along, _ends_of(name), over_height)
    return out | {"foot": replace(out["foot"], ends=("heel", "toe tip"))}


def _winter(sex: str) -> dict[str, Segment]:
    shape, out = segments("deleva", sex), {}
    for name, (mass, center, across, like, length) in _NUMBERS["winter"].items():
        along = across * shape[like].along / shape[like].across
        out[name] = Segment(mass, center, across, along, _ends_of(name), length)
    return out | {"hand": replace(out["hand"], length=shape["hand"].length)}


def _dumas(sex: str) -> dict[str, Segment]:
    out = {
        name: Segment(mass, center, _mean(x, z), along, _ends_of(name))
        for name, (mass, center, x, z, along) in _NUMBERS["dumas"][sex].items()
    }
    head = replace(out["head"], length=segments("deleva", sex)["head"].length)
    return out | {
        "head": head,
        "hand": replace(out["hand"], ends=("wrist", "finger tips"), length=_NUMBERS["hand_to_tips"]),
    }


def _ends_of(name: str) -> tuple[str, str]:
    """Landmarks at the ends of a segment, unless a table has its own."""
    proximal, distal = _NUMBERS["ends"][name]
    return proximal, distal


def _mean(*radii: float) -> float:
    """Radius of gyration of the mean moment of inertia."""
    return float(np.sqrt(np.mean(np.square(radii))))


@dataclass(frozen=True)
class Person:
    """A person whose segments are described by a table.

    Attributes:
        table: `winter`, `deleva` or `dumas`.
        mass: Body mass, kg.
        height: Height, m.
        sex: `female` or `male`.
    """

    table: str
    mass: float
    height: float
    sex: str

    def __post_init__(self) -> None:
        segments(self.table, self.sex)
        if not 1 < self.mass < 500 or not 0.3 < self.height < 3:
            raise InputError(f"A person has a mass in kg and a height in m, got {self.mass:g} and {self.height:g}.")


@dataclass(frozen=True, eq=False)
class Placed:
    """Segment and ends of a body.

    Attributes:
        segment: Name of the segment.
        proximal: Its proximal end in the body's frame, m (3,); None for the body's joint.
        distal: Its distal end, m (3,); None for the joint of its child, or at a length that follows from the height.
    """

    segment: str
    proximal: Vector | None = None
    distal: Vector | None = None


def with_person(mechanism: Mechanism, person: Person, placed: Mapping[str, Placed] | None = None) -> Mechanism:
    """The mechanism with a prior from a table: masses, centres and inertias, with published standard deviations.

    Bodies that are no segment keep the model's prior.

    Args:
        mechanism: The mechanism, with the lengths of the person.
        person: The person.
        placed: Segments by the bodies' names; by default bodies with a segment's name, such as `thigh`, `thigh_r` or
            `left_thigh`.

    Raises:
        ModelError: No body is a segment, or the ends of one cannot be found; the message names it.
        InputError: A body or a segment does not exist.
    """
    table = segments(person.table, person.sex)
    placed = _by_name(mechanism.bodies, table) if placed is None else placed
    if not placed:
        raise ModelError(
            f"No body is named as a segment ({', '.join(table)}); map the bodies {', '.join(mechanism.bodies)} under "
            "[segments] of the columns file."
        )
    places = JointPlaces(mechanism)
    prior = np.zeros((len(mechanism.bodies), 10)) if mechanism.prior is None else mechanism.prior.reshape(-1, 10).copy()
    known = {}
    for name, own in placed.items():
        if name not in mechanism.bodies or own.segment not in table:
            raise InputError(
                f"[segments] names bodies, {', '.join(mechanism.bodies)}, and what they are by this table, "
                f"{', '.join(table)}; got {name} = '{own.segment}'."
            )
        k, segment = mechanism.bodies.index(name), table[own.segment]
        proximal, distal = _ends(places, name, own, segment, person.height)
        prior[k] = _parameters(segment, person.mass, proximal, distal)
        mass, center = spread(own.segment, person.sex)
        length = float(np.linalg.norm(distal - proximal))
        known[name] = {**KNOWN, "mass": mass, "center": center * length}
    return replace(mechanism, prior=prior.ravel(), prior_known=known, centre_std=OF_PEOPLE)


def _by_name(bodies: tuple[str, ...], table: Mapping[str, Segment]) -> dict[str, Placed]:
    """Bodies with the name of a segment, perhaps with a side before or behind."""
    names = {form.format(s, side): s for s in table for side in SIDES for form in ("{0}_{1}", "{1}_{0}", "{0}")}
    return {body: Placed(names[body.lower()]) for body in bodies if body.lower() in names}


def without_side(name: str) -> str:
    """Name of a body or joint without its side.

    >>> without_side("knee_r")
    'knee'
    """
    return "_".join(part for part in name.split("_") if part.lower() not in SIDES) or name


def _parameters(segment: Segment, mass: float, proximal: np.ndarray, distal: np.ndarray) -> np.ndarray:
    """φ of a segment between its ends (10,)."""
    length = float(np.linalg.norm(distal - proximal))
    axis = (distal - proximal) / length
    along = np.outer(axis, axis)
    radii = segment.across**2 * (np.eye(3) - along) + segment.along**2 * along
    own = segment.mass * mass
    return parameters_from_com(own, proximal + segment.center * (distal - proximal), own * length**2 * radii)


def _ends(
    joints: "JointPlaces", name: str, own: Placed, segment: Segment, height: float
) -> tuple[np.ndarray, np.ndarray]:
    """Proximal and distal end of a body's segment, in the body's frame."""
    doubtful = own.segment in LANDMARKS or segment.ends[0] == "heel"
    proximal, distal = own.proximal, own.distal
    if proximal is None and (segment.length or not doubtful):
        proximal = joints.own(name)
    if distal is None and not (segment.length or doubtful):
        distal = joints.next(name)
    if proximal is not None and distal is None and segment.length:
        # The direction is the model's, the length follows from the person's height.
        toward = joints.center(name) - proximal
        if size := float(np.linalg.norm(toward)):
            distal = proximal + toward / size * segment.length * height
    if proximal is None or distal is None or not np.linalg.norm(distal - proximal) > 0:
        raise ModelError(
            f"The segment of '{name}' goes from {segment.ends[0]} to {segment.ends[1]}; say where in its frame, in m, "
            f"as in {name} = {{ segment = '{own.segment}', proximal = [0, 0, 0], distal = [0, -0.4, 0] }} under "
            "[segments]."
        )
    return proximal, distal


class JointPlaces:
    """Positions of joints in the frames of adjacent bodies, at coordinates zero."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.tree = mechanism.tree
        zero = [[1.0, 0, 0, 0] if body.is_ball else [0.0] * body.coordinates for body in self.tree.bodies]
        self.poses = self.tree.poses(np.concatenate(zero))
        prior = np.zeros(10 * len(mechanism.bodies)) if mechanism.prior is None else mechanism.prior
        self.phi = dict(zip(self.tree.inertial, prior.reshape(-1, 10), strict=True))

    def own(self, name: str) -> np.ndarray | None:
        """Position of a body's own joint, None if the body moves freely or is welded to the base."""
        body = self.tree.names.index(name)
        return self._joint(body, body)

    def next(self, name: str) -> np.ndarray | None:
        """Position of the joint of a body's child, of the heaviest of several; None if that is doubtful."""
        body = self.tree.names.index(name)
        on_it = [i for i in self.tree.inertial if self.tree.bodies[self.tree.first_link(i)].parent == body]
        weights = {i: sum(self.phi[k][0] for k in self.tree.carried(i) if k in self.phi) for i in on_it}
        order = sorted(weights, key=lambda i: weights[i], reverse=True)
        if not order or (len(order) > 1 and weights[order[1]] > ASIDE * weights[order[0]]):
            return None
        return self._joint(order[0], body)

    def center(self, name: str) -> np.ndarray:
        """Centre of mass of a body in the model, the origin of its frame if it has no mass."""
        phi = self.phi[self.tree.names.index(name)]
        return phi[1:4] / phi[0] if phi[0] else np.zeros(3)

    def _joint(self, i: int, of: int) -> np.ndarray | None:
        """Point nearest to all axes of a body's joint, in the frame of a body; None if it is free or does not turn.

        Undetermined directions are those of the body's origin.
        """
        chain = self.tree.chain(i)
        chain = chain[chain.index(self.tree.first_link(i)) :]
        axes = [k for k in chain if self.tree.bodies[k].motions[3:].any()]
        slides = [k for k in chain if self.tree.bodies[k].freedoms and k not in axes]
        if len(slides) > 2 or not axes:
            return None
        rows, values = [1e-6 * np.eye(3)], [1e-6 * self.poses[i][:3, 3]]
        for k in reversed(axes):
            R, p = self.poses[k][:3, :3], self.poses[k][:3, 3]
            for v, w in self.tree.bodies[k].motions.T.reshape(-1, 2, 3):
                across = np.eye(3) - np.outer(R @ w, R @ w)
                rows.append(across)
                values.append(across @ (R @ np.cross(w, v) + p))
        point = np.linalg.lstsq(np.vstack(rows), np.concatenate(values), rcond=None)[0]
        return self.poses[of][:3, :3].T @ (point - self.poses[of][:3, 3])
