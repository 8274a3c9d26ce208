"""Structure matrix of a mechanism, without data: rows that span those of every possible regressor.

For joint j, all bodies beyond it are one composite body, whose φ in frame j is `φᶜ_j = φ_j + Σ_c X_c(θ_c) φᶜ_c` over
the children c. A φ has no effect on a sensor in any motion exactly when, at every joint and for every posture beyond
it, certain rows vanish on φᶜ_j: those of the momentum regressor (Eq. 12) for the joint's twist, in the directions that
the sensor measures, and for gravity. Each X_c is a sum of linearly independent functions of θ_c with constant matrices.
The coefficient of the constant function stays with the row; that of any other function must vanish by itself and
becomes a row on the child. One pass outward collects all rows. Wensing, Niemeyer and Slotine (Observability in Inertial
Parameter Identification, 2017) have the same idea for joint torques.

With exact numbers (dtype object), such as symbolic lengths, there is no rounding.

Of mechanisms with followers or loops the rows are those of the regressor at well-spread states. It is analytic in the
states: a dependency between its columns holds at all states, or with probability zero at as many random ones as there
are columns.
"""

from dataclasses import dataclass, replace

import numpy as np

from ident.annotations import typed
from ident.errors import InputError, ModelError
from ident.geometry import se3
from ident.geometry.inertia import parameters_from_pseudo_inertia, pseudo_inertia
from ident.geometry.se3 import Ad, ad, hat, inverse
from ident.mechanism.body import BASE, Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model.dim import momentum_regressor
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.independent_columns import reduced_rows
from ident.tolerances import LEAST_SAMPLES, SINGULAR

TWICE_PSEUDO_INERTIAS = pseudo_inertia(2 * np.eye(10)).astype(int)
"""Twice the pseudo-inertia of each unit φ, in integers (10, 4, 4)."""


@typed()
@dataclass(frozen=True)
class Sensors:
    """Available measurements.

    Attributes:
        base_wrench: True if the total wrench at the base is measured.
        joint_torques: True if the torques of all joints are measured.
        moving_base: True if the base moves freely (and is tracked) instead of resting.
        channels: Measured components of the base wrench, as rows w fixed in the base frame, of which each channel reads
            `w · Γ_0` (k, 6), such as some rows of `coAd(inverse(frame))` for a sensor at a pose `frame`; by default all
            six.
        still: True if the mechanism rests in every sample, so that gravity alone acts; a moving base then turns.
    """

    base_wrench: bool = True
    joint_torques: bool = False
    moving_base: bool = False
    channels: np.ndarray | tuple[tuple[float, ...], ...] | None = None
    still: bool = False

    def __post_init__(self) -> None:
        if not (self.base_wrench or self.joint_torques):
            raise InputError("Sensors need the base wrench, joint torques, or both.")
        if self.channels is not None:
            rows = np.asarray(self.channels, dtype=float)
            fits = rows.ndim == 2 and rows.shape[1] == 6 and rows.size and np.isfinite(rows).all()
            if not (self.base_wrench and fits and rows.any(axis=1).all()):
                raise InputError(f"Channels of a base wrench are finite rows (k, 6) other than zero, got {rows}.")
            object.__setattr__(self, "channels", tuple(map(tuple, rows.tolist())))


@dataclass(frozen=True, eq=False)
class Structure:
    """Rows on composite bodies that vanish exactly for parameters without effect.

    Attributes:
        tree: The tree, with one axis for each joint.
        rows: Rows on the constant part of the composite of {0} and of every body, by index (k, 10).
        transfers: Constant part of the transform of φ from each body to its parent (10, 10).
    """

    tree: Tree
    rows: dict[int, np.ndarray]
    transfers: list[np.ndarray]

    @property
    def is_exact(self) -> bool:
        """True if its numbers are exact (dtype object)."""
        return any(x.dtype == object for x in (*self.rows.values(), *self.transfers))

    @property
    def matrix(self) -> np.ndarray:
        """All rows as rows on φ, those of {0} first (rows, 10 b)."""
        composite = _composites(self.tree, self.transfers)
        return np.vstack([rows @ composite[i] for i, rows in self.rows.items()])


