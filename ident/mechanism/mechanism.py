"""A mechanism with its prior knowledge, before anything is measured, and the plane in which it may move."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import typed
from ident.arguments import OF_BODIES, checked_deviations, checked_rpy, rpy_text
from ident.display.brief import Brief, listed
from ident.errors import InputError, ModelError
from ident.mechanism.body import BASE, Body, Follower
from ident.mechanism.drives import NO_DRIVE, Drive, checked_drives
from ident.mechanism.loops import INDEPENDENT, Constraints
from ident.mechanism.motion import Carrier, divided
from ident.mechanism.tree import Tree


@typed("gravity", "prior_known", "drives")
@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(Brief):
    """A tree of bodies with gravity, and the prior, sites, ranges and drives of a model.

    Attributes:
        tree: The bodies and their joints.
        gravity: Acceleration of gravity in the axes of the base frame, m/s² (3,); for a moving base in those of the
            inertial frame of its poses.
        prior: φ of the bodies from the model, stacked (10 b,); None without one.
        sites: Named places of sensors, each the name of a body and a pose in its frame (4, 4).
        ranges: Limits of joint coordinates by the joints' names, rad or m.
        source: The model that it was read from, for writing it back.
        pose: Pose of the base frame in the model's world, for a base at rest (4, 4).
        carrier: Carrier of the base, if joints with known kinematics move it; gravity is then in the axes of the
            carrier's base frame.
        prior_known: Standard deviations of the prior by the bodies' names, as for
            `ident.parameters.prior.body_covariance`; defaults for others.
        drives: Friction, rotor inertia, springs and actuators as the model states them, by the names of the driven
            freedoms: the joints', with `.x`, `.y` and `.z` for a ball.
        loops: Joints whose torques a coupling that the equations leave out changes, by its name.
        base_rpy_deg: Roll, pitch and yaw of the base frame in the world, degrees, if they are others than in the model.
        constraints: Constraints that close loops of the tree, for `closed`.
        centre_std: Standard deviation with which the centres of its joints are known, m; None for the default.
    """

    tree: Tree
    gravity: np.ndarray
    prior: np.ndarray | None = None
    sites: Mapping[str, tuple[str, np.ndarray]] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    source: Any = None
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    carrier: Carrier | None = None
    prior_known: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    drives: Mapping[str, Drive] = field(default_factory=dict)
    loops: Mapping[str, Sequence[str]] = field(default_factory=dict)
    base_rpy_deg: tuple[float, ...] | None = None
    constraints: Constraints = field(default_factory=Constraints)
    centre_std: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", checked_gravity(self.gravity))
        if self.prior is not None and np.shape(self.prior) != (10 * len(self.bodies),):
            raise ModelError(
                f"The bodies {', '.join(self.bodies)} need a prior φ of {10 * len(self.bodies)} parameters, got shape "
                f"{np.shape(self.prior)}."
            )
        if self.prior is not None and not np.isfinite(self.prior.astype(float)).all():
            raise ModelError("A prior φ needs finite numbers, got NaN or infinity.")
        if not isinstance(self.prior_known, Mapping):
            raise ModelError(f"prior_known needs standard deviations by the bodies' names, got {self.prior_known}.")
        if absent := [name for name in self.prior_known if name not in self.bodies]:
            raise ModelError(f"prior_known names '{absent[0]}', which is none of {', '.join(self.bodies)}.")
        for name, known in self.prior_known.items():
            checked_deviations(f"prior_known of '{name}'", known, OF_BODIES, ModelError)
        object.__setattr__(self, "drives", checked_drives(self.drives, (*self.tree.freedoms, *self.tree.dependent)))

    @classmethod
    def lone_body(cls, name: str = "body", gravity: Sequence[float] = (0, 0, -9.81)) -> "Mechanism":
        """One body without a model, whose pose is measured: that of the base, in axes in which gravity is given."""
        return cls(Tree((Body(name, BASE, np.eye(4), np.zeros(6)),)), np.array(gravity, float))

    @property
    def _in_short(self) -> dict[str, object]:
        depending = self.constraints.dependent(self.tree, self.mimics, self.driven)
        mass = None if self.prior is None else f"{self.prior[::10].sum():.4g} kg in {len(self.bodies)} bodies"
        return {
            "bodies": listed(self.bodies),
            "joints": listed(joint for joint in self.tree.joints if joint not in depending),
            "dependent": listed(depending),
            "mass": mass or "none, no prior",
            "gravity": f"{listed(f'{x:.4g}' for x in self.gravity)} m/s²",
            "base": "" if self.base_rpy_deg is None else f"rpy {rpy_text(self.base_rpy_deg)}",
            "sites": listed(self.sites),
            "drives": listed(self.drives),
            "carried by": listed(self.carrier.joints) if self.carrier else "",
        }

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the b bodies with a φ, in the order of their numbers in the parameters' names, from 1."""
        return tuple(self.tree.bodies[i].name for i in self.tree.inertial)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that determine its motion: those of its carrier, then its own."""
        return (*(self.carrier.joints if self.carrier else ()), *self.tree.joints)

    @property
    def springrefs(self) -> np.ndarray:
        """Coordinates at which springs of freedoms and dependent joints rest, rad or m (n + d,); zero without one."""
        names = (*self.tree.freedoms, *self.tree.dependent)
        return np.array([self.drives.get(name, NO_DRIVE).springref for name in names])

    @typed()
    def beyond(self, body: str) -> "Mechanism":
        """A body and all bodies on it as a mechanism, with the joints before it as carrier; the source is not kept.

        Raises:
            InputError: There is no such body, no joint moves it, or this mechanism has a carrier itself.
        """
        if self.carrier:
            raise InputError(f"The part beyond '{body}' is taken from the whole mechanism, not from a part of it.")
        carrier, tree, members = divided(self.tree, body, self.constraints)
        rows = [self.tree.inertial.index(i) for i in members if i in self.tree.inertial]
        prior = None if self.prior is None else self.prior.reshape(-1, 10)[rows].ravel()
        sites = {name: place for name, place in self.sites.items() if place[0] in tree.names}
        part = Mechanism(tree, self.gravity, prior, sites, **self._of_joints(tree), carrier=carrier)
        part = replace(part, constraints=self.constraints.within(tree))
        known = {name: each for name, each in self.prior_known.items() if name in part.bodies}
        return replace(part, prior_known=known, base_rpy_deg=self.base_rpy_deg, centre_std=self.centre_std)

    @typed()
    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray]) -> "Mechanism":
        """The mechanism with some joints welded at given coordinates, as by `Tree.fixed`; they lose their drives."""
        tree, owners = self.tree.fixed(coordinates), {body.joint: body.name for body in self.tree.bodies}
        held = self.constraints.fixed({owners[joint]: q for joint, q in coordinates.items()}, tree)
        return replace(self, tree=tree, **self._of_joints(tree), constraints=held).rested()

    def rested(self) -> "Mechanism":
        """The mechanism with those joints welded as well that loops hold because others are fixed."""
        for held in self.constraints.held(self.tree) if self.tree.still else ():
            tree = held.closed(self.tree, held.coupled(self.tree))
            opened = Tree(tuple(replace(body, joint=body.depends or body.joint, depends="") for body in tree.bodies))
            at = tree.closure.anchors[0] if tree.closure else ()
            # Which lets further ones rest in turn.
            return replace(self, tree=opened).fixed({joint: [q] for joint, q in zip(tree.dependent, at, strict=True)})
        return self

    @property
    def in_world(self) -> np.ndarray:
        """Orientation of the base frame in the world, for a base at rest (3, 3)."""
        return self.pose[:3, :3] if self.base_rpy_deg is None else _orientation(self.base_rpy_deg)

    def mounted(self, rpy_deg: Sequence[float]) -> "Mechanism":
        """The mechanism on a base that is turned in the world, so that gravity has another direction in its frame.

        Args:
            rpy_deg: Roll, pitch and yaw of the base frame in the world, degrees: about its x, y and z, as in URDF.

        Raises:
            InputError: They are no three numbers, or others than were stated before.
        """
        rpy = checked_rpy("base_rpy_deg", rpy_deg)
        if self.base_rpy_deg not in (None, rpy):
            raise InputError(
                f"The base's roll, pitch and yaw are stated twice: {rpy_text(rpy)} and {rpy_text(self.base_rpy_deg)}. "
                "Keep one of rpy_deg under [base] and --base-rpy (base_rpy_deg)."
            )
        gravity = _orientation(rpy).T @ self.in_world @ self.gravity
        # Of right angles nothing but rounding is left.
        return replace(self, gravity=np.where(np.abs(gravity) < 1e-12, 0.0, gravity), base_rpy_deg=rpy)

    @cached_property
    def mimics(self) -> dict[str, Follower]:
        """Functions by which constraints make joints follow another one if they are not measured, by name.

        A joint with drives of its own depends on others instead, so that these act on it.
        """
        return {joint: law for joint, law in self.constraints.followers(self.tree).items() if joint not in self.drives}

    def following(self, followers: Mapping[str, Follower]) -> "Mechanism":
        """The mechanism with some joints that follow others, by name; they lose their names and their drives."""
        leads = {body: followers[body.joint] for body in self.tree.bodies if body.joint in followers}
        if not leads:
            return self
        bodies = (replace(each, joint="", follows=leads[each]) if each in leads else each for each in self.tree.bodies)
        tree = Tree(tuple(bodies))
        return replace(self, tree=tree, **self._of_joints(tree))

    def closed(self, lacking: Collection[str] = (), driven: Collection[str] = ()) -> "Mechanism":
        """The mechanism with those joints dependent that its loops determine; they keep their drives, by their names.

        Loops stay open if all their joints are measured and none is driven: they change no wrench.

        Args:
            lacking: Names of the joints whose positions are not measured.
            driven: Names of the joints with a torque or a command.

        Raises:
            ModelError: A loop cannot be closed in the model's posture, is singular there, or has no motion.
        """
        tree = self.constraints.closing(self.tree, lacking, driven)
        return self if tree is self.tree else replace(self, tree=tree, **self._of_joints(tree))

    def determined(self, placed: Collection[str]) -> tuple[str, ...]:
        """Names of the joints without a position that those with one determine."""
        lacking = [joint for joint in self.tree.joints if joint not in placed]
        return tuple(joint for joint in self.constraints.dependent(self.tree, lacking) if joint in lacking)

    @property
    def in_loops(self) -> tuple[str, ...]:
        """Names of the joints that constraints couple, also those that follow another one."""
        return self.constraints.coupled(self.tree)

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the freedoms with actuators."""
        return tuple(name for name, drive in self.drives.items() if drive.actuators)

    @property
    def loose(self) -> tuple[str, ...]:
        """Names of joints in loops that actuators and constraints leave free where actuators drive others of them."""
        depending = self.constraints.dependent(self.tree, self.mimics, self.driven)
        loose = tuple(joint for joint in self.in_loops if joint not in (*self.driven, *depending))
        return loose if {*self.driven} & {*self.in_loops} else ()

    def _of_joints(self, tree: Tree) -> dict[str, Any]:
        """Ranges, drives and couplings of the joints that a tree has."""
        ranges = {joint: limits for joint, limits in self.ranges.items() if joint in tree.joints}
        moved = (*tree.freedoms, *tree.dependent)
        drives = {freedom: drive for freedom, drive in self.drives.items() if freedom in moved}
        loops = {name: joints for name, joints in self.loops.items() if set(joints) <= set(tree.joints)}
        return {"ranges": ranges, "drives": drives, "loops": loops}

    @property
    def known(self) -> np.ndarray:
        """The prior φ (10 b,).

        Raises:
            ModelError: There is none.
        """
        if self.prior is None:
            raise ModelError(f"A mechanism needs mass; {', '.join(self.bodies)} have none (no prior φ).")
        return self.prior

    @typed()
    def site(self, name: str) -> tuple[str, np.ndarray]:
        """Place of a site: the name of a body, and a pose in its frame (4, 4).

        Raises:
            ModelError: There is no such site.
        """
        if name not in self.sites:
            raise ModelError(
                f"The mechanism has no site named '{name}'; its sites are {', '.join(self.sites) or 'none'}."
            )
        return self.sites[name]

    @property
    def mass(self) -> float:
        """Mass of all bodies by the prior, kg."""
        return float(self.known[::10].sum())

    @property
    def weight(self) -> float:
        """Weight of all bodies by the prior, N."""
        return self.mass * float(np.linalg.norm(self.gravity))


