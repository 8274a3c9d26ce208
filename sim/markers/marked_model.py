"""A model with sites for the markers of a recording, by settings of a file, also an OpenSim model."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NamedTuple

import mujoco
import numpy as np

from ident.annotations import Needs, Point, Positive, one_of
from ident.errors import InputError, ModelError, about
from ident.files.limits import made, toml
from ident.files.markers import Markers
from ident.files.table import UNITS, listed, short
from ident.mechanism.body import BASE, Body, Follower
from sim.models.model_update import specification
from sim.models.mujoco_model import compiled
from sim.models.notes import body_id, id_of, joint_name, name_of
from sim.models.opensim_model import is_opensim, mechanism_from_opensim

_SITE = mujoco.mjtObj.mjOBJ_SITE
_FREE = int(mujoco.mjtJoint.mjJNT_FREE)


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


class FollowingJoint(NamedTuple):
    """A follower: a joint whose coordinate is a function of another's.

    Attributes:
        leader: Indices of the leader in qpos and among the degrees of freedom; `own` those of the follower.
        law: The function.
    """

    leader: tuple[int, int]
    own: tuple[int, int]
    law: Follower


@dataclass(frozen=True, eq=False)
class MarkedModel:
    """A compiled model with a site for every marker.

    Attributes:
        spec: The specification that it was compiled from, with all sites.
        model: The compiled model.
        labels: Labels of the markers that have a site.
        sites: Ids of the sites (M,).
        weights: Weights of squared distances (M,).
        rest: Coordinates of the reference configuration, with fixed joints at their given coordinates (nq,).
        dofs: Indices of the degrees of freedom that move (n,).
        followers: Followers, as in OpenSim's knees.
        up: Axis of the model's world that points up.
    """

    spec: mujoco.MjSpec
    model: mujoco.MjModel
    labels: tuple[str, ...]
    sites: np.ndarray
    weights: np.ndarray
    rest: np.ndarray
    dofs: np.ndarray
    followers: tuple[FollowingJoint, ...] = ()
    up: str = "z"

    def with_lengths(self, model: mujoco.MjModel) -> "MarkedModel":
        """The markers on a model with other lengths."""
        return replace(self, model=model)

    @property
    def dof_names(self) -> list[str]:
        """Name of each degree of freedom that moves: its joint's, with the axis if that has several."""
        out = []
        for d in self.dofs:
            j = int(self.model.dof_jntid[d])
            axis = int(d - self.model.jnt_dofadr[j])
            names = {6: ("x", "y", "z", "rx", "ry", "rz"), 3: ("rx", "ry", "rz")}.get(self.dofs_of(j))
            out.append(name_of(self.model, mujoco.mjtObj.mjOBJ_JOINT, j) + (f".{names[axis]}" if names else ""))
        return out

    def dofs_of(self, j: int) -> int:
        """Number of degrees of freedom of a joint."""
        return {_FREE: 6, int(mujoco.mjtJoint.mjJNT_BALL): 3}.get(int(self.model.jnt_type[j]), 1)


def marked_model(
    source: str | Path | mujoco.MjSpec,
    labels: Sequence[str],
    places: Mapping[str, MarkerPlace] | None = None,
    fix: Mapping[str, Sequence[float]] | None = None,
) -> tuple[MarkedModel, list[str]]:
    """A model with sites for the labels of a file.

    Args:
        source: MJCF, URDF or OpenSim file, or a specification, which is copied.
        labels: Labels of the markers; a common prefix before a colon, a subject's name, is ignored.
        places: Sites or positions of markers, by label, unless they are at the site of their name.
        fix: Joints that do not move, with their coordinates; empty for those of the reference configuration.

    Returns:
        The model, and the labels without a site.

    Raises:
        ModelError: The model is malformed, or has no site, body or joint of a name.
        InputError: No marker has a site, two have the same, or a joint to fix has another number of coordinates.
    """
    places, laws, up, fix = dict(places or {}), dict[str, Follower](), "z", fix or {}
    if is_opensim(source):
        spec, laws, up = opensim_spec(str(source), fix)
        fix = {}
    else:
        spec = specification(source)
    short_labels = _without_subject(labels)
    if unknown := [label for label in places if label not in (*labels, *short_labels.values())]:
        raise InputError(f"The file has no marker '{short(unknown[0])}' ([markers]); it has {listed(labels)}.")
    places = {full: places.get(full) or places.get(own) or MarkerPlace(own) for full, own in short_labels.items()}
    names = _add_sites(spec, places)
    model = compiled(spec)
    ids = {name_of(model, _SITE, s): s for s in range(model.nsite)}
    for label, place in places.items():
        if place.site and place.site != short_labels[label] and place.site not in ids:
            raise ModelError(f"markers.{label}: the model has no site '{place.site}', but {listed(ids)}.")
    used = [label for label in labels if names[label] in ids]
    if not used:
        raise InputError(
            f"No marker has a site of its name: the markers are {listed(labels)}, the model's sites {listed(ids)}; "
            "map labels to sites or places on bodies (--places FILE)."
        )
    sites = [ids[names[label]] for label in used]
    for a, b in pairwise(sorted(range(len(used)), key=lambda k: sites[k])):
        if sites[a] == sites[b]:
            raise InputError(f"Markers '{short(used[a])}' and '{short(used[b])}' have the same site.")
    weights = np.array([places[label].weight for label in used])
    rest, still = _fixed(model, fix)
    still |= {int(model.jnt_dofadr[id_of(model, mujoco.mjtObj.mjOBJ_JOINT, name)]) for name in laws}
    dofs = np.array([d for d in range(model.nv) if d not in still], int)
    kept = tuple(short_labels[label] for label in used)
    marked = MarkedModel(spec, model, kept, np.array(sites), weights, rest, dofs, _followers(model, laws), up)
    return marked, [label for label in labels if label not in used]