def structure(mechanism: Mechanism, sensors: Sensors | None = None) -> Structure:
    """Rows on the composite bodies of a mechanism, which span those of the sensors' regressor over all states.

    Args:
        mechanism: The mechanism of b bodies.
        sensors: The measurements; by default the base wrench of a base at rest.

    Raises:
        ModelError: No body has parameters.
    """
    sensors = sensors or Sensors()
    if not mechanism.bodies:
        raise ModelError("A mechanism of massless bodies has no parameters.")
    tree = _one_axis_each(mechanism.tree)
    weight = np.concatenate([-mechanism.gravity, np.zeros(3, dtype=int)])[None]
    none, still = np.zeros((0, 6), dtype=int), sensors.still
    moving = np.eye(6, dtype=int) if sensors.moving_base and not still else none
    weight = np.eye(3, 6, dtype=int) if sensors.moving_base and still else weight
    transfers = [_transfer(body) for body in tree.bodies]

    # For {0} and every body: rows on its composite, its possible twists, accelerations of gravity, and the directions
    # in which the base wrench is measured, which transform as twists do.
    on_base, measured = _base_rows(_channels(sensors), weight, moving)
    rows, twists, weights, directions = {BASE: _span(on_base, 10)}, {BASE: moving}, {BASE: weight}, {BASE: measured}
    # Joint torques depend on the change of the energy of the base's motion with posture, but not on that energy itself.
    energy = {BASE: np.eye(10 if len(moving) and sensors.joint_torques else 0, 10, dtype=int)}
    constraints = {BASE: rows[BASE]}
    for i, body in enumerate(tree.bodies):
        constant, varying = transfers[i]
        twists[i] = none if still else _span([_carried(twists[body.parent], body), body.motions.T], 6)
        weights[i] = _span([_carried(weights[body.parent], body)], 6)
        directions[i] = _span([_carried(directions[body.parent], body)], 6)
        fresh = [felt[body.parent] @ K for K in varying for felt in (rows, energy)]
        energy[i] = _span([energy[body.parent] @ constant], 10)
        if body.moves:
            fresh += [] if still else [directions[i] @ momentum_regressor(body.twist)]
            if sensors.joint_torques:
                own = momentum_regressor(body.twist)
                fresh += [twists[i] @ own, *(body.twist[None] @ momentum_regressor(weight) for weight in weights[i])]
        constraints[i] = _span(fresh, 10)
        rows[i] = _span([constraints[i], rows[body.parent] @ constant], 10)
    return Structure(tree, constraints, [constant for constant, _ in transfers])


def scaled_structure(mechanism: Mechanism, sensors: Sensors | None = None) -> tuple[Structure, np.ndarray]:
    """`structure` with a mechanism's longest length as unit if it is above 1 m.

    Otherwise the squares of large lengths, as in models in millimetres, would hide smaller entries.

    Args:
        mechanism: The mechanism.
        sensors: The measurements; by default the base wrench of a base at rest.

    Returns:
        The structure, and the factors of the columns of its matrix for parameters in SI units (10 b,).
    """
    sensors, length = sensors or Sensors(), _longest(mechanism.tree)
    if sensors.channels is not None:
        sensors = replace(sensors, channels=np.array(sensors.channels) * [*3 * [1], *3 * [length]])
    scaled = structure(Mechanism(_shrunk(mechanism.tree, length), mechanism.gravity), sensors)
    return scaled, np.resize([1, *3 * [1 / length], *6 * [1 / length**2]], 10 * len(scaled.tree.inertial))


def _longest(tree: Tree) -> float:
    """Longest length in m, rounded up to a power of two, which divides exactly; at least 1, and 1 for exact numbers."""
    if any(body.home.dtype == object or body.twist.dtype == object for body in tree.bodies):
        return 1.0
    lengths = [body.home[:3, 3] for body in tree.bodies] + [b.twist[:3] for b in tree.bodies if b.twist[3:].any()]
    longest = max(abs(x).max() for x in lengths)
    return float(2 ** np.ceil(np.log2(max(longest, 1))))


