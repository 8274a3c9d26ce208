"""Set-up parameters of the channels of a recording: the kinds of `ident.setup`, for every object that has them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from types import MappingProxyType

import numpy as np

from ident.estimation.equations import COMPONENTS, Equations
from ident.mechanism.body import BASE, Body
from ident.mechanism.tree import Tree
from ident.parameters.person_prior import without_side
from ident.recordings.stated import Tracker
from ident.recordings.wrench import GROUND
from ident.setup import SETUP, SetupKind

TOGETHER = " + "
"""Separator of the names of wrenches that share a delay and a clock."""


@dataclass(frozen=True)
class SetupParameter:
    """Parameter that is zero if the set-up is as stated.

    Attributes:
        kind: One of `SETUP`.
        of: Wrench, channel or joint, "" for gravity; `contact Fx` for a gain of a contact.
        axis: Axis of the frame, or None.
        std: Standard deviation of the prior, whose mean is zero, in SI units and radians.
        log: Number of the log that has it separately, counted from 1; None if it is that of the first or of all.
        place: Names of the wrenches, channels or joints that it belongs to, by `wrenches`, `channels` and `joints`.
        link: Joint at the other end of a link along the axis; with a minus if the axis points towards it.
        estimated: True if it is estimated without a search, as what poses of a tracked body show.
        constant: True if it is of a frame that nobody knows, so that it is no error.
        together: Its share in errors that change several parameters together, by their description.
    """

    kind: str
    of: str
    axis: int | None
    std: float
    log: int | None = None
    place: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)
    link: str = ""
    estimated: bool = False
    constant: bool = False
    together: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def row(self) -> SetupKind:
        """Its kind's row."""
        return SETUP[self.kind]

    @property
    def name(self) -> str:
        """Name of the column: `origin_x(ground)`, `delay(ground) of log 2`."""
        name = self.kind if self.axis is None else f"{self.kind}_{'xyz'[self.axis]}"
        name = f"{name}({self.of})" if self.of else name
        return name if self.log is None else name_in_log(name, self.log)

    def text(self, template: str, **values: str) -> str:
        """A template of its row, with its object, its axis and other values."""
        axis = "" if self.axis is None else "xyz"[self.axis]
        return template.format(of=self.of, axis=axis, link=self.link.removeprefix("-"), **values)

    def sign(self, value: float) -> str:
        """Words for the sign of an error."""
        if not self.link:
            return self.text(self.row.signs[value <= 0])
        return self.text(self.row.along[(value <= 0) != self.link.startswith("-")])


def name_in_log(name: str, log: int) -> str:
    """Name of a parameter that a log has separately."""
    return f"{name} of log {log}"


def setup_parameters(
    equations: Equations,
    contacts: Sequence[str],
    priors: Mapping[str, float] | None = None,
    *,
    held: bool = True,
    moving: bool = False,
    trackers: Mapping[str, Tracker] = MappingProxyType({}),
) -> tuple[SetupParameter, ...]:
    """Set-up parameters of the channels of a recording.

    Args:
        equations: Equations to fit.
        contacts: Names of the wrenches besides the ground's, one for all bodies that share a plate.
        priors: Standard deviations that replace those of `PRIORS`, of a kind or of one object (`centre(elbow)`); zero
            leaves out.
        held: True if there is a ground wrench; without one, all contacts share a delay and a clock, and their sum has
            no gains besides theirs.
        moving: True if the base moves.
        trackers: Tracked bodies.
    """
    given, every = priors or {}, objects(equations, contacts, held=held, moving=moving, trackers=trackers)
    tree = equations.mechanism.tree
    carrying = {tree.bodies[i].joint for x in trackers.values() for i in tree.chain(tree.names.index(x.body))}
    shown = {"angles": carrying, "axes": carrying, "centres": carrying, CLOCKS: {""}}
    return tuple(
        replace(each, kind=kind, std=own, estimated=row.stated or each.constant or each.of in shown.get(group, ()))
        for group in dict.fromkeys(row.of for row in SETUP.values())
        for of in dict.fromkeys(each.of for each in every[group])
        for kind, row in SETUP.items()
        if row.of == group
        for each in every[group]
        if each.of == of and (own := _deviation(kind, each, given)) > 0
    )


