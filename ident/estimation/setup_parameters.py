"""Set-up parameters of the channels of a recording: the kinds of `ident.setup`, for every object that has them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from types import MappingProxyType
from typing import NamedTuple

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
        calibrated: True if poses of a tracked body show it, so that it is estimated without a search.
        constant: True if it is of a frame that nobody knows, which is always estimated and no error.
        together: Its share in errors that change several parameters together, by their description.
    """

    kind: str
    of: str
    axis: int | None
    std: float
    log: int | None = None
    place: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)
    link: str = ""
    calibrated: bool = False
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

    @property
    def estimated(self) -> bool:
        """True if it is estimated without a search."""
        return self.row.stated or self.constant or self.calibrated

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


class Subject(NamedTuple):
    """Something that may differ from what is stated.

    Attributes:
        name: Its name, "" for gravity.
        axes: Axes along which it may; one None if it has no axes.
        place: As for `SetupParameter`.
        std: Standard deviation of its own, by default the kind's.
        links: `SetupParameter.link` by axis.
        together: `SetupParameter.together` by axis.
        constant: Standard deviation of a constant that nobody knows, whatever is stated; zero for an error.
    """

    name: str
    axes: Sequence[int | None]
    place: Mapping[str, tuple[str, ...]]
    std: float | None = None
    links: Mapping[int | None, str] = MappingProxyType({})
    together: Mapping[int | None, Mapping[str, float]] = MappingProxyType({})
    constant: float = 0.0


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
    return tuple(
        SetupParameter(
            *(kind, subject.name, axis, own),
            place=subject.place,
            link=subject.links.get(axis, ""),
            calibrated=row.of == CLOCKS or (subject.name in carrying and row.of in OF_JOINTS),
            constant=subject.constant > 0,
            together=subject.together.get(axis, {}),
        )
        for group in dict.fromkeys(row.of for row in SETUP.values())
        for subject in every[group]
        for kind, row in SETUP.items()
        if row.of == group and (own := _deviation(kind, subject, given)) > 0
        for axis in subject.axes
    )


def _deviation(kind: str, subject: Subject, given: Mapping[str, float]) -> float:
    """Standard deviation of an error: its own if it is a constant, as stated of it or of its kind, or the usual one."""
    usual = given.get(kind, subject.std or SETUP[kind].std)
    return subject.constant or given.get(f"{kind}({subject.name})", usual)


