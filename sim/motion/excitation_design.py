"""Design of excitations: optimal finite Fourier series within joint limits and free of collisions.

minimise    cost(q, q̇, q̈)      over center and coefficients of a Fourier series
subject to  low ≤ q ≤ high,  |q̇| ≤ velocity,  |q̈| ≤ acceleration,  linear in both,  and no collisions
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ident.errors import InputError
from ident.tolerances import HUGE
from sim.motion.collisions import Collisions, Walls
from sim.motion.interior_point import minimum


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Motions `q = center + B(t) coefficients` of period `duration`, with q̇ = q̈ = 0 at the ends of each period.

    The columns of B are combinations of `sin(kωt)/(kω)` and `cos(kωt)/(kω)`, ω = 2π/duration. A sum of sines
    `a_k sin(kωt)/(kω)` is at rest when `Σ a_k = 0`, one of cosines `b_k cos(kωt)/(kω)` when `Σ k b_k = 0`; the columns
    are orthonormal bases of the solutions of these two conditions. After Swevers et al., Optimal robot excitation and
    identification (1997), whose series is not at rest.

    Attributes:
        duration: Period, s.
        center: Mean joint positions, rad or m (n,).
        coefficients: Coefficients in the unit of the velocities, rad/s or m/s (n, 2 K - 2) for K harmonics.
    """

    duration: float
    center: np.ndarray
    coefficients: np.ndarray

    def __post_init__(self) -> None:
        for name in ("center", "coefficients"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))
        shape = self.coefficients.shape
        if self.center.ndim != 1 or shape[:1] != self.center.shape or len(shape) != 2 or shape[1] % 2 or not shape[1]:
            raise InputError(
                "A Fourier trajectory needs a center (n,) and coefficients (n, 2 K - 2) with K of at least 2, got "
                f"shapes {self.center.shape} and {shape}."
            )
        if not (np.isfinite(self.center).all() and np.isfinite(self.coefficients).all()):
            raise InputError("A Fourier trajectory needs finite numbers, got NaN or infinity.")
        _check_duration(self.duration)

    @property
    def harmonics(self) -> int:
        """Number of harmonics K."""
        return self.coefficients.shape[1] // 2 + 1

    def states(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, velocities and accelerations.

        Args:
            time: Times, s (N,).

        Returns:
            q in rad or m, q̇ and q̈ in these units per s and s², each (N, n).
        """
        q, dq, ddq = basis(self.duration, self.harmonics, time) @ self.coefficients.T
        return self.center + q, dq, ddq

    @classmethod
    def closest(cls, duration: float, harmonics: int, time: np.ndarray, q: np.ndarray) -> "FourierTrajectory":
        """Least-squares fit of a series to sampled positions.

        Args:
            duration: Period, s.
            harmonics: Number of harmonics K.
            time: Times, s (N,).
            q: Positions, rad or m (N, n).
        """
        B = basis(duration, harmonics, time)[0]
        solution = np.linalg.lstsq(np.column_stack([np.ones(len(B)), B]), q, rcond=None)[0]
        return cls(duration, solution[0], solution[1:].T)


def basis(duration: float, harmonics: int, time: np.ndarray) -> np.ndarray:
    """Basis functions of a `FourierTrajectory`, and their first two time derivatives.

    Args:
        duration: Period, s.
        harmonics: Number of harmonics K.
        time: Times, s (N,).

    Returns:
        B, Ḃ and B̈, in s, 1 and 1/s (3, N, 2 K - 2).

    Raises:
        InputError: There are too few harmonics, or the duration is not positive.
    """
    # With fewer, a series that rests at its ends has no free coefficients.
    fewest = 2
    if harmonics < fewest:
        raise InputError(f"A series that starts and ends at rest needs at least {fewest} harmonics, got {harmonics}.")
    _check_duration(duration)
    k = np.arange(1.0, harmonics + 1)
    w = 2 * np.pi * k / duration
    sin, cos = (function(np.asarray(time, float)[:, None] * w) for function in (np.sin, np.cos))
    S, C = _orthogonal_complement(np.ones(harmonics)), _orthogonal_complement(k)
    return np.stack(
        [np.hstack([sin / w @ S, cos / w @ C]), np.hstack([cos @ S, -sin @ C]), np.hstack([-sin * w @ S, -cos * w @ C])]
    )


def _orthogonal_complement(normal: np.ndarray) -> np.ndarray:
    """Orthonormal columns orthogonal to a vector of positive numbers, from its Householder reflection (K, K - 1)."""
    u = normal / np.linalg.norm(normal)
    u[0] += 1
    return (np.eye(len(u)) - np.outer(u, u) / u[0])[:, 1:]


def _check_duration(duration: float) -> None:
    if not 0 < duration < np.inf:
        raise InputError(f"A Fourier trajectory needs a positive duration, got {duration} s.")


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
