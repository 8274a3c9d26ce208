"""A mechanism with its prior knowledge, before anything is measured."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.annotations import typed
from ident.arguments import OF_BODIES, checked_deviations
from ident.display.brief import Brief, listed
from ident.errors import InputError, ModelError
from ident.mechanism.carrier import Carrier, divided
from ident.mechanism.drives import NO_DRIVE, Drive, checked_drives
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
        object.__setattr__(self, "drives", checked_drives(self.drives, self.tree.freedoms))

    @property
    def _in_short(self) -> dict[str, object]:
        mass = None if self.prior is None else f"{self.prior[::10].sum():.4g} kg in {len(self.bodies)} bodies"
        return {
            "bodies": listed(self.bodies),
            "joints": listed(self.tree.joints),
            "mass": mass or "none, no prior",
            "gravity": f"{listed(f'{x:.4g}' for x in self.gravity)} m/s²",
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
        """Coordinates of the freedoms at which their springs are at rest, rad or m (n,); zero without a drive."""
        return np.array([self.drives.get(freedom, NO_DRIVE).springref for freedom in self.tree.freedoms])

    @typed()
    def beyond(self, body: str) -> "Mechanism":
        """A body and all bodies on it as a mechanism, with the joints before it as carrier; the source is not kept.

        Raises:
            InputError: There is no such body, no joint moves it, or this mechanism has a carrier itself.
        """
        if self.carrier:
            raise InputError(f"The part beyond '{body}' is taken from the whole mechanism, not from a part of it.")
        carrier, tree, members = divided(self.tree, body)
        rows = [self.tree.inertial.index(i) for i in members if i in self.tree.inertial]
        prior = None if self.prior is None else self.prior.reshape(-1, 10)[rows].ravel()
        sites = {name: place for name, place in self.sites.items() if place[0] in tree.names}
        part = Mechanism(tree, self.gravity, prior, sites, **self._of_joints(tree), carrier=carrier)
        known = {name: each for name, each in self.prior_known.items() if name in part.bodies}
        return replace(part, prior_known=known)

    @typed()
    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray]) -> "Mechanism":
        """The mechanism with some joints welded at given coordinates, as by `Tree.fixed`; they lose their drives."""
        tree = self.tree.fixed(coordinates)
        return replace(self, tree=tree, **self._of_joints(tree))

    def _of_joints(self, tree: Tree) -> dict[str, Any]:
        """Ranges and drives of the joints that a tree has."""
        ranges = {joint: limits for joint, limits in self.ranges.items() if joint in tree.joints}
        return {"ranges": ranges, "drives": {k: drive for k, drive in self.drives.items() if k in tree.freedoms}}

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


def checked_gravity(gravity: np.ndarray) -> np.ndarray:
    """Acceleration of gravity as an array (3,), checked to be finite numbers or symbols."""
    g = np.asarray(gravity)
    if g.shape != (3,) or not (g.dtype == object or np.isfinite(g).all()):
        raise ModelError(f"Gravity needs three finite numbers, m/s², got {gravity}.")
    return g
