"""Set-up parameters of the channels of a recording: the kinds of `ident.setup`, for every object that has them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from types import MappingProxyType

import numpy as np

from ident.estimation.equations import COMPONENTS, Equations
from ident.geometry.se3 import hat, pose, small_rotation
from ident.mechanism.body import BASE, Body
from ident.mechanism.tree import Tree
from ident.model.tape import Value
from ident.parameters.person_prior import without_side
from ident.parameters.prior import known_covariance, known_roots, known_rows
from ident.recordings.stated import Tracker
from ident.recordings.wrench import GROUND
from ident.setup import SETUP, SetupKind, Shift
from ident.tolerances import ROUNDING

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
        words = self.row.along if self.link else self.row.signs
        return self.text(words[(value <= 0) != self.link.startswith("-")])


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
    """Objects that may differ from what is stated, along each of their axes; arguments as for `setup_parameters`.

    Returns:
        Parameters without a kind, with a standard deviation if it is not the kind's, by `SetupKind.of`: `clocks` of the
        wrenches, one for all that share it; `commands` of servos, if there are no other channels; `torque_clocks`, one
        for all joint torques, if no joint is commanded and no contact is measured; `frames` of the
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
        TORQUE_CLOCKS: [_parameter("")] if equations.torques and not (commanded or contacts) else [],
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

CLOCKS, TORQUE_CLOCKS = "tracker_clocks", "torque_clocks"
"""Objects of a delay of poses, which any motion shows, and of a delay of joint torques."""

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
        shares = {x: float(tilt) for x, tilt in zip("xyz", tilts[k], strict=True) if abs(tilt) > ROUNDING}
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
    names = {members[-1]: joint for joint, members in tree.compounds.items()}
    parents = {joint: tree.bodies[members[0]].parent for joint, members in tree.compounds.items()}
    on_base = [joint for joint, i in parents.items() if i == BASE or not (moving or i in tree.moved)]
    for joint, members in tree.compounds.items():
        parent, other, link = parents[joint], names.get(parents[joint], ""), np.zeros(3)
        if on_base == [joint] or {tree.bodies[i].name for i in members} & {*loops}:
            continue
        R = _home(tree, parent)[:3, :3]
        turns = [R.T @ _home(tree, i)[:3, :3] @ tree.bodies[i].motions[3:] for i in tree.chain(parent)]
        axes = [k for k in range(3) if felt or any(np.delete(abs(w) > ROUNDING, k, axis=0).any() for w in turns)]
        if other:
            end, start = (_home(tree, i) @ _centre(tree.bodies[i]) for i in (members[0], parent))
            link = R.T @ (end - start)[:3]
            link /= max(np.linalg.norm(link), ROUNDING)
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


