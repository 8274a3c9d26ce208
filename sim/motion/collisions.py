"""Collisions of a mechanism with itself and its surroundings, and limits of a motion by them and by its loops."""

import copy
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from ident.errors import InputError, ModelError
from ident.mechanism.tree import Tree
from sim.models.notes import body_name, id_of, joint_name, refusals


class _Contacts(NamedTuple):
    """Contacts of a posture.

    Attributes:
        bodies: Ids of the two bodies (k, 2).
        distances: Distances, m (k,).
        places: Positions in the world, m (k, 3).
        normals: Directions from the first body to the second (k, 3).
    """

    bodies: np.ndarray
    distances: np.ndarray
    places: np.ndarray
    normals: np.ndarray


NONE = _Contacts(np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))

ROUND = mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE
"""Kinds of geoms that are points and lines with a radius."""


class Collisions:
    """Contacts that the motion of some joints of a model can change, with all other joints fixed.

    MuJoCo's own filters apply: parents and children do not collide, nor do excluded pairs or geoms whose `contype` and
    `conaffinity` do not match. Here parents include pedestals at rest, which MuJoCo treats as the world. Pairs of
    bodies without a moving joint between them are ignored: their contacts, such as feet on the floor, are permanent.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        tree: Tree,
        clearance: float,
        still: Mapping[str, Sequence[float]] | None = None,
        floor: float | None = None,
    ) -> None:
        """Prepares a copy of the model.

        Args:
            model: The model; other joints stay in its reference configuration, but for those of `still`.
            tree: The tree of hinges and slides whose coordinates are q, with its loops.
            clearance: Distance below which geoms count as touching, m.
            still: Coordinates of some other joints.
            floor: Height in the world's frame of a plane that no moving body may touch, m; None for none.

        Raises:
            ModelError: A joint does not exist, or a ball joint depends on others.
        """
        self._tree = tree
        if balls := {*tree.dependent} - {joint_name(model, j) for j in range(model.njnt)}:
            raise ModelError(
                f"Collisions of bodies on ball joints that loops move, as '{min(balls)[:-2]}', are not computed. "
                "Design the motion with --collisions ignore."
            )
        ids = [id_of(model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in (*tree.joints, *tree.dependent)]
        self._model = copy.deepcopy(model)
        self._model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._data = mujoco.MjData(self._model)
        self._columns, self._freedoms = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        self._body, self._apart = model.geom_bodyid, _apart(model, ids)
        self.clearance, self.floor = clearance, floor
        for joint, q in (still or {}).items():
            first = model.jnt_qposadr[id_of(model, mujoco.mjtObj.mjOBJ_JOINT, joint)]
            self._data.qpos[first : first + len(q)] = q
        # Ids of the geoms that must not touch the floor.
        solid = (model.geom_contype | model.geom_conaffinity) != 0
        self._above_floor = np.flatnonzero(solid & (_carriers(model, ids)[self._body] != 0))

    @property
    def checks_floor(self) -> bool:
        """True if there is a floor, and a geom that could touch it."""
        return self.floor is not None and len(self._above_floor) > 0

    def depth(self, q: np.ndarray, clearance: float | None = None) -> np.ndarray:
        """Clearance less distance, summed over the contacts, m.

        Args:
            q: Positions of the moving joints, rad or m (N, n).
            clearance: Clearance, m, by default that of the object.

        Returns:
            Sums, zero for postures without contact (N,).
        """
        clearance = self.clearance if clearance is None else clearance
        return np.array([np.sum(clearance - self._contacts(each, clearance).distances) for each in self._whole(q)])

    def _whole(self, q: np.ndarray) -> np.ndarray:
        """Positions with those of dependent joints (N, n + d)."""
        return np.hstack([q, *self._tree.dependent_states(q)])

    def barrier_and_slope(self, q: np.ndarray, near: float, far: float) -> tuple[float, np.ndarray]:
        """Barrier `Σ (far - d)²/((d - near) far)` over distances d between geoms, and its derivatives.

        The derivative of a distance is the velocity of the second geom's nearest point relative to the first's, along
        their normal.

        Args:
            q: Positions of the moving joints, rad or m (N, n).
            near: Distance at which it is infinite, m.
            far: Distance from which it is zero, m.

        Returns:
            Barrier and derivatives by the positions (N, n); infinity and zeros if a distance is below `near`.
        """
        barrier, slope = 0.0, np.zeros((len(q), len(self._freedoms)))
        first, second = np.zeros((2, 3, self._model.nv))
        for sample, posture in enumerate(self._whole(q)):
            contacts = self._contacts(posture, far)
            if not len(contacts.bodies):
                continue
            room, depths, bodies = contacts.distances - near, far - contacts.distances, contacts.bodies
            if (room <= 0).any():
                return np.inf, np.zeros(q.shape)
            barrier += float(np.sum(depths**2 / room)) / far
            steep = -(2 * depths * room + depths**2) / (room**2 * far)
            mujoco.mj_comPos(self._model, self._data)
            for factor, (a, b), place, normal in zip(steep, bodies, contacts.places, contacts.normals, strict=True):
                mujoco.mj_jac(self._model, self._data, first, None, place, a)
                mujoco.mj_jac(self._model, self._data, second, None, place, b)
                slope[sample] += factor * (normal @ (second - first))[self._freedoms]
        own, of_loops = np.split(slope, [q.shape[1]], axis=1)
        return barrier, own + np.einsum("nd,ndk->nk", of_loops, self._tree.slopes(q))

    def touching(self, q: np.ndarray) -> dict[tuple[str, str], int]:
        """Pairs of bodies closer than the clearance, each with the first sample at which they are.

        Args:
            q: Positions of the moving joints, rad or m (N, n).
        """
        contacts: dict[tuple[str, str], int] = {}
        for sample in np.flatnonzero(self.depth(q)):
            posture = self._whole(q[[sample]])[0]
            for a, b in np.sort(self._contacts(posture, self.clearance).bodies, axis=1):
                contacts.setdefault((body_name(self._model, a), body_name(self._model, b)), int(sample))
        return contacts

    def _contacts(self, posture: np.ndarray, clearance: float) -> _Contacts:
        """Contacts of a posture below a clearance, without ignored pairs."""
        self._model.geom_margin[:] = clearance
        self._model.pair_margin[:] = clearance
        self._data.qpos[self._columns] = posture
        with refusals("The model"):
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
        contacts = NONE
        if self._data.ncon:
            contact = self._data.contact
            bodies = self._body[contact.geom]
            counts = (contact.dist < clearance) & self._apart[tuple(bodies.T)]
            contacts = _Contacts(*(x[counts] for x in (bodies, contact.dist, contact.pos, contact.frame[:, :3])))
        if self.floor is None:
            return contacts
        return _Contacts(*map(np.concatenate, zip(contacts, self._on_floor(clearance), strict=True)))

    def _on_floor(self, clearance: float) -> _Contacts:
        """Contacts of the geoms of moving bodies with the floor: of spheres and capsules, else of boxes around them."""
        geoms = self._above_floor
        R, boxes = self._data.geom_xmat[geoms].reshape(-1, 3, 3), self._model.geom_aabb[geoms]
        radius = np.where(np.isin(self._model.geom_type[geoms], ROUND), self._model.geom_size[geoms, 0], 0)
        corners = boxes[:, :3] - np.sign(R[:, 2]) * (boxes[:, 3:] - radius[:, None])
        places = self._data.geom_xpos[geoms] + np.einsum("gij,gj->gi", R, corners)
        places[:, 2] -= radius
        distances = places[:, 2] - self.floor
        near = distances < clearance
        bodies = np.stack([np.zeros(near.sum(), int), self._body[geoms[near]]], axis=1)
        return _Contacts(bodies, distances[near], places[near], np.tile([0.0, 0.0, 1.0], (len(bodies), 1)))

    def pairs(self) -> int:
        """Number of pairs of geoms that are checked; zero if the model has no geoms that can collide."""
        model = self._model
        first, second = np.triu_indices(model.ngeom, 1)
        a, b = self._body[first], self._body[second]
        kind, partner = model.geom_contype, model.geom_conaffinity
        match = ((kind[first] & partner[second]) | (kind[second] & partner[first])) != 0
        weld_a, weld_b = model.body_weldid[a], model.body_weldid[b]
        parent = model.body_weldid[model.body_parentid]
        related = (weld_a != 0) & (weld_b != 0) & ((parent[weld_a] == weld_b) | (parent[weld_b] == weld_a))
        if model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT):
            related[:] = False
        excluded = np.isin((np.minimum(a, b) << 16) + np.maximum(a, b), model.exclude_signature)
        declared = self._apart[self._body[model.pair_geom1], self._body[model.pair_geom2]]
        return int(np.sum(match & ~related & ~excluded & self._apart[a, b]) + np.sum(declared))


def _apart(model: mujoco.MjModel, joints: Sequence[int]) -> np.ndarray:
    """Mask of pairs of bodies with a moving joint between them, neither the pedestal of the other (nbody, nbody)."""
    carrier, (pedestal, stands_on) = _carriers(model, joints), _pedestals(model)
    on_pedestal = (pedestal != 0) & (stands_on[:, None] == pedestal)
    return (carrier[:, None] != carrier) & ~on_pedestal & ~on_pedestal.T


def _carriers(model: mujoco.MjModel, joints: Sequence[int]) -> np.ndarray:
    """For every body the nearest one towards the world, itself included, with a moving joint; 0 for none (nbody,)."""
    moved = set(model.jnt_bodyid[list(joints)].tolist())
    carrier = np.zeros(model.nbody, int)
    for b in range(1, model.nbody):
        carrier[b] = b if b in moved else carrier[model.body_parentid[b]]
    return carrier


def _pedestals(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """For every body its own pedestal if it rests, and the pedestal that carries its joint if it moves (nbody,).

    A pedestal is the body on the world that heads a chain of bodies at rest, as an id. The first is 0 for moving
    bodies, the second for bodies at rest and for joints on a moving body or on the world itself.
    """
    pedestal, stands_on = np.zeros(model.nbody, int), np.zeros(model.nbody, int)
    for b in range(1, model.nbody):
        parent, weld = model.body_parentid[b], model.body_weldid[b]
        if weld == 0:
            pedestal[b] = pedestal[parent] or b
        else:
            stands_on[b] = pedestal[model.body_parentid[weld]]
    return pedestal, stands_on


THICK = 1.1
"""Distance of the walls in clearances: more than 1, because bodies come slightly closer between two times."""

FAR = 4.0
"""Distance in clearances below which the barrier is not zero."""


class Walls:
    """Collisions of a motion as a function of its variables x (n, w)."""

    def __init__(self, collisions: Collisions, maps: np.ndarray, middle: np.ndarray, half_range: np.ndarray) -> None:
        """Sets up the walls.

        Args:
            collisions: Collisions to avoid.
            maps: Matrices from the variables of each joint to its positions relative to `middle` at N times (n, N, w);
                the first variable is the mean position in units of `half_range`.
            middle: Positions for x = 0 (n,).
            half_range: Units of the first variables (n,).
        """
        self.collisions, self.maps, self.middle, self.half_range = collisions, maps, middle, half_range

    def hit(self, x: np.ndarray) -> bool:
        """True if bodies come closer than the clearance at one of the times."""
        return bool(self.collisions.depth(self._positions(x)).any())

    def barrier(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """The weighted barrier and its derivatives by the variables (n, w); infinite behind a wall."""
        clearance = self.collisions.clearance
        value, slope = self.collisions.barrier_and_slope(self._positions(x), THICK * clearance, FAR * clearance)
        # Costs are logarithms, beside which the barrier is small.
        each = 0.03 / self.maps.shape[1]
        return each * value, each * np.einsum("gj,jgw->jw", slope, self.maps)

    def shrunk(self, x: np.ndarray) -> np.ndarray | None:
        """The motion shrunk about the best of six of its postures until it avoids all walls (n, w), or None."""
        q, clearance = self._positions(x), self.collisions.clearance
        free = q[self.collisions.depth(q, THICK * clearance) == 0]
        # Postures with the largest distances first, by the depth below `FAR`.
        free = free[np.argsort(self.collisions.depth(free, FAR * clearance), kind="stable")]
        roomy = free[: max(6, len(free) // 2)]
        best, largest = None, 0.0
        for posture in roomy[np.unique(np.linspace(0, len(roomy) - 1, 6).astype(int))] if len(roomy) else ():
            center = np.zeros_like(x)
            center[:, 0] = (posture - self.middle) / self.half_range
            part = self._part(x, center)
            if part > largest:
                best, largest = center + part * (x - center), part
        return best

    def _part(self, x: np.ndarray, center: np.ndarray) -> float:
        """Largest factor of a motion about a posture, by bisection; below one, to be inside all limits too."""
        low, high = 0.0, 0.9
        for _ in range(5):
            part = (low + high) / 2
            q = self._positions(center + part * (x - center))
            touches = self.collisions.depth(q, THICK * self.collisions.clearance).any()
            low, high = (low, part) if touches else (part, high)
        return low

    def _positions(self, x: np.ndarray) -> np.ndarray:
        return np.asarray((self.maps @ x[:, :, None])[..., 0].T) + self.middle


SHARES = np.linspace(1, 0.05, 20)
"""Shares of a given range that are tried on either side of the rest position."""


def reachable(
    tree: Tree, ranges: Mapping[str, tuple[float, float]], rest: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The largest part of given ranges about a posture in which all loops close, lower and upper limits (n,).

    Args:
        tree: The tree with its closed loops, of hinges and slides.
        ranges: Limits of joints by name, of which those of the dependent ones count.
        rest: Coordinates of the posture (n,), from which ranges are shrunk on either side.
        low: Given lower limits (n,).
        high: Given upper limits (n,).

    Raises:
        InputError: Loops do not close even close to the posture.
    """
    n, rng = len(low), np.random.default_rng(0)
    center = np.clip(rest, low, high)
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * min(n, 6)), -1).reshape(-1, min(n, 6))
    # Most ranges that are too large fail in a corner. Random postures besides find what fails in more than one
    # of a hundred.
    units = np.pad(corners, ((0, 0), (0, n - corners.shape[1])), mode="edge"), rng.random((200, n))
    limits = np.array([ranges.get(joint, (-np.inf, np.inf)) for joint in tree.dependent])
    # A little of a dependent joint's range stays free at each stop.
    room = np.where(np.isfinite(limits).all(axis=1), 0.02 * (limits[:, 1] - limits[:, 0]), 0)

    def holds(shares: np.ndarray) -> bool:
        first, last = center + shares[0] * (low - center), center + shares[1] * (high - center)
        return all(fits(first + some * (last - first)) for some in units)

    def fits(q: np.ndarray) -> bool:
        y = tree.dependent_states(q)[0]
        return bool(((y >= limits[:, 0] + room) & (y <= limits[:, 1] - room)).all() and tree.closes(q).all())

    shares = np.zeros((2, n))
    # Both sides of all joints together, and then each as far as the others allow.
    for some in (np.s_[:, :], *np.ndindex(2, n)):
        for share in SHARES:
            wider = shares.copy()
            wider[some] = share
            if holds(wider):
                shares = wider
                break
        if not shares.any():
            raise InputError(
                f"The loops of {', '.join(tree.dependent)} do not close, or leave these joints' ranges, near the rest "
                "position. Give a smaller range with --position, or correct the model's posture."
            )
    return center + shares[0] * (low - center), center + shares[1] * (high - center)
