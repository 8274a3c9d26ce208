"""Motion of a mechanism: of its joints, of its base frame, and of a carrier, whose joints determine that of a base."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from ident.annotations import as_array, typed
from ident.errors import InputError
from ident.geometry import se3
from ident.geometry.se3 import Ad, ad, applied, inverse
from ident.mechanism.body import is_rigid
from ident.mechanism.loops import Constraints, members_of
from ident.mechanism.tree import Tree

Which = int | slice | np.ndarray
"""One sample, or some: a slice, indices, or a mask."""


@typed()
@dataclass(frozen=True, eq=False)
class BaseMotion:
    """Motion of a moving base frame {0}, for one sample or many.

    Attributes:
        T: Pose of {0} in an inertial frame (…, 4, 4).
        V: Its body twist `[v; ω]` in the axes of {0} (…, 6).
        dV: Time derivative of the components of V (…, 6); `v̇` is the acceleration of the origin less `ω × v`.
    """

    T: np.ndarray
    V: np.ndarray
    dV: np.ndarray

    def __post_init__(self) -> None:
        for key, shape in (("T", (4, 4)), ("V", (6,)), ("dV", (6,))):
            object.__setattr__(self, key, np.asarray(getattr(self, key)))
            x = getattr(self, key)
            if x.shape != (*self.T.shape[:-2], *shape) or not (x.dtype == object or np.isfinite(x).all()):
                raise InputError(
                    f"The motion of a base needs finite T (N, 4, 4), V (N, 6) and dV (N, 6), got {key} {x.shape}."
                )
        if self.T.dtype != object and not is_rigid(self.T):
            raise InputError("The motion of a base needs rigid poses T.")

    @classmethod
    def from_free_joint(cls, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> "BaseMotion":
        """Motion of a base from the coordinates of a free joint, as in `free_joint` and MuJoCo.

        Args:
            q: Position and quaternion (…, 7).
            dq: Linear velocity in the inertial frame, angular velocity in the body's (…, 6).
            ddq: Their rates (…, 6).
        """
        q, dq, ddq = np.asarray(q), np.asarray(dq), np.asarray(ddq)
        if not (q.shape[-1:] == (7,) and dq.shape == ddq.shape == (*q.shape[:-1], 6)):
            raise InputError(
                f"A free joint has coordinates (N, 7), velocities and accelerations (N, 6), "
                f"got {q.shape}, {dq.shape} and {ddq.shape}."
            )
        R = se3.rotation(q[..., 3:])
        to_body = np.swapaxes(R, -1, -2)
        v, a = (np.squeeze(to_body @ x[..., :3, None], -1) for x in (dq, ddq))
        V = np.concatenate([v, dq[..., 3:]], axis=-1)
        return cls(se3.pose(R, q[..., :3]), V, np.concatenate([a - np.cross(dq[..., 3:], v), ddq[..., 3:]], axis=-1))

    def __getitem__(self, which: Which) -> "BaseMotion":
        """Some of the samples."""
        some = copy(self)  # A copy, so that the checks are not repeated.
        for key in ("T", "V", "dV"):
            object.__setattr__(some, key, getattr(self, key)[which])
        return some


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a mechanism: N samples, or one sample without the first axis.

    Attributes:
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        dq: Joint velocities, rad/s or m/s (N, n).
        ddq: Joint accelerations, rad/s² or m/s² (N, n).
        base: Motion of the base frame (N samples), None at rest.
    """

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    base: BaseMotion | None = None

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, which: Which) -> "Motion":
        """Some of the samples."""
        return Motion(self.q[which], self.dq[which], self.ddq[which], self.base and self.base[which])

    @property
    def base_poses(self) -> np.ndarray | None:
        """Poses of a moving base in an inertial frame (N, 4, 4), None for a base at rest."""
        return None if self.base is None else self.base.T

    @property
    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q, q̇ and q̈."""
        return self.q, self.dq, self.ddq

    def checked(self, tree: Tree) -> "Motion":
        """The motion as floating-point numbers, checked to be finite and to fit a mechanism.

        Raises:
            InputError: Numbers of samples or columns do not fit, are not finite, or a quaternion is zero.
        """
        if not (all(as_array(x) is not None for x in self.states) and isinstance(self.base, BaseMotion | None)):
            raise InputError("A motion needs arrays of real numbers, and a BaseMotion or None as base.")
        q, dq, ddq = (np.asarray(x, float) for x in self.states)
        tree.body_coordinates(q)
        tree.body_velocities(dq)
        if q.ndim != 2 or len(q) != len(dq) or dq.shape != ddq.shape:
            raise InputError(
                f"q, dq and ddq need one number of samples N, shapes (N, {tree.size}), (N, {len(tree.freedoms)}) and "
                f"(N, {len(tree.freedoms)}), got {q.shape}, {dq.shape} and {ddq.shape}."
            )
        if not all(np.isfinite(x).all() for x in (q, dq, ddq)):
            raise InputError("Joint states need finite numbers, got NaN or infinity.")
        return Motion(q, dq, ddq, self.base).checked_further(tree)

    def checked_further(self, tree: Tree) -> "Motion":
        """`checked` for joint states that are already known to be finite and to have the right shapes."""
        q, dq, ddq = (np.asarray(x, float) for x in self.states)
        balls = [i for i, body in enumerate(tree.bodies) if body.is_ball]
        own = tree.body_coordinates(q) if balls else []
        for i in balls:
            if not own[i].any(axis=1).all():
                sample = int(np.argmin(own[i].any(axis=1)))
                raise InputError(f"Joint '{tree.bodies[i].joint}' needs quaternions; that of sample {sample} is zero.")
        if self.base is not None and self.base.T.shape != (len(q), 4, 4):
            raise InputError(
                f"{len(q)} joint states need as many samples of the base's motion, got {self.base.T.shape}."
            )
        return Motion(q, dq, ddq, self.base)


def joined(parts: Sequence[Motion]) -> Motion:
    """Consecutive motions concatenated into one."""
    q, dq, ddq = (np.concatenate(x) for x in zip(*(part.states for part in parts), strict=True))
    bases = [(part.base.T, part.base.V, part.base.dV) for part in parts if part.base is not None]
    base = BaseMotion(*(np.concatenate(x) for x in zip(*bases, strict=True))) if bases else None
    return Motion(q, dq, ddq, base)


@dataclass(frozen=True, eq=False)
class Carrier:
    """A chain of bodies on a base at rest; its last body is the base of the carried mechanism.

    Its masses have no effect on a sensor between it and the carried mechanism.

    Attributes:
        tree: The chain, before whose last body those stand that are in loops with it.
        constraints: Constraints of these loops.
    """

    tree: Tree
    constraints: Constraints = field(default_factory=Constraints)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.tree.joints

    def motion(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> BaseMotion:
        """Motion of the last body.

        The recursion from one body to the next is

            V_i = Ad(T) V_{i-1} + S q̇        V̇_i = Ad(T) V̇_{i-1} + ad(V_i) S q̇ + S q̈.

        Args:
            q: Joint coordinates in rad, m or quaternions (…, n_q).
            dq: Joint velocities, rad/s or m/s (…, n); `ddq` accelerations.

        Returns:
            Poses of that body in the frame of the base at rest, its twists and their rates.
        """
        tree = self.tree
        T = np.broadcast_to(np.eye(4), (*np.shape(q)[:-1], 4, 4))
        V = dV = np.zeros((*np.shape(q)[:-1], 6))
        states = tree.body_states(q, dq, ddq)
        for i in tree.chain(len(tree.bodies) - 1):
            body, (q_i, dq_i, ddq_i) = tree.bodies[i], states[i]
            step = body.home @ body.joint_pose(q_i) if body.moves else body.home
            T, across = T @ step, Ad(inverse(step))
            own = dq_i @ body.motions.T
            V = applied(across, V) + own
            dV = (across @ dV[..., None] + ad(V) @ own[..., None])[..., 0] + ddq_i @ body.motions.T
        return BaseMotion(T, V, dV)


def divided(tree: Tree, name: str, constraints: Constraints) -> tuple[Carrier, Tree, tuple[int, ...]]:
    """Splits a tree before one of its bodies.

    Args:
        tree: The tree.
        name: The body.
        constraints: Constraints of the tree.

    Returns:
        The carrier of the body; the tree of the body, whose frame is {0}, and of all bodies on it; and their indices in
        the whole tree.

    Raises:
        InputError: There is no such body, or no joint moves it.
    """
    if name not in tree.names:
        raise InputError(f"There is no body '{name}' to be carried; the bodies are {', '.join(tree.names)}.")
    last = tree.names.index(name)
    chain, carried = {*tree.chain(last)}, tree.carried(last)
    rows = tuple(row for row in constraints.rows if not members_of(tree, [row]) & {*carried} - {last})
    loops = [each for each in replace(constraints, rows=rows).apart(tree) if members_of(tree, each.rows) & chain]
    own = tuple(row for each in loops for row in each.rows)
    before = Tree(tree.part([*sorted((chain | members_of(tree, own)) - {last}), last]))
    if not any(tree.bodies[i].coordinates for i in tree.chain(last)):
        raise InputError(f"No joint moves '{name}', so that its weight cannot be separated from its sensor's offset.")
    return Carrier(before, replace(constraints, rows=own)), tree.beyond(last), carried