def _deviation(kind: str, each: SetupParameter, given: Mapping[str, float]) -> float:
    """Standard deviation of an error: its own if it is a constant, as stated of it or of its kind, or the usual one."""
    usual = given.get(kind, each.std or SETUP[kind].std)
    return each.std if each.constant else given.get(f"{kind}({each.of})", usual)


def objects(
    equations: Equations,
    contacts: Sequence[str],
    *,
    held: bool,
    moving: bool = False,
    trackers: Mapping[str, Tracker] = MappingProxyType({}),
) -> dict[str, list[SetupParameter]]:
    """What may differ from what is stated, along each of its axes; arguments as for `setup_parameters`.

    Returns:
        Parameters without a kind, with a standard deviation if it is not the kind's, by `SetupKind.of`: `clocks` of the
        wrenches, one for all that share it; `commands` of servos, if there are no other channels; `frames` of the
        wrenches, and unknown ones of trackers and markers; `channels`, and those of the contacts; `scales` of torques
        that are stated not to be exact, whose channels have no gain besides; `gravity`, about the axes across it;
        `angles` of the hinges, and their `axes`, about those across; `centres` of the joints; `tracker_clocks`, one for
        all tracked bodies.
    """
    tree, gravity = equations.mechanism.tree, equations.mechanism.gravity
    wrench = len(equations.channels) > len(equations.torques)
    ground = (GROUND,) if wrench and held else ()
    together = ground if held else tuple(contacts) if wrench else ()
    channels = equations.channels[0 if held else len(equations.channels) - len(equations.torques) :]
    commanded = [name for k, name in enumerate(equations.channels) if k not in equations.sensed]
    scales, tracker = equations.scaled, [TRACKER] * any(each.frame is None for each in trackers.values())
    unknown = tracker + [MARKERS.format(name) for name, each in trackers.items() if each.markers is None]
    hinges = [i for i, body in enumerate(tree.bodies) if body.coordinates and body.turns]
    # A tilted axis would open its loop.
    loops = tree.closure.part.names if tree.closure else ()
    return {
        "clocks": [_parameter(TOGETHER.join(together), wrenches=together)] if together else [],
        "commands": [_parameter("")] if not wrench and len(commanded) == len(equations.channels) > 0 else [],
        "frames": [_parameter(name, k, wrenches=(name,)) for name in (*ground, *contacts) for k in range(3)]
        + [_parameter(name, k, UNKNOWN, constant=True) for name in unknown for k in range(3)],
        "channels": [_parameter(name, channels=(name,)) for name in channels if name not in (*commanded, *scales)]
        + [_parameter(f"{name} {x}", wrenches=(name,)) for name in contacts for x in COMPONENTS],
        "scales": [_parameter(name, None, std, channels=(name,)) for name, std in scales.items()],
        "gravity": [_parameter("", k) for k in across(gravity)] if np.any(gravity) else [],
        "angles": [_parameter(name, joints=(name,)) for name in (tree.bodies[i].joint for i in hinges)],
        "axes": [each for i in hinges if tree.names[i] not in loops for each in _axes(tree, i)],
        "centres": _centres(equations, loops, felt=wrench or moving or bool(trackers), moving=moving),
        CLOCKS: [_parameter("")] if trackers else [],
    }


def _parameter(
    of: str, axis: int | None = None, std: float = 0.0, *, constant: bool = False, **place: tuple[str, ...]
) -> SetupParameter:
    """Parameter without a kind, with a place by keyword."""
    return SetupParameter("", of, axis, std, place=place, constant=constant)


ALONG = 0.97
"""Least cosine between a link and a coordinate axis, as within 14°, with which a shift along that axis is one along the
link."""

PARALLEL = 1e-9
"""Largest component of a unit vector across another one with which they are parallel, but for rounding."""

CLOCKS = "tracker_clocks"
"""Objects of a delay of poses, which any motion shows."""

UNKNOWN = 1.0
"""Standard deviation of an unknown frame from where it was aligned, m and rad: far more than the alignment is wrong."""