@dataclass(frozen=True, eq=False)
class ChannelParameters:
    """Parameters θ = [ψ, drives, offsets, set-up] of channels, and what their values state.

    Attributes:
        equations: Channels and columns.
        setup: Set-up parameters.
        moving: True if the base moves and is tracked; its position and quaternion are then the first coordinates. For
            a mechanism with a carrier the carrier's joints are.
    """

    equations: Equations
    setup: tuple[SetupParameter, ...]
    moving: bool

    @property
    def tree(self) -> Tree:
        """The mechanism's tree."""
        return self.equations.mechanism.tree

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters θ."""
        return (*self.equations.names, *(each.name for each in self.setup))

    @cached_property
    def setup_at(self) -> dict[int, SetupParameter]:
        """Set-up parameters by their index in θ."""
        return dict(enumerate(self.setup, len(self.equations.names)))

    @cached_property
    def shifts(self) -> dict[int, Shift]:
        """Shifts of the true times of a wrench, or of torques without one, by index in θ, rates of clocks first."""
        others = {CLOCKS, TORQUE_CLOCKS} if self._beside_wrench else {CLOCKS}
        return self._shifts({row.of for row in SETUP.values()} - others)

    @cached_property
    def torque_shifts(self) -> dict[int, Shift]:
        """Shifts of the true times of torques beside a wrench by index in θ."""
        return self._shifts({TORQUE_CLOCKS}) if self._beside_wrench else {}

    @cached_property
    def pose_shifts(self) -> dict[int, Shift]:
        """Shifts of the true times of poses by index in θ."""
        return self._shifts({CLOCKS})

    @property
    def _beside_wrench(self) -> bool:
        return len(self.equations.channels) > len(self.equations.torques)

    def _shifts(self, groups: Collection[str]) -> dict[int, Shift]:
        own = ((at, each.row) for at, each in reversed(self.setup_at.items()) if each.row.of in groups)
        return {at: row.shift for at, row in own if row.shift is not None}

    def of_kind(self, kind: str, of: str = "") -> dict[int | None, int]:
        """Indices in θ of the set-up parameters of a kind, by axis."""
        return {s.axis: at for at, s in self.setup_at.items() if s.kind == kind and (not of or s.of == of)}

    def _vector(self, kind: str, of: str, theta: np.ndarray) -> np.ndarray:
        """Set-up parameters of a kind as a vector, zeros where there are none (3,)."""
        at = self.of_kind(kind, of)
        return np.array([theta[at[axis]] if axis in at else 0.0 for axis in range(3)])

    def displacement(self, of: str, theta: np.ndarray) -> np.ndarray:
        """Pose of a frame of a sensor, a tracker or markers where it was stated or aligned (4, 4)."""
        return pose(small_rotation(self._vector("rotation", of, theta)), self._vector("origin", of, theta))

    def gravity(self, theta: np.ndarray) -> np.ndarray:
        """Acceleration of gravity, tilted (3,)."""
        return small_rotation(self._vector("gravity", "", theta)) @ self.equations.mechanism.gravity

    def gains(self, theta: np.ndarray, of: Sequence[str] = ()) -> list[Value]:
        """Gain 1 + g of each channel, or of each named one, as numbers or signals."""
        at = [self.of_kind("gain", name) or self.of_kind("scale", name) for name in of or self.equations.channels]
        return [1 + theta[own[None]] if own else 1.0 for own in at]

    def constants(self, theta: np.ndarray) -> np.ndarray:
        """Constant offset of each channel (C,)."""
        out, equations = np.zeros(len(self.equations.channels)), self.equations
        first = equations.parameters.rank + len(equations.drives)
        out[list(equations.offsets)] = theta[first : first + len(equations.offsets)]
        return out

    def encoders(self, q: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Readings of the encoders of hinges and slides by freedom, zero for balls (…, n), at coordinates (…, n_q)."""
        zeros = [self.of_kind("zero", freedom).get(None) for freedom in self.tree.freedoms]
        off = np.array([0.0 if at is None else theta[at] for at in zeros])
        return self.tree.freedom_coordinates(q) + off

    def corrected_tree(self, theta: np.ndarray) -> Tree:
        """Tree with joints displaced, and hinges' axes tilted, each about its point closest to the body's origin."""
        bodies = list(self.tree.bodies)
        for i, body in enumerate(bodies):
            if body.joint and self.of_kind("axis", body.joint):
                v, w = body.twist[:3], body.twist[3:]
                axis = small_rotation(self._vector("axis", body.joint, theta)) @ w
                bodies[i] = replace(body, twist=np.concatenate([hat(np.cross(w, v)) @ axis + (v @ w) * axis, axis]))
        for joint, members in self.tree.compounds.items():
            if self.of_kind("centre", joint):
                first = bodies[k := members[0]]
                place = first.home[:3, 3] + self._vector("centre", joint, theta)
                bodies[k] = replace(first, home=pose(first.home[:3, :3], place))
        return replace(self.tree, bodies=tuple(bodies))

    @property
    def of_base(self) -> int:
        """Number of coordinates of the base's motion: its carrier's joints', or a position and a quaternion."""
        carrier = self.equations.mechanism.carrier
        return carrier.tree.size if carrier else 7 if self.moving else 0

    @cached_property
    def _regrouping(self) -> list[int]:
        """Indices in θ of what changes how φ is regrouped; on a moving base, gravity does not."""
        kinds = ("axis", "centre") if self.of_base else ("axis", "centre", "gravity")
        return [at for at, each in self.setup_at.items() if each.kind in kinds]

    def is_displaced(self, theta: np.ndarray) -> bool:
        """True if ψ was regrouped for other joints, or for another gravity, than θ has."""
        return any(theta[at] for at in self._regrouping)

    @cached_property
    def _unseen(self) -> tuple[np.ndarray, np.ndarray]:
        """Dependent entries of φ by the model (d,), and their likeliest changes by those of ψ (d, r).

            φ_d(ψ) = φ_d + D (ψ - ψ_model),        D = (S Bᵀ)_d (B S Bᵀ)⁻¹

        with ψ = B φ and S the prior covariance of φ. No channel shows them at the joints of the model, but where these
        are displaced or tilted, ψ alone is no body: it may have -1700 kg where two joints are 10 mm apart.
        """
        mechanism, parameters = self.equations.mechanism, self.equations.parameters
        dependent, rank = list(parameters.dependent), parameters.rank
        prior = np.zeros(len(parameters.parameters)) if mechanism.prior is None else mechanism.prior
        if not self._regrouping or not (prior[::10] > 0).any():
            return prior[dependent], np.zeros((len(dependent), rank))
        covariance = known_covariance(mechanism, parameters, absorbed=self.equations.absorbed)
        of_bodies, rows = known_roots(mechanism).reshape(-1, 10, 10), known_rows(mechanism, parameters)
        across = np.einsum("bkp,bkr->bpr", of_bodies, rows.reshape(-1, 10, rank)).reshape(-1, rank)[dependent]
        scale = np.sqrt(np.diag(covariance))
        changes = np.linalg.solve(covariance / np.outer(scale, scale), across.T / scale[:, None])
        return prior[dependent], changes.T / scale

    def unseen(self, theta: np.ndarray) -> np.ndarray:
        """Likeliest dependent entries of φ (d,)."""
        (of_model, changes), rank = self._unseen, self.equations.parameters.rank
        return of_model + changes @ (theta[:rank] - self.equations.from_model[:rank])

    def beside(self, theta: np.ndarray) -> np.ndarray:
        """φ that acts beside ψ, by which no channel is changed at the model's joints (10 b,)."""
        return self.with_dependent(self.unseen(theta))

    def with_dependent(self, unseen: np.ndarray) -> np.ndarray:
        """φ of dependent entries (d,) and base parameters of zero, numbers or signals (10 b,)."""
        parameters = self.equations.parameters
        phi = np.zeros(len(parameters.parameters), unseen.dtype)
        phi[list(parameters.dependent)] = unseen
        for row, beta in zip(parameters.kept, parameters.beta, strict=True):
            for k in np.flatnonzero(beta):
                phi[row] = phi[row] - beta[k] * unseen[k]
        return phi
