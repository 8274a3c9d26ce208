"""Design of excitations: optimal finite Fourier series within joint limits and free of collisions.

minimise    cost(q, q̇, q̈)      over center and coefficients of a Fourier series
subject to  low ≤ q ≤ high,  |q̇| ≤ velocity,  |q̈| ≤ acceleration,  linear in both,  and no collisions

From a start, f(x) is minimised subject to |A_j x_j| ≤ 1 for the variables of every joint j by a primal-dual
interior-point method. With slacks s± = 1 ∓ A x, multipliers λ± and decreasing barrier weights μ, steps p solve

    (B + Σ) p = -∇φ,     φ = f - μ Σ log s⁺ s⁻,     Σ_j = A_jᵀ (λ⁺/s⁺ + λ⁻/s⁻) A_j,     then λ± = (μ ± λ± A p)/s±

where B approximates ∇²f by damped BFGS updates (Nocedal and Wright, *Numerical Optimization*, 2006, procedure 18.2 and
chapter 19, doi:10.1007/978-0-387-40065-5). Time grows linearly with the number of limits.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ident.errors import InputError
from ident.tolerances import HUGE
from sim.motion.collisions import Collisions, Walls
from sim.motion.excitation import FourierTrajectory, basis

States: TypeAlias = tuple[np.ndarray, np.ndarray, np.ndarray]
"""q, q̇ and q̈ of a motion, or a value for each of their entries (G, n)."""

Cost: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[float, States]]
"""Cost to minimise: from q, q̇ and q̈ of a motion (G, n) to a number and its derivatives by them."""

CHECKED = 4
"""Samples at which collisions are checked, per sample of the cost."""


@dataclass(frozen=True, eq=False)
class Limits:
    """Joint limits.

    Attributes:
        low: Smallest positions, rad or m (n,); `high` the largest.
        velocity: Largest velocities, rad/s or m/s (n,).
        acceleration: Largest accelerations, rad/s² or m/s² (n,).
    """

    low: np.ndarray
    high: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def __post_init__(self) -> None:
        for name in ("low", "high", "velocity", "acceleration"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))
        if not ((self.low > -HUGE) & (self.low < self.high) & (self.high < HUGE)).all():
            raise InputError(
                f"Position limits need a lower one below an upper one, both within ±{HUGE:g}, got {self.low.tolist()} "
                f"and {self.high.tolist()}."
            )
        for name in ("velocity", "acceleration"):
            limit = getattr(self, name)
            if not ((limit > 0) & (limit < HUGE)).all():
                raise InputError(f"Limits of the {name} need to be positive and below {HUGE:g}, got {limit.tolist()}.")

    @property
    def middle(self) -> np.ndarray:
        """Positions halfway between the limits (n,)."""
        return (self.low + self.high) / 2

    @property
    def half_range(self) -> np.ndarray:
        """Half the distance between the position limits (n,)."""
        return (self.high - self.low) / 2

    def use(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Largest fraction of a limit that each joint uses, above 1 if it violates one (n,).

        Args:
            q: Positions (N, n); `dq` and `ddq` velocities and accelerations.
        """
        fractions = (q - self.middle) / self.half_range, dq / self.velocity, ddq / self.acceleration
        return np.max([abs(x).max(axis=0) for x in fractions], axis=0)


def scaled_into(trajectory: FourierTrajectory, limits: Limits) -> FourierTrajectory:
    """The trajectory with every joint that violates a limit shrunk towards the middle of its range."""
    time = np.linspace(0, trajectory.duration, 200 * trajectory.harmonics + 1)
    # The margin covers peaks between two samples, which are at most 1.3e-4 higher.
    factor = 1 / np.maximum(1, limits.use(*trajectory.states(time)) * (1 + 2e-4))
    center = limits.middle + factor * (trajectory.center - limits.middle)
    return replace(trajectory, center=center, coefficients=factor[:, None] * trajectory.coefficients)


def random_start(
    limits: Limits, duration: float, harmonics: int, rng: np.random.Generator, center: np.ndarray | None = None
) -> FourierTrajectory:
    """A random motion inside the limits.

    Args:
        limits: The limits.
        duration: Period, s.
        harmonics: Number of harmonics K.
        rng: Generator of the coefficients.
        center: Mean positions, moved off the limits if necessary (n,); by default random as well.
    """
    n = len(limits.low)
    drawn = limits.middle + rng.uniform(-0.5, 0.5, n) * limits.half_range
    center = drawn if center is None else center
    inside = np.clip(center, limits.middle - 0.8 * limits.half_range, limits.middle + 0.8 * limits.half_range)
    coefficients = rng.normal(size=(n, 2 * harmonics - 2)) * limits.velocity[:, None]
    swing = FourierTrajectory(duration, np.zeros(n), coefficients)
    # Around its own center the motion may use the distance to the nearer limit.
    room = limits.half_range - abs(inside - limits.middle)
    swing = scaled_into(swing, Limits(-room, room, limits.velocity, limits.acceleration))
    return replace(swing, center=inside)