def _orientation(rpy_deg: Sequence[float]) -> np.ndarray:
    """Orientation by roll, pitch and yaw in degrees (3, 3)."""
    return np.asarray(Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix())


def checked_gravity(gravity: np.ndarray) -> np.ndarray:
    """Acceleration of gravity as an array (3,), checked to be finite numbers or symbols."""
    g = np.asarray(gravity)
    if g.shape != (3,) or not (g.dtype == object or np.isfinite(g).all()):
        raise ModelError(f"Gravity needs three finite numbers, m/s², got {gravity}.")
    return g


def plane_normal(mechanism: Mechanism) -> np.ndarray | None:
    """Unit normal, in the base frame, of the plane in which a mechanism moves freely (3,); None for other mechanisms.

    All hinges turn about the normal, all slides and gravity are perpendicular to it, and the joints of the only body on
    the base, or those of the carrier, have all three degrees of freedom in the plane.
    """
    carrier = mechanism.carrier
    carrying = mechanism.tree if carrier is None else carrier.tree
    if carrier is not None and len(carrying.root) < len(carrying.bodies):
        return None
    first = np.hstack([np.zeros((6, 0)), *(carrying.screws[i] for i in carrying.root)])
    normal = _common_axis(carrying, first, mechanism.gravity)
    if normal is None or np.linalg.matrix_rank(first, tol=INDEPENDENT) < 3:
        return None
    if carrier is None:
        return normal
    # In the axes of the carrier's last body the normal is constant, as all joints turn about it.
    normal = carrying.generic_poses[-1][:3, :3].T @ normal
    return normal if _in_plane(mechanism.tree, normal) else None


