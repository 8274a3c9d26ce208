"""One body of a mechanism, with the joint that carries it, whose coordinate may be a function of another's.

A follower moves as the shin slides on the thigh when the knee bends:

    q_f = f(q)        q̇_f = f'(q) q̇        q̈_f = f'(q) q̈ + f''(q) q̇²        τ += f'(q) τ_f

f is a polynomial, so that it can be evaluated for numbers, arrays, signals of a tape and symbols.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from ident.annotations import typed
from ident.errors import ModelError
from ident.geometry import se3


@dataclass(frozen=True)
class Follower:
    """Dependence of a follower on its leading joint.

    Attributes:
        joint: Name of the leading joint, which has a single coordinate.
        coefficients: Coefficients of the polynomial f, the constant first.
        span: Range of the leader's coordinate for which f holds, rad or m.
    """

    joint: str
    coefficients: tuple[float, ...]
    span: tuple[float, float] = (-np.pi, np.pi)

    def __post_init__(self) -> None:
        low, high = self.span
        if not self.coefficients or not np.isfinite([*self.coefficients, low, high]).all() or low >= high:
            raise ModelError(
                f"A follower of '{self.joint}' needs finite coefficients and a span from a smaller to a larger "
                f"coordinate, got {self.coefficients} and {self.span}."
            )

    def value(self, q: Any) -> Any:
        """f(q) for a number, a signal, or an array of any shape."""
        return horner(self.coefficients, q)

    def slope(self, q: Any) -> Any:
        """f'(q) for the same types."""
        return horner(self.coefficients, q, 1)

    def states(self, q: Any, *rates: Any) -> tuple[Any, ...]:
        """The follower's coordinate, and its velocity and acceleration if the leader's are given."""
        slope = self.slope(q) if rates else None
        out = [self.value(q), *(slope * rate for rate in rates)]
        if len(rates) > 1:
            out[2] = out[2] + horner(self.coefficients, q, 2) * (rates[0] * rates[0])
        return tuple(out)


def horner(coefficients: tuple[float, ...], q: Any, order: int = 0) -> Any:
    """Value of a polynomial from its coefficients, the constant first, or of a derivative of some order."""
    *others, last = Polynomial(coefficients).deriv(order).coef.tolist()
    out = q * 0 + last
    for c in reversed(others):
        out = out * q + c
    return out


BASE = -1
"""Parent of a body that is attached to the base frame {0}."""


