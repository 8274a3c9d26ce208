"""A mechanism as Table II writes it: for every body its home pose and the twist of the joint that carries it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident import se3

BASE = -1
"""Parent of a body that hangs on the base frame {0}."""


@dataclass(frozen=True, eq=False)
class Body:
    """One rigid body and the joint that connects it to its parent.

    Arrays of numbers are checked; arrays of symbols (dtype object) are taken as they are.

    Attributes:
        name: Name of the body.
        parent: Index of the parent body in the tree, smaller than the body's own, or `BASE`.
        home: Pose of the body in its parent's frame at joint coordinate zero (4, 4).
        twist: Joint twist `[v; ω]` in the body's own frame (6,): |ω| = 1 revolute, ω = 0 and |v| = 1 prismatic, all
            zero for a body that is welded to its parent. `ball_twist` for a ball joint (6, 3).
        joint: Name of the joint, empty for a welded body.
        massless: Whether the body is a mere link between two joints, without φ. Several joints on one body, or a free
            joint, are chains of such links.
    """

    name: str
    parent: int
    home: np.ndarray
    twist: np.ndarray
    joint: str = ""
    massless: bool = False

    def __post_init__(self) -> None:
        for key in ("home", "twist"):
            x = np.array(getattr(self, key))
            x = x if x.dtype == object else x.astype(float)
            x.flags.writeable = False
            object.__setattr__(self, key, x)
        if self.home.shape != (4, 4) or not (self.home.dtype == object or is_rigid(self.home)):
            raise ValueError(f"Body '{self.name}' needs a 4×4 rigid home pose, got {self.home}.")
        if not (self.twist.dtype == object or _is_joint_twist(self.twist)):
            raise ValueError(
                f"Body '{self.name}' needs a joint twist of 6 numbers with |ω| = 1, or ω = 0 and |v| = 1, "
                f"or all zero, or a ball joint's 6×3; got {self.twist}."
            )

    @property
    def moves(self) -> bool:
        """Whether a joint lies between the body and its parent."""
        return bool(np.any(self.twist != 0))

    @property
    def is_ball(self) -> bool:
        """Whether the joint is a ball."""
        return self.twist.ndim == 2

    @property
    def motions(self) -> np.ndarray:
        """Motion subspace of the joint: its twist is `motions @ q̇` in the body's frame (6, 0), (6, 1) or (6, 3)."""
        return self.twist.reshape(6, -1)[:, : None if self.moves else 0]

    @property
    def coordinates(self) -> int:
        """Entries of q that belong to the joint: 1, or 4 for the quaternion `w, x, y, z` of a ball."""
        return 4 if self.is_ball else self.motions.shape[1]

    def joint_pose(self, q: np.ndarray) -> np.ndarray:
        """How far the joint has moved the body from home, `exp(ξ̂ q)` for one axis.

        Args:
            q: The joint's coordinates, rad, m or a quaternion of any length (…, 0), (…, 1) or (…, 4).

        Returns:
            Poses (…, 4, 4).
        """
        if not self.is_ball:
            return se3.exp(self.twist, q[..., 0] if self.moves else np.zeros(q.shape[:-1]))
        center = np.array([self.twist[2, 1], self.twist[0, 2], self.twist[1, 0]])
        R = se3.rotation(q)
        return se3.pose(R, center - R @ center)


def ball_twist(center: np.ndarray) -> np.ndarray:
    """Twist of a ball joint: rotations about the body's own x, y and z through one center.

    Its coordinates are a quaternion `w, x, y, z`, that of the body relative to its home; its velocities the angular
    velocity in the body's frame, rad/s, as in MuJoCo and Pinocchio.

    Args:
        center: Center of the joint in the body's frame, m (3,).

    Returns:
        `[ĉ; 1]` (6, 3).
    """
    return np.vstack([se3.hat(center), np.eye(3, dtype=int)])