def objects(
    equations: Equations,
    contacts: Sequence[str],
    *,
    held: bool,
    moving: bool = False,
    trackers: Mapping[str, Tracker] = MappingProxyType({}),
) -> dict[str, list[Subject]]:
    """Objects of the kinds of set-up errors, by `SetupKind.of`; arguments as for `setup_parameters`.

    Returns:
        `clocks` of the wrenches, one for all that share it; `commands` of servos, if there are no other channels;
        `frames` of the wrenches, and unknown ones of trackers and markers; `channels`, and those of the contacts;
        `scales` of torques that are stated not to be exact, whose channels have no gain besides; `gravity`, about the
        axes across it; `angles` of the hinges, and their `axes`, about those across; `centres` of the joints;
        `tracker_clocks`, one for all tracked bodies.
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
        "clocks": [Subject(TOGETHER.join(together), (None,), {"wrenches": together})] if together else [],
        "commands": [Subject("", (None,), {})] if not wrench and len(commanded) == len(equations.channels) > 0 else [],
        "frames": [Subject(name, range(3), {"wrenches": (name,)}) for name in (*ground, *contacts)]
        + [Subject(name, range(3), {}, constant=UNKNOWN) for name in unknown],
        "channels": [
            Subject(name, (None,), {"channels": (name,)}) for name in channels if name not in (*commanded, *scales)
        ]
        + [Subject(f"{name} {x}", (None,), {"wrenches": (name,)}) for name in contacts for x in COMPONENTS],
        "scales": [Subject(name, (None,), {"channels": (name,)}, std) for name, std in scales.items()],
        "gravity": [Subject("", across(gravity), {})] if np.any(gravity) else [],
        "angles": [Subject(name := tree.bodies[i].joint, (None,), {"joints": (name,)}) for i in hinges],
        "axes": [_axis(tree, i) for i in hinges if tree.names[i] not in loops],
        "centres": _centres(equations, loops, moving=moving, tracked=bool(trackers)),
        CLOCKS: [Subject("", (None,), {})] if trackers else [],
    }


ALONG = 0.97
"""Least cosine between a link and a coordinate axis, as within 14°, with which a shift along that axis is one along the
link."""

PARALLEL = 1e-9
"""Largest component of a unit vector across another one with which they are parallel, but for rounding."""

OF_JOINTS = ("angles", "axes", "centres")
"""Objects of the kinds of errors that displace or turn bodies."""

CLOCKS = "tracker_clocks"
"""Objects of a delay of poses, which any motion shows."""

UNKNOWN = 1.0
"""Standard deviation of an unknown frame from where it was aligned, m and rad: far more than the alignment is wrong."""

TRACKER, MARKERS = "the tracker", "markers of '{}'"
"""Names of the frames of a tracker and of the markers of a tracked body."""


def _axis(tree: Tree, i: int) -> Subject:
    """Axis of a hinge, which may tilt about the coordinate axes across it: a common turn of all axes, too.

    A turn t of the axis w about an axis of the base frame, in the home posture, is one by the tilts t - w t_c / w_c,
    where c is the coordinate axis about which there is no tilt.
    """
    body = tree.bodies[i]
    axes, w = across(body.twist[3:]), body.twist[3:]
    t, (c,) = _home(tree, i)[:3, :3].T, {0, 1, 2} - {*axes}
    tilts = t - np.outer(w / w[c], t[c])
    together: dict[int | None, Mapping[str, float]] = {
        k: {x: float(tilt) for x, tilt in zip("xyz", tilts[k], strict=True) if abs(tilt) > PARALLEL} for k in axes
    }
    return Subject(body.joint, axes, {"joints": (body.joint,)}, together=together)


def _home(tree: Tree, i: int, first: int = 0) -> np.ndarray:
    """Pose of body i in the home posture, in the base frame or in that which carries the body `first` (4, 4)."""
    return reduce(np.matmul, (tree.bodies[k].home for k in tree.chain(i) if k >= first))


def _centres(equations: Equations, loops: Sequence[str], *, moving: bool, tracked: bool) -> list[Subject]:
    """Joints that may be displaced in the frames of the bodies that carry them, compound ones as a whole.

    Left out is what changes nothing: in torques alone, a shift along the axis about which all before the joint turns;
    and the place of a mechanism's only joint on its base, which is that of the sensors.
    """
    tree, wrench = equations.mechanism.tree, len(equations.channels) > len(equations.torques)
    felt = moving or tracked or wrench

    def rests(parent: int) -> bool:
        return parent == BASE or not (moving or any(tree.bodies[i].moves for i in tree.chain(parent)))

    firsts = {joint: tree.first_link(members[0]) for joint, members in tree.compounds.items()}
    names = {first: joint for joint, first in firsts.items()}
    on_base, out = [joint for joint, first in firsts.items() if rests(tree.bodies[first].parent)], []
    for joint, members in tree.compounds.items():
        first, parent = firsts[joint], tree.bodies[firsts[joint]].parent
        if on_base == [joint] or {tree.bodies[i].name for i in members} & {*loops}:
            continue
        turns, R = np.zeros((3, 0)), np.eye(3)
        for i in reversed(tree.chain(parent)):
            turns, R = np.hstack([turns, R @ tree.bodies[i].motions[3:]]), R @ tree.bodies[i].home[:3, :3].T
        axes = [k for k in range(3) if felt or (np.abs(np.delete(turns, k, axis=0)) > PARALLEL).any()]
        other = "" if parent == BASE else names.get(tree.first_link(parent), "")
        links, lengths = dict[int | None, str](), dict[int | None, Mapping[str, float]]()
        if other:
            link = _home(tree, members[0], first) @ _centre(tree.bodies[members[0]]) - _centre(tree.bodies[parent])
            link /= max(np.linalg.norm(link), PARALLEL)
            links = {k: "-" * bool(link[k] < 0) + other for k in axes if abs(link[k]) > ALONG}
            ends = " to ".join(without_side(name) for name in (other, joint))
            lengths = {k: {ends: float(link[k])} for k in links or axes}
        out.append(Subject(joint, axes, {"joints": (joint,)}, equations.mechanism.centre_std, links, lengths))
    return out


def _centre(body: Body) -> np.ndarray:
    """Point of a joint in its body's frame: that of a hinge's axis nearest to the origin, homogeneous (4,)."""
    v, w = body.twist.reshape(6, -1)[:3], body.twist.reshape(6, -1)[3:]
    return np.append(np.cross(w, v, axis=0).sum(axis=1) / max(w.shape[1] - 1, 1), 1.0)


def across(direction: np.ndarray) -> list[int]:
    """Indices of the two coordinate axes farthest from a direction."""
    return sorted(np.argsort(np.abs(np.asarray(direction, float)), kind="stable")[:2].tolist())
