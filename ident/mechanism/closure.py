"""Closure of loops: joints whose coordinates follow from those of others, because constraints hold between bodies.

    c(q_a, q_d) = 0        q̇_d = G q̇_a,  G = -J_d⁺ J_a        q̈_d = -J_d⁺ (J_a q̈_a + J̇ q̇)        τ_a += Gᵀ τ_d

q_d follows by Newton's method, continued from the model's posture and along a recording. One step from there is part of
the recorded equations: with it, the derivatives of all that depends on q_a are exact. Where c is linear,
q_d = G q_a + k. Least squares take redundant constraints, as those of loops in a plane are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from scipy.spatial import cKDTree

from ident.errors import ModelError
from ident.geometry.se3 import Ad, ad, applied
from ident.tolerances import ROUNDING

if TYPE_CHECKING:
    from ident.mechanism.tree import Tree

STEP = 0.1
"""Largest step of the independent coordinates in the continuation, rad or lengths of the mechanism."""

ITERATIONS = 12
"""Steps of Newton's method, of which a start within `STEP` needs three or four."""

OPEN = 1e-3
"""Distance of a loop's ends that counts as open, over the mechanism's length: models state places with few digits."""

SINGULAR = 0.01
"""Smallest singular value of the dependent joints' unit columns that counts as singular: a posture within 0.01 rad of
one in which bodies are aligned."""


class BodyKinematics(NamedTuple):
    """Poses (…, 4, 4), twists and their rates (…, 6), of bodies and last of the base; the joints' screws and states."""

    poses: list[np.ndarray]
    twists: list[np.ndarray]
    rates: list[np.ndarray]
    screws: list[np.ndarray]
    states: list[tuple[np.ndarray, ...]]


Rows = tuple[np.ndarray, dict[int, np.ndarray], np.ndarray]
"""Residuals (…, m), derivatives by the rates of bodies' joints (…, m, f), and accelerations without those (…, m)."""


class Constraint(Protocol):
    """A constraint of positions between bodies, such as those of `ident.mechanism.loops`."""

    @property
    def name(self) -> str:
        """Its name."""

    def rows(self, tree: "Tree", at: BodyKinematics, length: float) -> Rows:
        """Its rows, in base axes, distances over a length so that they count like angles."""


def kinematics(tree: "Tree", q: np.ndarray, dq: np.ndarray | None) -> BodyKinematics:
    """Kinematics of a tree on a base at rest, without the joints' accelerations."""
    still = 0 * q[..., :1] + np.zeros(len(tree.freedoms))
    states, base = tree.body_states(q, still if dq is None else dq, still), np.zeros(6)
    at = BodyKinematics([np.eye(4)], [base], [base], [], states)
    for body, (x, dx, ddx) in zip(tree.bodies, states, strict=True):
        # The base stays last, at the index BASE.
        T = at.poses[body.parent] @ (body.home @ body.joint_pose(x))
        S = Ad(T) @ body.motions
        V, own = at.twists[body.parent], applied(S, dx)
        at.rates.insert(-1, at.rates[body.parent] + applied(S, ddx) + applied(ad(V), own))
        at.twists.insert(-1, V + own)
        at.poses.insert(-1, T)
        at.screws.append(S)
    return at