def free_joint(name: str, body: str, parent: int, index: int) -> tuple[Body, ...]:
    """A body that moves freely, as three slides along the parent's axes and a ball.

    Coordinates are the position in the parent's frame and a quaternion, velocities the linear velocity in the parent's
    and the angular velocity in the body's frame, as in MuJoCo.

    Args:
        name: Name of the joint.
        body: Name of the body.
        parent: Index of its parent.
        index: Index that the first of the four bodies will have in its tree.

    Returns:
        Three massless links and the body.
    """
    links = [
        Body(f"{body}:{axis}", parent if k == 0 else index + k - 1, np.eye(4), np.eye(6)[k], f"{name}:{axis}", True)
        for k, axis in enumerate("xyz")
    ]
    return (*links, Body(body, index + 2, np.eye(4), ball_twist(np.zeros(3)), name))


@dataclass(frozen=True, eq=False)
class Tree:
    """A tree of bodies on a base frame {0}; parents come before their children.

    Attributes:
        bodies: The bodies, b of them with a φ. The joints of the moving ones, in this order, make the vectors q and q̇;
            only ball joints have more coordinates than velocities.
    """

    bodies: tuple[Body, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", tuple(self.bodies))
        for i, body in enumerate(self.bodies):
            if not BASE <= body.parent < i:
                raise ValueError(
                    f"Body '{body.name}' (index {i}) needs a parent index from {BASE} to {i - 1}, got {body.parent}."
                )

    @classmethod
    def from_home_poses(
        cls,
        names: Sequence[str],
        T_0i: np.ndarray,
        xi: np.ndarray,
        parents: Sequence[int] | None = None,
    ) -> "Tree":
        """The mechanism of a table like Table II.

        Args:
            names: Names of the b bodies.
            T_0i: Home pose of each body in the base frame (b, 4, 4).
            xi: Joint twist of each body in the body's own frame, zeros for a welded one (b, 6).
            parents: Index of each body's parent; without it a serial chain.

        Returns:
            The tree.
        """
        T_0i = np.asarray(T_0i)
        parents = range(BASE, len(names) - 1) if parents is None else parents
        home = [T if p == BASE else se3.inverse(T_0i[p]) @ T for p, T in zip(parents, T_0i, strict=True)]
        rows = zip(names, parents, home, xi, strict=True)
        return cls(tuple(Body(name, p, T, twist, name if np.any(twist) else "") for name, p, T, twist in rows))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies."""
        return tuple(body.name for body in self.bodies)

    @property
    def moving(self) -> tuple[int, ...]:
        """Indices of the bodies that a joint moves."""
        return tuple(i for i, body in enumerate(self.bodies) if body.moves)

    @property
    def inertial(self) -> tuple[int, ...]:
        """Indices of the b bodies with a φ, in the order of the regressor's columns."""
        return tuple(i for i, body in enumerate(self.bodies) if not body.massless)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of q."""
        return tuple(self.bodies[i].joint for i in self.moving)

    @property
    def freedoms(self) -> tuple[str, ...]:
        """Names of the n entries of q̇: the joints', with `.x`, `.y` and `.z` for a ball."""
        suffixes = {0: (), 1: ("",), 3: (".x", ".y", ".z")}
        return tuple(body.joint + suffix for body in self.bodies for suffix in suffixes[body.motions.shape[1]])

    def carried(self, i: int) -> tuple[int, ...]:
        """Indices of body i and of all bodies on it."""
        members = {i}
        for k in range(i + 1, len(self.bodies)):
            if self.bodies[k].parent in members:
                members.add(k)
        return tuple(sorted(members))

    def with_twists(self, twists: np.ndarray) -> "Tree":
        """The same tree with other joint twists, in the bodies' own frames (n, 6)."""
        bodies = list(self.bodies)
        for i, twist in zip(self.moving, twists, strict=True):
            if not np.any(twist):
                raise ValueError(f"Joint '{bodies[i].joint}' needs a twist that moves, got zeros.")
            bodies[i] = replace(bodies[i], twist=twist)
        return Tree(tuple(bodies))

    def body_coordinates(self, q: np.ndarray) -> list[np.ndarray]:
        """Joint coordinates (…, n_q) dealt out to the bodies: (…, 0), (…, 1) or (…, 4) each."""
        return self._dealt("coordinates", q, [body.coordinates for body in self.bodies])

    def body_velocities(self, dq: np.ndarray) -> list[np.ndarray]:
        """Joint velocities or accelerations (…, n) dealt out to the bodies: (…, 0), (…, 1) or (…, 3) each."""
        return self._dealt("velocities", dq, [body.motions.shape[1] for body in self.bodies])

    def _dealt(self, what: str, values: np.ndarray, sizes: Sequence[int]) -> list[np.ndarray]:
        values = np.asarray(values)
        if values.shape[-1:] != (sum(sizes),):
            raise ValueError(
                f"Joint {what} need {sum(sizes)} columns ({', '.join(self.joints)}), got shape {values.shape}."
            )
        ends = np.cumsum(sizes)
        return [values[..., end - size : end] for end, size in zip(ends, sizes, strict=True)]

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Pose of every body in the base frame (Eq. 7).

        Args:
            q: Joint coordinates in rad, m or quaternions (…, n_q).

        Returns:
            T_0i of all bodies, massless ones included (…, bodies, 4, 4).
        """
        poses: list[np.ndarray] = []
        for body, own in zip(self.bodies, self.body_coordinates(q), strict=True):
            T = body.home @ body.joint_pose(own)
            poses.append(T if body.parent == BASE else poses[body.parent] @ T)
        return np.stack(poses, -3)


@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of a base frame {0} that does not rest: one sample, or one for each.

    Attributes:
        T: Pose of {0} in an inertial frame (…, 4, 4).
        V: Its body twist `[v; ω]` in the axes of {0} (…, 6).
        dV: Rate of the components of V (…, 6); `v̇` is the acceleration of the origin less `ω × v`.
    """

    T: np.ndarray
    V: np.ndarray
    dV: np.ndarray

    def __post_init__(self) -> None:
        for key, shape in (("T", (4, 4)), ("V", (6,)), ("dV", (6,))):
            object.__setattr__(self, key, np.asarray(getattr(self, key)))
            x = getattr(self, key)
            if x.shape != (*self.T.shape[:-2], *shape) or not (x.dtype == object or np.isfinite(x).all()):
                raise ValueError(
                    f"The motion of a base needs finite T (N, 4, 4), V (N, 6) and dV (N, 6), got {key} {x.shape}."
                )
        if self.T.dtype != object and not is_rigid(self.T):
            raise ValueError("The motion of a base needs rigid poses T.")

    @classmethod
    def from_free_joint(cls, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> "BaseMotion":
        """From the coordinates of a free joint as `free_joint` and MuJoCo have them.

        Args:
            q: Position and quaternion (…, 7).
            dq: Linear velocity in the inertial frame, angular velocity in the body's (…, 6).
            ddq: Their rates (…, 6).
        """
        q, dq, ddq = np.asarray(q), np.asarray(dq), np.asarray(ddq)
        R = se3.rotation(q[..., 3:])
        to_body = np.swapaxes(R, -1, -2)
        v, a = (np.squeeze(to_body @ x[..., :3, None], -1) for x in (dq, ddq))
        V = np.concatenate([v, dq[..., 3:]], axis=-1)
        return cls(se3.pose(R, q[..., :3]), V, np.concatenate([a - np.cross(dq[..., 3:], v), ddq[..., 3:]], axis=-1))


def is_rigid(T: np.ndarray) -> bool:
    """Whether 4×4 matrices (…, 4, 4) are poses, to rounding."""
    if not np.isfinite(T).all():
        return False
    upright = np.array_equal(np.broadcast_to([0, 0, 0, 1], T[..., 3, :].shape), T[..., 3, :])
    turned = np.allclose(T[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2), np.eye(3), atol=1e-9)
    return bool(upright and turned and (np.linalg.det(T[..., :3, :3]) > 0).all())


def _is_joint_twist(twist: np.ndarray) -> bool:
    """Whether numbers are the twist of a weld, of one axis, or of a ball."""
    if not np.isfinite(twist).all():
        return False
    if twist.shape == (6, 3):
        return bool(np.array_equal(twist[3:], np.eye(3)) and np.array_equal(twist[:3], -twist[:3].T))
    unit = np.linalg.norm(twist[3:]) or np.linalg.norm(twist[:3])
    return twist.shape == (6,) and bool(unit == 0 or abs(unit - 1) <= 1e-9)
