"""The search for motions that excite well, inside joint limits and free of collisions.

minimise    cost(q, q̇, q̈) + w · mean depth of collisions        over center and coefficients of a Fourier series
subject to  low ≤ q ≤ high,  |q̇| ≤ velocity,  |q̈| ≤ acceleration,  linear in both
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from scipy.optimize import minimize

from ident.errors import InputError
from ident.tolerances import HUGE
from sim.motion.collisions import Collisions
from sim.motion.fourier import FourierTrajectory, basis

Cost: TypeAlias = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""What to make small: from q, q̇ and q̈ of P candidate motions (P, G, n) to P numbers."""

PER_PERIOD = 12
"""Samples for each period of the fastest harmonic during the search."""

PER_PERIOD_CHECKED = 200
"""The same when a motion is scaled into its limits: the peaks between two samples are higher by 1.3e-4 at most."""

FEWEST_SAMPLES = 100
"""Samples of a motion during the search, at least."""

PENALTIES = (10.0, 100.0, 1000.0)
"""Costs of running 1 m into something all the time, tried in turn until nothing touches."""

STEP = 1e-6
"""Step of the finite differences, as a fraction of the limits."""


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
        """Largest fraction of any limit that each joint uses, above 1 beyond it (n,).

        Args:
            q: Positions (N, n); `dq` and `ddq` velocities and accelerations.
        """
        fractions = (q - self.middle) / self.half_range, dq / self.velocity, ddq / self.acceleration
        return np.max([abs(x).max(axis=0) for x in fractions], axis=0)