def _shrunk(tree: Tree, length: float) -> Tree:
    """The tree with all lengths in another unit."""
    if length == 1:
        return tree
    bodies = []
    for body in tree.bodies:
        home, twist = body.home.copy(), body.twist.copy()
        home[:3, 3] /= length
        twist[:3] /= length if twist[3:].any() else 1
        bodies.append(replace(body, home=home, twist=twist))
    return Tree(tuple(bodies))


def _one_axis_each(tree: Tree) -> Tree:
    """The tree with every ball replaced by three revolute joints, which reach the same postures and twists."""
    bodies: list[Body] = []
    place = {BASE: BASE}
    for i, body in enumerate(tree.bodies):
        parent = place[body.parent]
        axes = body.twist.T if body.is_ball else body.twist[None]
        for k, twist in enumerate(axes):
            last = k == len(axes) - 1
            home = body.home if k == 0 else np.eye(4, dtype=int).astype(body.home.dtype)
            name, joint = (body.name, body.joint) if last else (f"{body.name}/{k}", f"{body.joint}/{k}")
            bodies.append(Body(name, parent, home, twist, joint, body.massless or not last))
            parent = len(bodies) - 1
        place[i] = parent
    return Tree(tuple(bodies))


def _channels(sensors: Sensors) -> np.ndarray:
    """Independent rows that span the measured channels of the base wrench (k, 6)."""
    if sensors.channels is None:
        return np.eye(6 if sensors.base_wrench else 0, 6, dtype=int)
    return _span([np.array(sensors.channels)], 6)