def nearby_start(motion: FourierTrajectory, limits: Limits, rng: np.random.Generator) -> FourierTrajectory:
    """A random motion near another one, inside the limits.

    Args:
        motion: The other motion.
        limits: The limits.
        rng: Generator of the differences.
    """
    # Standard deviation relative to the root mean square of each joint's coefficients, and for the centre to a quarter
    # of the joint's range.
    spread = 0.8
    center = motion.center + spread / 2 * limits.half_range * rng.normal(size=len(motion.center))
    swing = np.sqrt(np.mean(motion.coefficients**2, axis=1, keepdims=True))
    coefficients = motion.coefficients + spread * swing * rng.normal(size=motion.coefficients.shape)
    return scaled_into(replace(motion, center=center, coefficients=coefficients), limits)


def design(
    cost: Cost,
    limits: Limits,
    start: FourierTrajectory,
    *,
    collisions: Collisions | None = None,
    iterations: int = 100,
    below: float = np.inf,
) -> FourierTrajectory | None:
    """Optimal motion by an interior-point method from a start.

    Limits are linear in the coefficients and hold for all iterates. If the best motion without regard to collisions
    collides, it is shrunk until it does not, and the search continues from there with a barrier against collisions.

    Args:
        cost: Cost to minimise.
        limits: Joint limits.
        start: Initial motion; its duration and number of harmonics are kept.
        collisions: Collisions to avoid; by default none are checked.
        iterations: Largest number of iterations of each search.
        below: Cost below which a motion that collides has to be for the second search to be made.

    Returns:
        A motion strictly inside the limits, or None if all motions that were tried collide.
    """
    search = _Search(cost, limits, start.duration, start.harmonics)
    best = search.run(scaled_into(start, limits), iterations)
    return best if collisions is None else search.around(collisions, best, iterations, below)