@typed("parent")
@dataclass(frozen=True, eq=False)
class Body:
    """One rigid body and the joint that connects it to its parent.

    Arrays of numbers are checked; arrays of symbols (dtype object) are not.

    Attributes:
        name: Name of the body.
        parent: Index of the parent body in the tree, smaller than the body's own, or `BASE`.
        home: Pose of the body in its parent's frame at joint coordinate zero (4, 4).
        twist: Joint twist `[v; ω]` in the body's own frame (6,): |ω| = 1 revolute, ω = 0 and |v| = 1 prismatic, all
            zero for a body that is welded to its parent. `ball_twist` for a ball joint (6, 3).
        joint: Name of the joint, empty for a welded body.
        massless: True if the body is only a link between two joints, without φ. Several joints on one body, or a free
            joint, are chains of such links.
        follows: Leading joint and function, for a joint whose coordinate is a function of another's; None for an
            independent joint. A follower has one axis and no name.
        still: Name of the joint that was fixed, for a body that was welded so.
        depends: Name of the joint that loops make dependent; it has no name among the tree's joints either.
    """

    name: str
    parent: int
    home: np.ndarray
    twist: np.ndarray
    joint: str = ""
    massless: bool = False
    follows: Follower | None = None
    still: str = ""
    depends: str = ""

    def __post_init__(self) -> None:
        for key in ("home", "twist"):
            x = np.array(getattr(self, key))
            x = x if x.dtype == object else x.astype(float)
            x.flags.writeable = False
            object.__setattr__(self, key, x)
        if self.home.shape != (4, 4) or not (self.home.dtype == object or is_rigid(self.home)):
            raise ModelError(f"Body '{self.name}' needs a 4×4 rigid home pose, got {self.home}.")
        if not (self.twist.dtype == object or _is_joint_twist(self.twist)):
            raise ModelError(
                f"Body '{self.name}' needs a joint twist of 6 numbers with |ω| = 1, or ω = 0 and |v| = 1, "
                f"or all zero, or a ball joint's 6×3; got {self.twist}."
            )
        if self.follows and (self.joint or self.is_ball or not self.moves):
            raise ModelError(f"Body '{self.name}', which follows '{self.follows.joint}', needs one axis and no joint.")

    @cached_property
    def _values(self) -> tuple[object, ...]:
        home, twist = self.home.tobytes(), self.twist.tobytes()
        return self.name, self.parent, home, twist, self.joint, self.massless, self.follows, self.still, self.depends

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Body) and self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    @cached_property
    def moves(self) -> bool:
        """True if a joint lies between the body and its parent."""
        return bool(np.any(self.twist != 0))

    @property
    def turns(self) -> bool:
        """True if its joint is revolute."""
        return not self.is_ball and bool(self.twist[3:].any())

    @property
    def is_ball(self) -> bool:
        """True if the joint is a ball."""
        return self.twist.ndim == 2

    @cached_property
    def motions(self) -> np.ndarray:
        """Motion subspace of the joint: its twist is `motions @ q̇` in the body's frame (6, 0), (6, 1) or (6, 3).

        For a follower, q̇ is the rate of its own dependent coordinate.
        """
        return self.twist.reshape(6, -1)[:, : None if self.moves else 0]

    @property
    def freedom_names(self) -> tuple[str, ...]:
        """Names of the joint's entries of q̇: its own, with `.x`, `.y` and `.z` for a ball."""
        suffixes = {0: (), 1: ("",), 3: (".x", ".y", ".z")}
        return tuple(self.joint + suffix for suffix in suffixes[self.freedoms])

    @property
    def coordinates(self) -> int:
        """Number of the joint's entries of q: 1, or 4 for the quaternion `w, x, y, z` of a ball; 0 if it depends."""
        return 4 if self.is_ball else self.freedoms

    @property
    def freedoms(self) -> int:
        """Number of the joint's entries of q̇: 0, 1 or 3."""
        return 0 if self.follows or self.depends else self.motions.shape[1]

    def joint_pose(self, q: np.ndarray) -> np.ndarray:
        """Displacement of the body from home by its joint, `exp(ξ̂ q)` for one axis.

        Args:
            q: The joint's coordinates, rad, m or a quaternion of any length (…, 0), (…, 1) or (…, 4).

        Returns:
            Poses (…, 4, 4).
        """
        if not self.moves:
            return np.broadcast_to(np.eye(4, dtype=int), (*q.shape[:-1], 4, 4))
        if not self.is_ball:
            return se3.exp(self.twist, q[..., 0])
        center = np.array([self.twist[2, 1], self.twist[0, 2], self.twist[1, 0]])
        R = se3.rotation(q)
        return se3.pose(R, center - R @ center)


def ball_twist(center: np.ndarray) -> np.ndarray:
    """Twist of a ball joint: rotations about the body's own x, y and z through one center.

    Its coordinates are the quaternion `w, x, y, z` of the body relative to its home, its velocities the angular
    velocity in the body's frame, rad/s, as in MuJoCo and Pinocchio.

    Args:
        center: Center of the joint in the body's frame, m (3,).

    Returns:
        `[ĉ; 1]` (6, 3).
    """
    return np.vstack([se3.hat(center), np.eye(3, dtype=int)])


def free_joint(name: str, body: str, parent: int, index: int) -> tuple[Body, ...]:
    """Bodies of a free joint: three slides along the parent's axes and a ball.

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


_ROUNDED = 1e-9 + 1e-5 * np.eye(3)
"""Tolerance of `R Rᵀ` against the identity, for rotations that a model states with few digits."""


def is_rigid(T: np.ndarray) -> bool:
    """True if all matrices (…, 4, 4) are poses, to rounding."""
    if not np.isfinite(T).all() or (T[..., 3, :] != (0, 0, 0, 1)).any():
        return False
    R = T[..., :3, :3]
    return bool((abs(R @ np.swapaxes(R, -1, -2) - np.eye(3)) <= _ROUNDED).all() and (np.linalg.det(R) > 0).all())


def _is_joint_twist(twist: np.ndarray) -> bool:
    """True if an array is the twist of a weld, of one axis, or of a ball."""
    if not np.isfinite(twist).all():
        return False
    if twist.shape == (6, 3):
        return bool(np.array_equal(twist[3:], np.eye(3)) and np.array_equal(twist[:3], -twist[:3].T))
    unit = np.linalg.norm(twist[3:]) or np.linalg.norm(twist[:3])
    return twist.shape == (6,) and bool(unit == 0 or abs(unit - 1) <= 1e-9)