def out_of_plane(mechanism: Mechanism, frame: np.ndarray, *, free: bool = True) -> tuple[int, ...]:
    """Components of a wrench that motion in a plane cannot explain: force along its normal, moments about axes in it.

    Args:
        mechanism: The mechanism.
        frame: Pose of the wrench's frame in the base frame (4, 4).
        free: False to include mechanisms on a resting base, whose bodies beside the plane explain the moments in part.

    Returns:
        Their indices (3), empty if the mechanism does not move in a plane or its normal is no axis of the frame.
    """
    normal = plane_normal(mechanism)
    if normal is None and not free and mechanism.carrier is None:
        normal = _common_axis(mechanism.tree, np.hstack(mechanism.tree.screws), mechanism.gravity)
    if normal is None:
        return ()
    along = np.abs(frame[:3, :3].T @ normal)
    axis = int(np.argmax(along))
    if np.delete(along, axis).max() > INDEPENDENT:
        return ()
    return (axis, *(3 + k for k in range(3) if k != axis))


def _common_axis(tree: Tree, screws: np.ndarray, g: np.ndarray) -> np.ndarray | None:
    """Unit normal of the plane of all joints and gravity g, along the first hinge of screws (6, k): (3,) or None."""
    axes = screws[3:, screws[3:].any(axis=0)]
    if not axes.size:
        return None
    normal = axes[:, 0] / np.linalg.norm(axes[:, 0])
    return normal if _in_plane(tree, normal) and abs(g @ normal) <= INDEPENDENT * np.linalg.norm(g) else None


def _in_plane(tree: Tree, normal: np.ndarray) -> bool:
    """True if all hinges turn about the normal, without a pitch, and all slides are perpendicular to it."""
    screws = np.hstack(tree.screws)
    v, w = screws[:3], screws[3:]
    turns = w.any(axis=0)
    off = [np.abs(np.cross(w[:, turns].T, normal)), np.abs((v * w).sum(axis=0)), np.abs(normal @ v[:, ~turns])]
    return all(x.max(initial=0) <= INDEPENDENT for x in off)