class _Search:
    """A design problem in scaled variables: `x = [(center - middle)/half_range, coefficients/velocity]` per joint."""

    def __init__(self, cost: Cost, limits: Limits, duration: float, harmonics: int) -> None:
        self.cost, self.limits, self.duration, self.harmonics = cost, limits, duration, harmonics
        # Twelve for each period of the fastest harmonic.
        self.samples = max(100, 12 * harmonics)
        # q - middle, q̇ and q̈ of joint j are maps[:, j] @ x[j].
        self.maps = self._maps(harmonics, self.samples)
        scale = np.stack([limits.half_range, limits.velocity, limits.acceleration])
        # Limits are imposed at more samples than the cost has.
        fractions = self._maps(harmonics, 3 * self.samples) / scale[:, :, None, None]
        self.rows = np.concatenate(list(fractions), axis=1)

    def _maps(self, harmonics: int, samples: int) -> np.ndarray:
        """Matrices from the variables of each joint to its states (3, n, samples, w)."""
        B = basis(self.duration, harmonics, np.arange(samples) * self.duration / samples)
        maps = np.zeros((3, len(self.limits.low), samples, B.shape[2] + 1))
        maps[0, :, :, 0] = self.limits.half_range[:, None]
        maps[..., 1:] = B[:, None] * self.limits.velocity[:, None, None]
        return maps

    def run(self, start: FourierTrajectory, iterations: int) -> FourierTrajectory:
        """The better of a start and the minimum found from it."""
        # Shrunk towards the middle of all limits, so that the search begins strictly inside.
        x = minimum(self.value_and_gradient, 0.9 * self.variables(start), self.rows, iterations)
        candidates = [scaled_into(self.trajectory(x), self.limits), start]
        return min(candidates, key=lambda trajectory: self.value_and_gradient(self.variables(trajectory))[0])

    def around(
        self, collisions: Collisions, motion: FourierTrajectory, iterations: int, below: float
    ) -> FourierTrajectory | None:
        """The given motion if it does not collide, else the optimum with a barrier, or None."""
        maps = self._maps(self.harmonics, CHECKED * self.samples)[0]
        walls = Walls(collisions, maps, self.limits.middle, self.limits.half_range)
        x = self.variables(motion)
        if not walls.hit(x):
            return motion
        if not self.value_and_gradient(x)[0] < below or (inside := walls.shrunk(x)) is None:
            return None

        def walled(x: np.ndarray) -> tuple[float, np.ndarray]:
            barrier, slope = walls.barrier(x)
            if not np.isfinite(barrier):
                return barrier, slope
            value, gradient = self.value_and_gradient(x)
            return value + barrier, gradient + slope

        x = minimum(walled, inside, self.rows, iterations)
        motion = scaled_into(self.trajectory(x), self.limits)
        time = np.linspace(0, self.duration, 2 * CHECKED * self.samples + 1)
        return None if collisions.depth(motion.states(time)[0]).any() else motion

    def variables(self, motion: FourierTrajectory) -> np.ndarray:
        """Scaled variables of a motion (n, w)."""
        center = (motion.center - self.limits.middle) / self.limits.half_range
        return np.column_stack([center, motion.coefficients / self.limits.velocity[:, None]])

    def trajectory(self, x: np.ndarray) -> FourierTrajectory:
        """Motion from scaled variables (n, w)."""
        center = self.limits.middle + self.limits.half_range * x[:, 0]
        return FourierTrajectory(self.duration, center, x[:, 1:] * self.limits.velocity[:, None])

    def value_and_gradient(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Cost of a motion in scaled variables (n, w), and its derivatives by them."""
        q, dq, ddq = np.swapaxes((self.maps @ x[:, :, None])[..., 0], 1, 2)
        value, derivatives = self.cost(q + self.limits.middle, dq, ddq)
        return value, np.einsum("dgj,djgw->jw", np.stack(derivatives), self.maps, optimize=True)


Function = Callable[[np.ndarray], tuple[float, np.ndarray]]
"""Value of f at a point (n, w), and its gradient there."""

BARRIERS = (2.0, 0.2, 0.02, 0.002)
"""Weights of the barrier, μ times the number of rows, in the unit of f: it costs less than twice the last weight."""

SETTLED = 0.005
"""Predicted decrease, relative to a weight, below which the method goes on to the next weight."""

SIGNS = np.array([1.0, -1.0])[:, None, None]
"""Signs of upper and lower limits."""


@dataclass(frozen=True, eq=False)
class _Point:
    """A point x (n, w) with value and gradient of f, and the slacks s± (2, n, m)."""

    x: np.ndarray
    value: float
    gradient: np.ndarray
    slacks: np.ndarray

    def barred(self, weight: float) -> float:
        """Value of f with the barrier, φ."""
        return self.value - weight * float(np.log(self.slacks).sum())


def minimum(function: Function, start: np.ndarray, limits: np.ndarray, iterations: int) -> np.ndarray:
    """Local minimum of a function within limits.

    Args:
        function: f and its gradient.
        start: Initial point, strictly inside the limits (n, w).
        limits: Rows A_j of n blocks (n, m, w).
        iterations: Largest number of steps.

    Returns:
        The visited point of least value (n, w).
    """
    here = best = _Point(start, *function(start), 1 - SIGNS * _times(limits, start))
    number, (barrier, *later) = limits[:, :, 0].size, BARRIERS
    curvature, multipliers = np.eye(start.size), barrier / number / here.slacks
    for _ in range(iterations):
        step, slope, multipliers = _step(here, curvature, multipliers, limits, barrier / number)
        there = None
        if -slope > SETTLED * barrier:
            there = _descended(function, here, step, slope, limits, barrier / number)
        if there is not None:
            curvature = _updated(curvature, (there.x - here.x).ravel(), (there.gradient - here.gradient).ravel())
            here, best = there, min(best, there, key=lambda point: point.value)
        elif later:
            barrier = later.pop(0)
        else:
            break
    return best.x


def _step(
    here: _Point, curvature: np.ndarray, multipliers: np.ndarray, limits: np.ndarray, weight: float
) -> tuple[np.ndarray, float, np.ndarray]:
    """A step p (n, w), the slope of φ along it, and the multipliers after it (2, n, m)."""
    n, _, w = limits.shape
    central = weight / here.slacks
    # Near μ/s, their values for a pure barrier method.
    multipliers = np.clip(multipliers, central / 1e3, central * 1e3)
    gradient = here.gradient + _times(np.swapaxes(limits, 1, 2), central[0] - central[1])
    matrix = curvature.reshape(n, w, n, w).copy()
    stiffness = (multipliers / here.slacks).sum(axis=0)
    matrix[range(n), :, range(n)] += np.swapaxes(limits, 1, 2) @ (stiffness[:, :, None] * limits)
    step = -cho_solve(cho_factor(matrix.reshape(n * w, -1)), gradient.ravel()).reshape(n, w)
    after = (weight + SIGNS * multipliers * _times(limits, step)) / here.slacks
    return step, float(np.sum(gradient * step)), after


def _descended(
    function: Function, here: _Point, step: np.ndarray, slope: float, limits: np.ndarray, weight: float
) -> _Point | None:
    """Point after a backtracking line search with the Armijo condition, None if no step length satisfies it.

    A step attains at least 1e-4 of the predicted decrease, and at most .99 of the distance to the nearest limit.
    """
    loss = SIGNS * _times(limits, step)
    length = min(1.0, 0.99 / float((loss / here.slacks).max()))
    before = here.barred(weight)
    for _ in range(12):
        x = here.x + length * step
        there = _Point(x, *function(x), here.slacks - length * loss)
        if there.barred(weight) <= before + 1e-4 * length * slope:
            return there
        length /= 2
    return None


def _updated(B: np.ndarray, s: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Approximate Hessian after a step s that changed the gradient by y, by a damped BFGS update."""
    if np.array_equal(B, np.eye(len(B))) and s @ y > 0:
        B = B * (s @ y) / (s @ s)
    Bs = B @ s
    expected, actual = s @ Bs, s @ y
    if actual < 0.2 * expected:
        part = 0.8 * expected / (expected - actual)
        y = part * y + (1 - part) * Bs
    return np.asarray(B - np.outer(Bs, Bs) / expected + np.outer(y, y) / (s @ y))


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Each block's matrix (n, m, w) times its vector (n, w)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])
