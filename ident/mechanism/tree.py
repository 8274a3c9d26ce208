"""A mechanism as in Table II: for every body its home pose and the twist of its joint."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from ident.annotations import typed
from ident.errors import InputError, ModelError
from ident.geometry import se3
from ident.geometry.inertia import parameter_transform
from ident.mechanism.body import BASE, Body, Follower
from ident.mechanism.closure import Closure
from ident.tolerances import HUGE


@typed()
@dataclass(frozen=True)
class Tree:
    """A tree of bodies on a base frame {0}; parents come before their children.

    Attributes:
        bodies: The bodies, b of them with a φ. The joints of the moving ones, in this order, make up q and q̇. Only
            ball joints have more coordinates than velocities; followers and dependent joints have neither.
        closure: The loops that make some joints dependent, None without.
    """

    bodies: tuple[Body, ...]
    closure: Closure | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", tuple(self.bodies))
        if not self.bodies:
            raise ModelError("A tree needs at least one body.")
        joints = [body.joint for body in self.bodies if body.joint]
        for what, names in (("body", list(self.names)), ("joint", joints)):
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise ModelError(f"A tree needs a name of its own for every {what}; '{twice}' occurs twice.")
        turns = {name: body.joint for body in self.bodies if body.is_ball for name in body.freedom_names}
        if alike := [joint for joint in joints if joint in turns]:
            raise ModelError(
                f"The ball joint '{turns[alike[0]]}' has a rotation '{alike[0]}', and another joint has that name; "
                "rename one of the two joints."
            )
        for i, body in enumerate(self.bodies):
            if not isinstance(body.parent, int | np.integer) or not BASE <= body.parent < i:
                raise ModelError(
                    f"Body '{body.name}' (index {i}) needs a parent index from {BASE} to {i - 1}, got {body.parent}."
                )
        if self.closure is None and (loose := [body.depends for body in self.bodies if body.depends]):
            raise ModelError(f"This needs all joints, but loops make '{loose[0]}' dependent. Log its position.")
        single = {body.joint or body.depends for body in self.bodies if body.coordinates == 1 or body.depends}
        for i, lead in self.followers.items():
            if lead.joint not in single:
                raise ModelError(
                    f"Body '{self.names[i]}' follows '{lead.joint}', which is no joint with one coordinate of its "
                    f"tree; those are {', '.join(sorted(single)) or 'none'}."
                )

    @classmethod
    def from_home_poses(cls, names: Sequence[str], T_0i: np.ndarray, xi: np.ndarray) -> "Tree":
        """Serial chain from a table like Table II, with joints named like their bodies.

        Args:
            names: Names of the b bodies.
            T_0i: Home pose of each body in the base frame (b, 4, 4).
            xi: Joint twist of each body in the body's own frame, zeros for a welded one (b, 6).
        """
        homes = [T_0i[0], *(se3.inverse(T) @ following for T, following in pairwise(T_0i))]
        rows = enumerate(zip(names, homes, xi, strict=True), start=BASE)
        return cls(tuple(Body(name, p, T, twist, name if np.any(twist) else "") for p, (name, T, twist) in rows))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(body.name for body in self.bodies)

    @cached_property
    def moving(self) -> tuple[int, ...]:
        """Indices of the bodies whose joint has coordinates of its own."""
        return tuple(i for i, body in enumerate(self.bodies) if body.coordinates)

    @cached_property
    def moved(self) -> frozenset[int]:
        """Indices of the bodies that do not rest in the base: those that joints move, and what these carry."""
        return frozenset(k for i, body in enumerate(self.bodies) if body.moves for k in self.carried(i))

    @cached_property
    def inertial(self) -> tuple[int, ...]:
        """Indices of the b bodies with a φ, in the order of the regressor's columns."""
        return tuple(i for i, body in enumerate(self.bodies) if not body.massless)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of q."""
        return tuple(self.bodies[i].joint for i in self.moving)

    @property
    def still(self) -> tuple[str, ...]:
        """Names of the joints that were fixed."""
        return tuple(body.still for body in self.bodies if body.still)

    @cached_property
    def freedoms(self) -> tuple[str, ...]:
        """Names of the n entries of q̇: the joints', with `.x`, `.y` and `.z` for a ball."""
        return tuple(name for body in self.bodies for name in body.freedom_names)

    def owners(self, what: str) -> np.ndarray:
        """Name of the joint of each of the `coordinates` or `freedoms`."""
        return np.repeat(self.joints, [getattr(self.bodies[i], what) for i in self.moving])

    @property
    def carriers(self) -> dict[str, str]:
        """Names of bodies by those of the freedoms that move them."""
        return {name: body.name for body in self.bodies for name in body.freedom_names}

    @cached_property
    def followers(self) -> dict[int, Follower]:
        """Functions of the bodies whose joint follows another one, by index."""
        return {i: body.follows for i, body in enumerate(self.bodies) if body.follows}

    @property
    def dependent(self) -> tuple[str, ...]:
        """Names of the joints that loops make dependent."""
        return self.closure.dependent if self.closure else ()

    @cached_property
    def size(self) -> int:
        """Number of coordinates n_q."""
        return sum(body.coordinates for body in self.bodies)

    @cached_property
    def floats(self) -> bool:
        """True if the only body on the base has joints with all six degrees of freedom."""
        screws = np.hstack([np.zeros((6, 0)), *(self.screws[i][:, : self.bodies[i].freedoms] for i in self.root)])
        return screws.shape[1] >= 6 and bool(np.linalg.matrix_rank(screws.astype(float)) == 6)

    @cached_property
    def root(self) -> tuple[int, ...]:
        """Indices of the massless links to the only body on the base, and of that body; empty if there are several."""
        chain, parent = list[int](), BASE
        while not chain or self.bodies[parent].massless:
            on_it = [i for i, body in enumerate(self.bodies) if body.parent == parent]
            if len(on_it) != 1:
                return ()
            chain, parent = chain + on_it, on_it[0]
        return tuple(chain)

    @cached_property
    def generic_poses(self) -> np.ndarray:
        """Poses of the bodies in a generic posture, in which no axes are parallel by chance (b, 4, 4)."""
        return self.poses(np.linspace(0.3, 0.9, self.size))

    @cached_property
    def screws(self) -> tuple[np.ndarray, ...]:
        """Motion subspaces of the joints in the generic posture, in the base frame, each (6, 0), (6, 1) or (6, 3)."""
        return tuple(se3.Ad(T) @ body.motions for T, body in zip(self.generic_poses, self.bodies, strict=True))

    def chain(self, i: int) -> tuple[int, ...]:
        """Indices of the bodies from the base to body i; none for the base itself."""
        return () if i == BASE else (*self.chain(self.bodies[i].parent), i)

    @cached_property
    def compounds(self) -> dict[str, tuple[int, ...]]:
        """Indices of the bodies of each joint that carries something, massless links first, by its first joint.

        Several joints between two bodies with mass are one compound joint. One that only follows has its leader's name,
        unless that is another.
        """
        members = defaultdict[int, list[int]](list)
        for i in range(len(self.bodies)):
            members[self.first_link(i)].append(i)
        out = dict[str, tuple[int, ...]]()
        for own in (each for first, each in members.items() if set(self.carried(first)) & {*self.inertial}):
            names = [self.bodies[i].joint for i in own]
            leaders = [self.followers[i].joint for i in own if i in self.followers]
            if name := next(filter(None, [*names, *leaders]), ""):
                out.setdefault(name, tuple(own))
        return out

    def first_link(self, i: int) -> int:
        """Index of the first of the massless links that precede body i; that of the body itself without any."""
        parent = self.bodies[i].parent
        return self.first_link(parent) if parent != BASE and self.bodies[parent].massless else i

    def part(self, members: Sequence[int]) -> tuple[Body, ...]:
        """Some of the bodies, in the given order, on the base where their parents are none of them."""
        places = {i: k for k, i in enumerate(members)}
        return tuple(replace(self.bodies[i], parent=places.get(self.bodies[i].parent, BASE)) for i in members)

    def beyond(self, i: int) -> "Tree":
        """The tree of body i, whose frame is {0}, and of all bodies on it."""
        root, *others = self.part(self.carried(i))
        return Tree((replace(root, home=np.eye(4), twist=np.zeros(6), joint="", follows=None), *others))

    def closed(self, closure: Closure) -> "Tree":
        """The tree with the joints dependent that loops determine; they lose their names."""
        bodies = (replace(x, joint="", depends=x.joint) if x.joint in closure.dependent else x for x in self.bodies)
        return Tree(tuple(bodies), closure)

    def started(self, q: np.ndarray) -> np.ndarray:
        """Joint coordinates (…, n_q), and those of the dependent joints by iteration (…, n_q + d).

        Recorded equations start from these; other functions of q take either.
        """
        if self.closure is None or np.shape(q)[-1] != self.size:
            return q
        return np.concatenate([q, self.closure.solved(np.asarray(q)[..., self.of_loops[0]])], axis=-1)

    def closes(self, q: np.ndarray) -> np.ndarray:
        """True for joint coordinates (N, n_q) in which the loops can be closed and are not singular (N,)."""
        return self.closure.closes(np.asarray(q)[..., self.of_loops[0]]) if self.closure else np.ones(len(q), bool)

    @cached_property
    def of_loops(self) -> tuple[np.ndarray, ...]:
        """Indices of the loops' independent joints among the coordinates and the velocities."""
        if self.closure and not self.size:
            raise self.closure.rigid()
        independent = self.closure.independent if self.closure else ()
        return tuple(np.flatnonzero(np.isin(self.owners(what), independent)) for what in ("coordinates", "freedoms"))

    def carried(self, i: int) -> tuple[int, ...]:
        """Indices of body i and of all its descendants."""
        members = {i}
        for k in range(i + 1, len(self.bodies)):
            if self.bodies[k].parent in members:
                members.add(k)
        return tuple(sorted(members))

    def with_twists(self, twists: np.ndarray) -> "Tree":
        """The tree with other joint twists, in the bodies' own frames (n, 6)."""
        bodies = list(self.bodies)
        for i, twist in zip(self.moving, twists, strict=True):
            if not np.any(twist):
                raise ModelError(f"Joint '{bodies[i].joint}' needs a twist that moves, got zeros.")
            bodies[i] = replace(bodies[i], twist=twist)
        return Tree(tuple(bodies))

    @typed()
    def fixed(self, coordinates: Mapping[str, Sequence[float] | np.ndarray]) -> "Tree":
        """The tree with some joints welded at given coordinates.

        Args:
            coordinates: Coordinates of these joints by their names, rad, m or a quaternion, each (1,) or (4,).

        Raises:
            ModelError: There is no such joint.
            InputError: It has another number of coordinates.
        """
        if unknown := [joint for joint in coordinates if joint not in self.joints]:
            raise ModelError(f"There is no joint '{unknown[0]}' to fix; the joints are {', '.join(self.joints)}.")
        bodies = list(self.bodies)
        for i in self.moving:
            body = bodies[i]
            if body.joint in coordinates:
                q = np.asarray(coordinates[body.joint], float)
                if q.shape != (body.coordinates,) or not (np.abs(q) < HUGE).all() or (body.is_ball and not q.any()):
                    needed = f"{body.coordinates} coordinates below {HUGE:g}"
                    raise InputError(f"Joint '{body.joint}' is fixed at {needed}, got {q.tolist()}.")
                bodies[i] = _welded(body, q)
        for i, lead in self.followers.items():
            if lead.joint in coordinates:
                bodies[i] = _welded(bodies[i], lead.value(np.asarray(coordinates[lead.joint], float)))
        return Tree(tuple(bodies))

    def without_welds(self) -> tuple["Tree", np.ndarray]:
        """The mechanism with welded bodies merged into their parents.

        Returns:
            The tree, and the matrix X that merges parameters: `φ_merged = X φ`.
        """
        bodies: list[Body] = []
        # By old index: index of the merged body, and the pose of the old one in its frame.
        place = {BASE: (BASE, np.eye(4))}
        for i, body in enumerate(self.bodies):
            carrier, T = place[body.parent]
            if body.moves or carrier == BASE:
                bodies.append(replace(body, parent=carrier, home=T @ body.home))
                place[i] = len(bodies) - 1, np.eye(4)
                if not body.moves:
                    place[BASE] = len(bodies) - 1, se3.inverse(body.home)
            else:
                place[i] = carrier, T @ body.home
                bodies[carrier] = replace(bodies[carrier], massless=bodies[carrier].massless and body.massless)
        tree = Tree(tuple(bodies))
        X = np.zeros((10 * len(tree.inertial), 10 * len(self.inertial)))
        for k, i in enumerate(self.inertial):
            carrier, T = place[i]
            row = 10 * tree.inertial.index(carrier)
            X[row : row + 10, 10 * k : 10 * k + 10] = parameter_transform(T)
        return tree, X

    def body_coordinates(self, q: np.ndarray) -> list[np.ndarray]:
        """Joint coordinates (…, n_q) by body: each (…, 0), (…, 1) or (…, 4), followers (…, 0)."""
        own = np.asarray(q)[..., : self.size] if self.closure and np.shape(q)[-1:] != (self.size,) else q
        return self._dealt("coordinates", own, [body.coordinates for body in self.bodies])

    def freedom_coordinates(self, q: np.ndarray) -> np.ndarray:
        """Coordinates of hinges and slides by freedom, zero for those of balls (…, n), from all of them (…, n_q)."""
        own = zip(self.bodies, self.body_coordinates(q), strict=True)
        each = [0 * x[..., 1:] if body.is_ball else x[..., : body.freedoms] for body, x in own]
        return np.concatenate([q[..., :0], *each], axis=-1)

    def body_velocities(self, dq: np.ndarray) -> list[np.ndarray]:
        """Joint velocities or accelerations (…, n) by body: each (…, 0), (…, 1) or (…, 3)."""
        return self._dealt("velocities", dq, [body.freedoms for body in self.bodies])

    def body_states(self, q: np.ndarray, *rates: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        """Joint states by body, including the dependent states of followers.

        Args:
            q: Joint coordinates (…, n_q).
            rates: Velocities, or velocities and accelerations (…, n).

        Returns:
            Coordinates and rates of every body's joint.
        """
        dealt = list(zip(self.body_coordinates(q), *map(self.body_velocities, rates), strict=True))
        closed = self.dependent_states(q, *rates)
        leaders = {joint: tuple(x[..., k : k + 1] for x in closed) for k, joint in enumerate(self.dependent)}
        dealt = [leaders.get(body.depends, own) for body, own in zip(self.bodies, dealt, strict=True)]
        leaders |= {self.bodies[i].joint: dealt[i] for i in self.moving}
        for i, lead in self.followers.items():
            dealt[i] = lead.states(*leaders[lead.joint])
        return dealt

    def joint_sums(self, q: np.ndarray, felt: Sequence[np.ndarray]) -> np.ndarray:
        """Generalized forces of the n freedoms from those of the bodies' joints.

        A follower adds f'(q) τ to its leader, dependent joints add Gᵀ τ to the independent ones.

        Args:
            q: Joint coordinates (…, n_q), of one sample if there are loops, also with those of dependent joints.
            felt: Torques of each body's joint along its axes, or their rows, (0, …), (1, …) or (3, …).

        Returns:
            Joint torques, or their rows (n, …).
        """
        own = list(felt)
        places = {body.joint or body.depends: i for i, body in enumerate(self.bodies) if self.followers or self.closure}
        states = self.body_states(q) if self.followers else []
        for i, lead in self.followers.items():
            k = places[lead.joint]
            own[k] = own[k] + lead.slope(states[k][0]) * felt[i]
        felt = [x for x, body in zip(own, self.bodies, strict=True) if not body.follows and not body.depends]
        if not self.closure:
            return np.concatenate(felt)
        return np.concatenate(felt) + self.slopes(q).T @ np.concatenate([own[places[name]] for name in self.dependent])

    def slopes(self, q: np.ndarray) -> np.ndarray:
        """Derivatives G of the dependent joints' coordinates by the n freedoms (…, d, n), for q as by `started`."""
        if not self.closure:
            return np.zeros((*np.shape(q)[:-1], 0, len(self.freedoms)))
        G = self.closure.slopes(np.asarray(q)[..., self.of_loops[0]], self.started(q)[..., self.size :])
        out = np.zeros((*G.shape[:-1], len(self.freedoms)), G.dtype)
        out[..., self.of_loops[1]] = G
        return out

    @cached_property
    def slopes_in_posture(self) -> np.ndarray:
        """Derivatives as by `slopes` in the posture in which the loops were first closed (d, n)."""
        q = np.zeros(self.size)
        if self.closure:
            q[self.of_loops[0]] = self.closure.anchors[0, self.closure.coordinates[0]]
        return self.slopes(q)

    def dependent_states(self, q: np.ndarray, *rates: np.ndarray) -> list[np.ndarray]:
        """Coordinates and rates of the dependent joints, each (…, d)."""
        if not self.closure:
            return [np.asarray(x)[..., :0] for x in (q, *rates)]
        x, *own = (np.asarray(values)[..., self.of_loops[k > 0]] for k, values in enumerate((q, *rates)))
        return self.closure.completed(x, self.started(q)[..., self.size :], *own)

    def _dealt(self, what: str, values: np.ndarray, sizes: Sequence[int]) -> list[np.ndarray]:
        values = np.asarray(values)
        if values.shape[-1:] != (sum(sizes),):
            raise InputError(
                f"Joint {what} need {sum(sizes)} columns ({', '.join(self.joints)}), got shape {values.shape}."
            )
        return [values[..., end - size : end] for end, size in zip(accumulate(sizes), sizes, strict=True)]

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Pose of every body in the base frame (Eq. 7).

        Args:
            q: Joint coordinates in rad, m or quaternions (…, n_q).

        Returns:
            T_0i of all bodies, massless ones included (…, bodies, 4, 4).
        """
        poses: list[np.ndarray] = []
        for body, (own,) in zip(self.bodies, self.body_states(q), strict=True):
            T = body.home @ body.joint_pose(own) if body.moves else body.home
            poses.append(T if body.parent == BASE else poses[body.parent] @ T)
        return np.stack([np.broadcast_to(T, (*np.shape(q)[:-1], 4, 4)) for T in poses], -3)


def _welded(body: Body, q: np.ndarray) -> Body:
    """The body with its joint welded at given coordinates."""
    home = body.home @ body.joint_pose(q)
    return replace(body, home=home, twist=np.zeros(6), joint="", follows=None, still=body.joint)