def _base_rows(channels: np.ndarray, weight: np.ndarray, moving: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Rows on the composite of the whole mechanism for the channels, and all directions of momentum that they measure.

    With the momentum h a channel reads `w · (ḣ - ad(V)ᵀ h)` and the weight. A φ has no effect on it if `w · h` and
    `(ad(V) w) · h` vanish for all velocities; the latter is of second degree in the base's twist V for the momentum
    `M V` of the base's motion, of first degree for that of each joint's own motion.
    """
    turned = [channels @ ad(V).T for V in moving]
    rows = [channels @ momentum_regressor(V) for V in (*weight, *moving)]
    rows += [
        turned[a] @ momentum_regressor(moving[b]) + turned[b] @ momentum_regressor(moving[a])
        for a in range(len(moving))
        for b in range(a + 1)
    ]
    return rows, channels if len(channels) == 6 else _span([channels, *turned], 6)


def _composites(tree: Tree, transfers: list[np.ndarray]) -> dict[int, np.ndarray]:
    """For {0} and every body, the part of its composite's φ that is constant, from the stacked φ (10, 10 b).

    The constant part of each body's `_transfer` transforms its φ to the parent.
    """
    own = np.eye(10 * len(tree.inertial), dtype=int)
    composite = dict.fromkeys(range(BASE, len(tree.bodies)), np.zeros((10, len(own)), dtype=int))
    composite |= {i: own[10 * k : 10 * k + 10] for k, i in enumerate(tree.inertial)}
    for i in reversed(range(len(tree.bodies))):
        parent = tree.bodies[i].parent
        composite[parent] = composite[parent] + transfers[i] @ composite[i]
    return composite


def _transfer(body: Body) -> tuple[np.ndarray, list[np.ndarray]]:
    """Transform of φ from a body's frame to its parent's: the constant part, and the parts that vary with θ (10, 10).

    The pose is `T(θ) = T_1 + T_s sin θ + T_c cos θ + T_θ θ` and the pseudo-inertia transforms as `T J Tᵀ`. Of the
    products, `sin²` is written as `1 - cos²`; the others are linearly independent.
    """
    v, w = body.twist[:3], hat(body.twist[3:])
    ww = w @ w
    parts = {
        "1": _matrix(np.eye(3, dtype=int) + ww, w @ v, 1),
        "s": _matrix(w, -ww @ v, 0),
        "c": _matrix(-ww, -w @ v, 0),
        "θ": _matrix(0 * w, v + ww @ v, 0),
    }
    poses = {name: body.home @ part for name, part in parts.items() if np.any(part != 0)}
    moved: dict[str, np.ndarray] = {}
    for a, A in poses.items():
        for b, B in poses.items():
            product = "".join(sorted(a + b)).replace("1", "") or "1"
            moved[product] = moved.get(product, 0) + A @ TWICE_PSEUDO_INERTIAS @ B.T
    if "ss" in moved:
        squared = moved.pop("ss")
        moved["1"] = moved["1"] + squared
        moved["cc"] = moved["cc"] - squared
    matrices = {name: parameters_from_pseudo_inertia(J).T / 2 for name, J in moved.items()}
    return matrices.pop("1"), list(matrices.values())


def _matrix(rotation: np.ndarray, translation: np.ndarray, corner: float) -> np.ndarray:
    return np.block([[rotation, translation[:, None]], [np.zeros((1, 3), dtype=int), np.array([[corner]])]])


def _carried(vectors: np.ndarray, body: Body) -> np.ndarray:
    """Rows that span a parent's independent twists, in a body's frame, over all postures of the joint between.

    The twists are transformed by `exp(-ad(ξ) θ)`, whose values have the span of the powers of `ad(ξ)` below the degree
    of its minimal polynomial: `x (x² + 1)²` for a helix; `x (x² + 1)` for an axis and `x²` for a slide need fewer.
    """
    powers = [vectors @ Ad(inverse(body.home)).T]
    if body.moves and len(vectors) < 6:
        bracket = ad(body.twist).T
        for _ in range(4):
            powers.append(powers[-1] @ bracket)
    return np.vstack(powers)


def _span(parts: list[np.ndarray], width: int) -> np.ndarray:
    """Independent rows that span the rows of some matrices, orthonormal unless they are exact."""
    rows = np.vstack([np.zeros((0, width), dtype=int), *parts])
    if rows.dtype == object:
        return reduced_rows(rows)[0]
    _, s, vt = np.linalg.svd(rows, full_matrices=False)
    return vt[s > SINGULAR * s.max(initial=0)]


def sampled_structure(mechanism: Mechanism, sensors: Sensors | None = None) -> np.ndarray:
    """Rows of the sensors' regressor at random states, leaders within the spans of their followers, loops closed.

    Args:
        mechanism: The mechanism of b bodies.
        sensors: The measurements; by default the base wrench of a base at rest.

    Returns:
        A matrix (rows, 10 b) whose columns have the dependencies of the regressor for general motions.
    """
    sensors, rng = sensors or Sensors(), np.random.default_rng(0)
    motion = _motion(rng, mechanism.tree, 10 * len(mechanism.bodies) + LEAST_SAMPLES, sensors)
    tree, g = mechanism.tree, mechanism.gravity
    rows = []
    if sensors.base_wrench:
        Y = base_wrench_regressor(tree, *motion.states, gravity=g, base=motion.base)
        rows.append(Y if sensors.channels is None else np.asarray(sensors.channels) @ Y)
    if sensors.joint_torques:
        rows.append(joint_torque_regressor(tree, *motion.states, gravity=g, base=motion.base))
    return np.concatenate([Y.reshape(-1, Y.shape[-1]) for Y in rows])


def _motion(rng: np.random.Generator, tree: Tree, samples: int, sensors: Sensors) -> Motion:
    """A random state of joints and base for each sample."""
    moves = not sensors.still
    q, in_loops = [np.zeros((samples, 0))], tree.closure.drawn(rng, samples) if tree.closure else {}
    for i in tree.moving:
        body = tree.bodies[i]
        if body.joint in in_loops:
            q.append(in_loops[body.joint])
            continue
        spans = [lead.span for lead in tree.followers.values() if lead.joint == body.joint]
        low, high = max((low for low, _ in spans), default=-np.pi), min((high for _, high in spans), default=np.pi)
        size = (samples, body.coordinates)
        q.append(rng.normal(size=size) if body.is_ball else rng.uniform(min(low, high), max(low, high), size))
    dq, ddq = moves * rng.uniform(-2, 2, size=(2, samples, len(tree.freedoms)))
    if not sensors.moving_base:
        return Motion(np.hstack(q), dq, ddq)
    T = se3.pose(se3.rotation(rng.normal(size=(samples, 4))), rng.uniform(-1, 1, size=(samples, 3)))
    return Motion(np.hstack(q), dq, ddq, BaseMotion(T, *(moves * rng.uniform(-2, 2, size=(2, samples, 6)))))