def scaled_into(trajectory: FourierTrajectory, limits: Limits) -> FourierTrajectory:
    """The trajectory with every joint that violates a limit shrunk towards the middle of its range."""
    time = np.linspace(0, trajectory.duration, PER_PERIOD_CHECKED * trajectory.harmonics + 1)
    # The margin covers what lies between two samples.
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
        rng: Source of the coefficients.
        center: Positions to move about, kept off the limits (n,); by default drawn as well.
    """
    n = len(limits.low)
    drawn = limits.middle + rng.uniform(-0.5, 0.5, n) * limits.half_range
    center = drawn if center is None else center
    inside = np.clip(center, limits.middle - 0.8 * limits.half_range, limits.middle + 0.8 * limits.half_range)
    coefficients = rng.normal(size=(n, 2 * harmonics - 2)) * limits.velocity[:, None]
    swing = FourierTrajectory(duration, np.zeros(n), coefficients)
    # About its own center the motion has the room to the nearer limit.
    room = limits.half_range - abs(inside - limits.middle)
    swing = scaled_into(swing, Limits(-room, room, limits.velocity, limits.acceleration))
    return replace(swing, center=inside)


def design(
    cost: Cost,
    limits: Limits,
    start: FourierTrajectory,
    *,
    collisions: Collisions | None = None,
    iterations: int = 100,
) -> FourierTrajectory | None:
    """The best motion that sequential quadratic programming finds from a start.

    Limits are linear in the coefficients and hold all along; collisions are penalised only if the best motion without
    regard to them has some, then at twice the clearance.

    Args:
        cost: What to make small.
        limits: Joint limits.
        start: Where to begin; its duration and number of harmonics stay.
        collisions: What must not touch; by default nothing is checked.
        iterations: Iterations at most, each time.

    Returns:
        A motion strictly inside the limits, or None if all that was found collides.
    """
    search = _Search(cost, limits, start.duration, start.harmonics, collisions)
    found = search.run(scaled_into(start, limits), 0.0, iterations)
    for weight in PENALTIES:
        if collisions is None or not search.collides(found):
            return found
        found = search.run(found, weight, iterations)
    return None if search.collides(found) else found


class _Search:
    """One problem in scaled variables: `x = [(center - middle)/half_range, coefficients/velocity]` of every joint."""

    def __init__(
        self, cost: Cost, limits: Limits, duration: float, harmonics: int, collisions: Collisions | None
    ) -> None:
        self.cost, self.limits, self.duration, self.collisions = cost, limits, duration, collisions
        samples = max(FEWEST_SAMPLES, PER_PERIOD * harmonics)
        B = basis(duration, harmonics, np.arange(samples) * duration / samples)
        n, width = len(limits.low), B.shape[2] + 1
        self.shape = n, width
        # q - middle, q̇ and q̈ of joint j are maps[:, :, j] @ x[j].
        self.maps = np.zeros((3, samples, n, width))
        self.maps[0, :, :, 0] = limits.half_range
        self.maps[:, :, :, 1:] = B[:, :, None, :] * limits.velocity[:, None]
        scale = np.stack([limits.half_range, limits.velocity, limits.acceleration])
        blocks = np.zeros((3, samples, n, n, width))
        blocks[:, :, range(n), range(n)] = self.maps / scale[:, None, :, None]
        rows = blocks.reshape(-1, n * width)
        self.rows = np.vstack([rows, -rows])

    def run(self, start: FourierTrajectory, weight: float, iterations: int) -> FourierTrajectory:
        """The better one of a start and what is found from it."""
        x = np.column_stack(
            [
                (start.center - self.limits.middle) / self.limits.half_range,
                start.coefficients / self.limits.velocity[:, None],
            ]
        ).ravel()
        inside = {"type": "ineq", "fun": lambda x: 1 - self.rows @ x, "jac": lambda x: -self.rows}
        result = minimize(
            self.value_and_gradient,
            x,
            args=(weight,),
            jac=True,
            method="SLSQP",
            constraints=inside,
            options={"maxiter": iterations},
        )
        candidates = [start]
        if np.isfinite(result.x).all():
            candidates.insert(0, scaled_into(self.trajectory(result.x), self.limits))
        return min(candidates, key=lambda found: self.value(found, weight))

    def trajectory(self, x: np.ndarray) -> FourierTrajectory:
        """The motion of scaled variables."""
        x = x.reshape(self.shape)
        limits = self.limits
        center = limits.middle + limits.half_range * x[:, 0]
        return FourierTrajectory(self.duration, center, x[:, 1:] * limits.velocity[:, None])

    def value(self, found: FourierTrajectory, weight: float) -> float:
        """Cost and penalty of a motion, on the search's samples."""
        samples = self.maps.shape[1]
        states = found.states(np.arange(samples) * self.duration / samples)
        value = float(self.cost(*(state[None] for state in states))[0])
        return value + weight * self.depths(states[0]).mean() if weight else value

    def value_and_gradient(self, x: np.ndarray, weight: float) -> tuple[float, np.ndarray]:
        """Cost and penalty, differentiated by differences: the cost in x, the penalty in the joints' positions."""
        candidates = np.vstack([x, x + STEP * np.eye(len(x))]).reshape(-1, *self.shape)
        q, dq, ddq = np.einsum("dgjw,pjw->dpgj", self.maps, candidates, optimize=True)
        q += self.limits.middle
        values = self.cost(q, dq, ddq)
        value, gradient = float(values[0]), (values[1:] - values[0]) / STEP
        if weight:
            depth, slope = self.depth_and_slope(q[0])
            value += weight * depth
            gradient += weight * np.einsum("gj,gjw->jw", slope, self.maps[0]).ravel()
        return value, gradient

    def depths(self, q: np.ndarray) -> np.ndarray:
        """Depths of collisions at twice the clearance, m (G,)."""
        assert self.collisions is not None
        return self.collisions.depth(q, 2 * self.collisions.clearance)

    def depth_and_slope(self, q: np.ndarray) -> tuple[float, np.ndarray]:
        """Mean depth of collisions, m, and its derivatives by the positions (G, n)."""
        depth, slope = self.depths(q), np.zeros_like(q)
        touching = np.flatnonzero(depth)
        for j, half_range in enumerate(self.limits.half_range):
            step = np.zeros(q.shape[1])
            step[j] = STEP * half_range
            both = [self.depths(q[touching] + sign * step) for sign in (1, -1)]
            slope[touching, j] = (both[0] - both[1]) / (2 * step[j])
        return float(depth.mean()), slope / len(q)

    def collides(self, found: FourierTrajectory) -> bool:
        """Whether a motion comes closer than the clearance anywhere, finely sampled."""
        assert self.collisions is not None
        time = np.linspace(0, self.duration, 4 * self.maps.shape[1] + 1)
        return bool(self.collisions.depth(found.states(time)[0]).any())