@dataclass(frozen=True)
class Closure:
    """Loops of a tree and the joints that they make dependent.

    Attributes:
        part: The bodies that the loops go through, as a tree of their own, in which all joints are independent. What
            carries a loop as a whole does not matter to it.
        constraints: Constraints of the loops.
        dependent: Names of the dependent joints, each with one coordinate.
        anchors: Coordinates of the part in which the loops are closed (K, n_q), from which Newton's method starts.
    """

    part: "Tree"
    constraints: tuple[Constraint, ...]
    dependent: tuple[str, ...]
    anchors: np.ndarray = field(compare=False, repr=False)

    @cached_property
    def independent(self) -> tuple[str, ...]:
        """Names of the other joints of the part."""
        return tuple(joint for joint in self.part.joints if joint not in self.dependent)

    @cached_property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the independent and of the dependent coordinates of the part."""
        return self._split("coordinates")

    @cached_property
    def _freedoms(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices of the independent and of the dependent velocities of the part."""
        return self._split("freedoms")

    def _split(self, what: str) -> tuple[np.ndarray, np.ndarray]:
        depends = np.isin(self.part.owners(what), self.dependent)
        return np.flatnonzero(~depends), np.flatnonzero(depends)

    @cached_property
    def _length(self) -> float:
        """The largest distance between a body's frame and its parent's, m; 1 if all coincide."""
        return max((float(np.linalg.norm(body.home[:3, 3])) for body in self.part.bodies), default=0.0) or 1.0

    @cached_property
    def _scale(self) -> np.ndarray:
        """Factors that make the independent coordinates comparable: 1 for angles, one over the length for slides."""
        slides = [body.joint for body in self.part.bodies if not (body.is_ball or body.turns)]
        own = self.part.owners("coordinates")[self.coordinates[0]]
        return np.where(np.isin(own, slides), 1 / self._length, 1.0)

    @cached_property
    def affine(self) -> tuple[np.ndarray, np.ndarray] | None:
        """G (d, n) and k (d,) if the constraints are linear in all coordinates, else None."""
        q = np.vstack([np.zeros(self.part.size), np.random.default_rng(0).normal(size=self.part.size)])
        (a, d), (residual, (J, drawn), _) = self._freedoms, self.rows(q)
        if not np.allclose(J, drawn, rtol=1e-12, atol=1e-12):
            return None
        return -_least_squares(J[:, d], J[:, a]), -_least_squares(J[:, d], residual[0, :, None])[:, 0]

    def completed(self, x: np.ndarray, start: np.ndarray, *rates: np.ndarray) -> list[np.ndarray]:
        """Dependent coordinates, and their velocities and accelerations, from the independent ones.

        Args:
            x: Independent coordinates, numbers (…, n_q) or signals of a tape (n_q,).
            start: Dependent coordinates close to the loops' closure (…, d).
            rates: Independent velocities and accelerations (…, n), if those are wanted.

        Returns:
            Up to three arrays (…, d).
        """
        if self.affine:
            G, k = self.affine
            return [applied(G, x) + k, *(applied(G, rate) for rate in rates)]
        d = self._freedoms[1]
        residual, J, _ = self.rows(self._joined(self.coordinates, x, start))
        out = [start - _least_squares(J[..., d], residual[..., None])[..., 0]]
        if rates:
            q = self._joined(self.coordinates, x, out[0])
            G = self._slopes(q)
            out += [applied(G, rate) for rate in rates]
        if len(rates) > 1:
            _, J, bias = self.rows(q, self._joined(self._freedoms, rates[0], out[1]))
            out[2] = out[2] - _least_squares(J[..., d], bias[..., None])[..., 0]
        return out

    def slopes(self, x: np.ndarray, start: np.ndarray) -> np.ndarray:
        """Derivatives G of the dependent coordinates by the independent velocities (…, d, n), as for `completed`."""
        if self.affine:
            return np.broadcast_to(self.affine[0], (*np.shape(x)[:-1], *self.affine[0].shape))
        return self._slopes(self._joined(self.coordinates, x, *self.completed(x, start)))

    def _slopes(self, q: np.ndarray) -> np.ndarray:
        """Derivatives G (…, d, n) at coordinates of the part (…, n_q) with loops closed."""
        (a, d), (_, J, _) = self._freedoms, self.rows(q)
        return -_least_squares(J[..., d], J[..., a])

    def solved(self, x: np.ndarray) -> np.ndarray:
        """Dependent coordinates by Newton's method from the nearest anchor, as close as they come (…, d).

        Args:
            x: Independent coordinates (…, n_q).
        """
        if self.affine:
            return self.completed(np.asarray(x, float), np.zeros((*np.shape(x)[:-1], len(self.dependent))))[0]
        flat = np.asarray(x, float).reshape(int(np.prod(np.shape(x)[:-1])), len(self.coordinates[0]))
        *_, q = self.way(flat)
        return q[:, self.coordinates[1]].reshape(*np.shape(x)[:-1], len(self.dependent))

    def way(self, x: np.ndarray) -> Iterator[np.ndarray]:
        """Coordinates of the part (N, n_q): the nearest anchors, and as the loops close on the way to independent ones.

        Args:
            x: Independent coordinates (N, n_q).
        """
        own = self.coordinates[0]
        q = self.anchors[self._nearest(x)[1]]
        start = q[:, own]
        yield q
        steps = max(1, int(np.ceil(np.abs((x - start) * self._scale).max(initial=0) / STEP)))
        for k in range(1, steps + 1):
            q = q.copy()
            q[:, own] = start + k / steps * (x - start)
            q = self._newton(q, ITERATIONS if k == steps else 4)
            yield q

    def _watched(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates of the part (N, n_q) from independent ones, distances left open, and least singular values (N,).

        The latter are the smallest on the way; zero beyond a posture in which a determinant changes its sign, and where
        Newton's method does not converge.
        """
        least, before = np.ones(len(x)), None
        for q in self.way(x):
            residual, J, _ = self.rows(q)
            J = J[..., self._freedoms[1]]
            beyond = before is not None and np.linalg.det(np.swapaxes(before, -1, -2) @ J) <= 0
            least, before = np.minimum(least, np.where(beyond, 0, _least_singular(J))), J
        left = np.linalg.norm(applied(np.swapaxes(J, -1, -2), residual), axis=-1)
        return q, np.linalg.norm(residual, axis=-1), np.where(left < ROUNDING, least, 0)

    def in_posture(self) -> "Closure":
        """The closure with its loops closed at its only anchor, the posture of a model.

        Raises:
            ModelError: They cannot be closed, or are singular there.
        """
        return replace(self, anchors=self._checked(self.anchors[:, self.coordinates[0]], ["in the model's posture"]))

    def along(self, x: np.ndarray, time: np.ndarray) -> "Closure":
        """The closure with anchors along a recording.

        Args:
            x: Independent coordinates (N, n_q).
            time: Times of the samples, s (N,).

        Raises:
            ModelError: The loops cannot be closed in a sample, or are singular there.
        """
        if self.affine:
            return self
        cells = np.unique(np.round(x * self._scale / STEP), axis=0, return_index=True)[1]
        left, out, when = np.sort(cells), self, np.array([f"at {t:.6g} s" for t in time])
        while len(left):
            distance = out._nearest(x[left])[0]
            near = distance <= max(2 * STEP, distance.min())
            q = out._checked(x[left[near]], when[left[near]])
            out, left = replace(out, anchors=np.concatenate([out.anchors, q])), left[~near]
        out._checked(x, when)
        return out

    def closes(self, x: np.ndarray) -> np.ndarray:
        """True for independent coordinates (N, n_q) in which the loops can be closed and are not singular (N,)."""
        if self.affine:
            return np.ones(len(x), bool)
        _, apart, least = self._watched(x)
        # Beside a singular posture loops might change to another branch within half a step.
        return np.asarray((apart < OPEN) & (least > SINGULAR + STEP / 2))

    def drawn(self, rng: np.random.Generator, samples: int) -> dict[str, np.ndarray]:
        """Random coordinates of the independent joints, by name, in which the loops are closed (N, 1) or (N, 4)."""
        own, kept = self.coordinates[0], list[np.ndarray]()
        for reach in np.pi / 2.0 ** np.arange(8):
            x = self.about(rng, samples, reach)
            kept.append(x[self.closes(x)])
            if sum(map(len, kept)) >= samples:
                break
        x = np.resize(np.concatenate([*kept, self.anchors[:, own]]), (samples, len(own)))
        return {joint: x[:, self.part.owners("coordinates")[own] == joint] for joint in self.independent}

    def about(self, rng: np.random.Generator, samples: int, reach: float) -> np.ndarray:
        """Random independent coordinates about the anchors, up to a reach in rad or lengths (N, n_q)."""
        start = self.anchors[rng.integers(len(self.anchors), size=samples)][:, self.coordinates[0]]
        return start + rng.uniform(-reach, reach, start.shape) / self._scale

    def _nearest(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distances of independent coordinates (N, n_q) from the nearest anchors, and the indices of these (N,)."""
        # A column of zeros leaves something to compare where nothing is independent.
        places = [np.pad(y * self._scale, ((0, 0), (0, 1))) for y in (self.anchors[:, self.coordinates[0]], x)]
        distance, nearest = cKDTree(places[0]).query(places[1])
        return distance, nearest

    def _newton(self, q: np.ndarray, iterations: int) -> np.ndarray:
        """Coordinates of the part (N, n_q) with the dependent ones as close to the loops' closure as they come."""
        for _ in range(iterations):
            residual, J, _ = self.rows(q)
            step = _least_squares(J[..., self._freedoms[1]], residual[..., None])[..., 0]
            size = np.abs(step).max(axis=-1, initial=0, keepdims=True)
            q = q.copy()
            q[..., self.coordinates[1]] -= step / np.maximum(1, 2 * size)
            if size.max(initial=0) < 1e-12:
                break
        return q

    def _checked(self, x: np.ndarray, when: Sequence[str] | np.ndarray) -> np.ndarray:
        """Coordinates of the part (N, n_q) from independent ones; refused where loops are open or singular."""
        q, apart, least = self._watched(x)
        joints, k = ", ".join(self.independent), int((apart > OPEN).argmax())
        if apart[k] > OPEN:
            names = ", ".join(f"'{each.name}'" for each in self.constraints)
            raise ModelError(
                f"The loops of {names} cannot be closed {when[k]}: {apart[k] * self._length:.2g} m remain. Check the "
                f"model's posture, its axes, and the zeros, signs and units of {joints or 'its joints'}."
            )
        if least.min() < SINGULAR:
            if not joints:
                raise self.rigid()
            raise ModelError(
                f"The loops are singular {when[int((least < SINGULAR).argmax())]}: {joints} there does not determine "
                f"{', '.join(self.dependent)}. Leave that posture out, log one of these joints, or align axes that are "
                "meant to be parallel."
            )
        return q

    def rigid(self) -> ModelError:
        """Refusal of loops without an independent joint."""
        names = " ".join(each.name for each in self.constraints)
        return ModelError(
            f"Loops leave {', '.join(self.dependent)} no motion. Align axes that are meant to be parallel, or leave a "
            f"wrong constraint out with --ignore, one of: {names}."
        )

    def _joined(self, places: tuple[np.ndarray, np.ndarray], own: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Values of the part (…, n) from those of its independent and dependent joints."""
        return np.concatenate([own, other], axis=-1)[..., np.argsort(np.concatenate(places))]

    def rows(self, q: np.ndarray, dq: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (…, m), derivatives by the part's velocities (…, m, n), and accelerations for given velocities."""
        at, parts = kinematics(self.part, q, dq), []
        for each in self.constraints:
            residual, by_body, bias = each.rows(self.part, at, self._length)
            nothing = 0.0 * residual[..., None]
            columns = (np.repeat(nothing, body.motions.shape[1], -1) for body in self.part.bodies)
            felt = [np.moveaxis(by_body.get(i, own), -1, 0) for i, own in enumerate(columns)]
            parts.append((residual, np.moveaxis(self.part.joint_sums(q, felt), 0, -1), bias))
        residuals, Js, biases = zip(*parts, strict=True)
        return np.concatenate(residuals, -1), np.concatenate(Js, -2), np.concatenate(biases, -1)


def _least_singular(columns: np.ndarray) -> np.ndarray:
    """Smallest singular values of unit columns (…,), from columns of any length (…, m, d)."""
    unit = columns / np.maximum(np.linalg.norm(columns, axis=-2, keepdims=True), 1e-12)
    return np.asarray(np.linalg.svd(unit, compute_uv=False).min(axis=-1, initial=1))


def _least_squares(J: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solutions x (…, d, k) of J x = b by least squares, of numbers or of signals, which are not pivoted."""
    transposed = np.swapaxes(J, -1, -2)
    A, x = transposed @ J, transposed @ b
    if A.dtype != object:
        # A singular posture leaves its direction where it is.
        ridge = 1e-14 * np.trace(A, axis1=-2, axis2=-1)[..., None, None] + 1e-300
        return np.linalg.solve(A + ridge * np.eye(A.shape[-1]), x)
    n = len(A)
    for k in range(n):
        for i in range(k + 1, n):
            factor = 0.0 if A[i, k] == 0 else A[i, k] / A[k, k]
            A[i], x[i] = A[i] - factor * A[k], x[i] - factor * x[k]
    for k in reversed(range(n)):
        x[k] = (x[k] - sum((A[k, i] * x[i] for i in range(k + 1, n)), 0 * x[k])) / A[k, k]
    return x
