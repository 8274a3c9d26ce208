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

    Attributes:
        name: Name of the body.
        parent: Index of the parent body in the tree, smaller than the body's own, or `BASE`.
        home: Pose of the body in its parent's frame at joint coordinate zero (4, 4).
        twist: Joint twist `[v; ω]` in the body's own frame (6,): |ω| = 1 revolute, ω = 0 and |v| = 1 prismatic, all
            zero for a body that is welded to its parent.
        joint: Name of the joint, empty for a welded body.
    """

    name: str
    parent: int
    home: np.ndarray
    twist: np.ndarray
    joint: str = ""

    def __post_init__(self) -> None:
        home, twist = np.array(self.home, float), np.array(self.twist, float)
        if home.shape != (4, 4) or not is_rigid(home):
            raise ValueError(f"Body '{self.name}' needs a 4×4 rigid home pose, got {self.home}.")
        unit = np.linalg.norm(twist[3:]) or np.linalg.norm(twist[:3])
        if twist.shape != (6,) or not np.isfinite(twist).all() or not (unit == 0 or abs(unit - 1) <= 1e-9):
            raise ValueError(
                f"Body '{self.name}' needs a joint twist of 6 numbers with |ω| = 1, or ω = 0 and |v| = 1, "
                f"or all zero; got {self.twist}."
            )
        home.flags.writeable = twist.flags.writeable = False
        object.__setattr__(self, "home", home)
        object.__setattr__(self, "twist", twist)

    @property
    def moves(self) -> bool:
        """Whether a joint lies between the body and its parent."""
        return bool(self.twist.any())


@dataclass(frozen=True, eq=False)
class Tree:
    """A tree of bodies on a base frame {0}; parents come before their children.

    Attributes:
        bodies: The b bodies. The moving ones, in this order, are the n entries of the joint vector q.
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
        T_0i = np.asarray(T_0i, float)
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
        """Indices of the bodies that a joint moves, one for each entry of q."""
        return tuple(i for i, body in enumerate(self.bodies) if body.moves)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the n joints, in the order of q."""
        return tuple(self.bodies[i].joint for i in self.moving)

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

    def body_values(self, values: np.ndarray) -> np.ndarray:
        """Joint values (…, n) spread over the bodies (…, b), zero for the welded ones."""
        values = np.asarray(values)
        if values.shape[-1:] != (len(self.moving),):
            raise ValueError(
                f"Joint values need {len(self.moving)} columns ({', '.join(self.joints)}), got shape {values.shape}."
            )
        out = np.zeros((*values.shape[:-1], len(self.bodies)), values.dtype)
        out[..., list(self.moving)] = values
        return out

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Pose of every body in the base frame (Eq. 7).

        Args:
            q: Joint coordinates in rad or m (…, n).

        Returns:
            T_0i (…, b, 4, 4).
        """
        theta = self.body_values(q)
        poses: list[np.ndarray] = []
        for i, body in enumerate(self.bodies):
            T = body.home @ se3.exp(body.twist, theta[..., i])
            poses.append(T if body.parent == BASE else poses[body.parent] @ T)
        return np.stack(poses, -3)


def is_rigid(T: np.ndarray) -> bool:
    """Whether 4×4 matrices (…, 4, 4) are poses, to rounding."""
    if not np.isfinite(T).all():
        return False
    upright = np.array_equal(np.broadcast_to([0, 0, 0, 1], T[..., 3, :].shape), T[..., 3, :])
    turned = np.allclose(T[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2), np.eye(3), atol=1e-9)
    return bool(upright and turned and (np.linalg.det(T[..., :3, :3]) > 0).all())