def marked_positions(markers: Markers, unmatched: Collection[str], marked: MarkedModel, up: str | None) -> np.ndarray:
    """Positions of the markers that have a site, in the model's world, m (N, M, 3).

    Args:
        markers: The markers, in the laboratory's axes.
        unmatched: Labels of those without a site.
        marked: The model.
        up: Axis of the laboratory that points up, by default the model's own.
    """
    kept = [k for k, label in enumerate(markers.labels) if label not in unmatched]
    rotation = UP[marked.up].T @ UP[up or marked.up]
    return markers.positions[:, kept] @ rotation.T


def _without_subject(labels: Sequence[str]) -> dict[str, str]:
    """Labels without the prefix before a colon, by full label; unchanged if the prefix is not common to all."""
    subjects = {label.rpartition(":")[0] for label in labels}
    cut = len(subjects) == 1 and subjects != {""}
    return {label: label.rpartition(":")[2] if cut else label for label in labels}


def _add_sites(spec: mujoco.MjSpec, places: Mapping[str, MarkerPlace]) -> dict[str, str]:
    """Adds sites at positions on bodies, and returns the names of all sites by label."""
    names, bodies = {}, {body.name: body for body in spec.bodies}
    taken = {site.name for site in spec.sites}
    for label, place in places.items():
        names[label] = place.site
        if place.body:
            if place.body not in bodies:
                raise ModelError(f"markers.{label}: the model has no body '{place.body}', but {listed(bodies)}.")
            name = label if label not in taken else f"{label}_marker"
            while name in taken:
                name += "_"
            taken.add(name)
            bodies[place.body].add_site(name=name, pos=place.position)
            names[label] = name
    return names


def _followers(model: mujoco.MjModel, laws: Mapping[str, Follower]) -> tuple[FollowingJoint, ...]:
    """Followers from their functions by the joints' names."""

    def place(name: str) -> tuple[int, int]:
        j = id_of(model, mujoco.mjtObj.mjOBJ_JOINT, name)
        return int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])

    return tuple(FollowingJoint(place(law.joint), place(name), law) for name, law in laws.items())


def _fixed(model: mujoco.MjModel, fix: Mapping[str, Sequence[float]]) -> tuple[np.ndarray, set[int]]:
    """Coordinates with fixed joints set (nq,), and the degrees of freedom of these joints."""
    places = dict[str, tuple[slice, range]]()
    for j, kind in enumerate(model.jnt_type):
        name, q, v = joint_name(model, j), int(model.jnt_qposadr[j]), int(model.jnt_dofadr[j])
        if kind == mujoco.mjtJoint.mjJNT_FREE:
            # A tree has three slides and a ball for it.
            places |= {f"{name}:{c}": (slice(q + k, q + k + 1), range(v + k, v + k + 1)) for k, c in enumerate("xyz")}
            q, v = q + 3, v + 3
        turns = kind in (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL)
        places[name] = slice(q, q + (4 if turns else 1)), range(v, v + (3 if turns else 1))
    coordinates, still = model.qpos0.copy(), set[int]()
    for name, values in fix.items():
        if name not in places:
            raise ModelError(f"There is no joint '{name}' to fix; the joints are {listed(places)}.")
        own, dofs = places[name]
        if len(values) not in (0, own.stop - own.start):
            raise InputError(f"--fix {name} needs {own.stop - own.start} coordinates, got {len(values)}.")
        if values:
            coordinates[own] = values
        still.update(dofs)
    return coordinates, still


def base_of(model: mujoco.MjModel, name: str | None) -> str | None:
    """Body whose frame is {0}: the named one, or else that of the model's only free joint, or else None for the world.

    Raises:
        ModelError: No body has that name.
    """
    if name is not None:
        body_id(model, name)
        return name
    free = [j for j in range(model.njnt) if model.jnt_type[j] == _FREE]
    return name_of(model, mujoco.mjtObj.mjOBJ_BODY, int(model.jnt_bodyid[free[0]])) if len(free) == 1 else None