TRACKER, MARKERS = "the tracker", "markers of '{}'"
"""Names of the frames of a tracker and of the markers of a tracked body."""


def _axes(tree: Tree, i: int) -> list[SetupParameter]:
    """Tilts of a hinge's axis about the coordinate axes across it, and their shares in a common turn of all axes.

    A turn t of the axis w about an axis of the base frame, in the home posture, is one by the tilts t - w t_c / w_c,
    where c is the coordinate axis about which there is no tilt.
    """
    joint, w = tree.bodies[i].joint, tree.bodies[i].twist[3:]
    t, (c,) = _home(tree, i)[:3, :3].T, {0, 1, 2} - {*across(w)}
    tilts, out = t - np.outer(w / w[c], t[c]), list[SetupParameter]()
    for k in across(w):
        shares = {x: float(tilt) for x, tilt in zip("xyz", tilts[k], strict=True) if abs(tilt) > PARALLEL}
        out.append(replace(_parameter(joint, k, joints=(joint,)), together=shares))
    return out


def _home(tree: Tree, i: int) -> np.ndarray:
    """Pose of a body in the base frame, in the home posture (4, 4)."""
    return reduce(np.matmul, (tree.bodies[k].home for k in tree.chain(i)), np.eye(4))


def _centres(equations: Equations, loops: Sequence[str], *, felt: bool, moving: bool) -> list[SetupParameter]:
    """Displacements of joints in the frames of the bodies that carry them, of compound ones as a whole.

    Left out is what changes nothing: in torques alone, a shift along the axis about which all before the joint turns;
    and the place of a mechanism's only joint on its base, which is that of the sensors.

    Args:
        equations: Equations to fit.
        loops: Names of the bodies in loops.
        felt: True if more than torques is measured.
        moving: True if the base moves.
    """
    tree, std, out = equations.mechanism.tree, equations.mechanism.centre_std or 0.0, list[SetupParameter]()
    firsts = {joint: tree.first_link(members[0]) for joint, members in tree.compounds.items()}
    names = {first: joint for joint, first in firsts.items()}
    parents = {joint: tree.bodies[first].parent for joint, first in firsts.items()}
    on_base = [joint for joint, i in parents.items() if i == BASE or not (moving or i in tree.moved)]
    for joint, members in tree.compounds.items():
        parent = parents[joint]
        if on_base == [joint] or {tree.bodies[i].name for i in members} & {*loops}:
            continue
        R, before = _home(tree, parent)[:3, :3], tree.chain(parent)
        turns = [R.T @ _home(tree, i)[:3, :3] @ tree.bodies[i].motions[3:] for i in before]
        across_axis = np.abs(np.hstack([np.zeros((3, 0)), *turns])) > PARALLEL
        axes = [k for k in range(3) if felt or np.delete(across_axis, k, axis=0).any()]
        other, link = "" if parent == BASE else names.get(tree.first_link(parent), ""), np.zeros(3)
        if other:
            end, start = (_home(tree, i) @ _centre(tree.bodies[i]) for i in (members[0], parent))
            link = R.T @ (end - start)[:3]
            link /= max(np.linalg.norm(link), PARALLEL)
        along = [k for k in axes if abs(link[k]) > ALONG]
        ends = " to ".join(without_side(name) for name in (other, joint))
        for k in axes:
            named = "-" * bool(link[k] < 0) + other if k in along else ""
            shares = {ends: float(link[k])} if other and k in (along or axes) else {}
            out.append(replace(_parameter(joint, k, std, joints=(joint,)), link=named, together=shares))
    return out


def _centre(body: Body) -> np.ndarray:
    """Point of a joint in its body's frame: that of a hinge's axis nearest to the origin, homogeneous (4,)."""
    v, w = body.twist.reshape(6, -1)[:3], body.twist.reshape(6, -1)[3:]
    return np.append(np.cross(w, v, axis=0).sum(axis=1) / max(w.shape[1] - 1, 1), 1.0)


def across(direction: np.ndarray) -> list[int]:
    """Indices of the two coordinate axes farthest from a direction."""
    return sorted(np.argsort(np.abs(np.asarray(direction, float)), kind="stable")[:2].tolist())
