"""Motions that excite a mechanism: sums of sines with noise, moves with trapezoidal velocities, Fourier series."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ident.annotations import typed
from ident.arguments import is_number
from ident.errors import InputError

Trajectory = tuple[np.ndarray, np.ndarray, np.ndarray]
"""q in rad, q̇ in rad/s and q̈ in rad/s² of samples, each (N, n)."""


class DesiredMotion(Protocol):
    """A motion that servos follow: an `Excitation`, or `sim.motion.excitation.Trapezoids`."""

    @property
    def joints(self) -> int:
        """Number of joints n."""

    def trajectory(self, time: np.ndarray, rng: np.random.Generator | None = None) -> Trajectory:
        """Positions, velocities and accelerations at increasing times, with noise if a generator is given."""

    def with_noise(self, factor: float) -> "DesiredMotion":
        """The motion with noise scaled by a factor."""


def make_arrays(motion: object, what: str, *names: str) -> None:
    """Makes arrays of some fields of a motion.

    Raises:
        InputError: A number is not finite; the message begins with `what` it is of.
    """
    for name in names:
        values = np.asarray(getattr(motion, name), float)
        if not np.isfinite(values).all():
            raise InputError(f"{what} needs finite numbers, got NaN or infinity.")
        object.__setattr__(motion, name, values)


@typed("noise")
@dataclass(frozen=True, eq=False)
class Excitation:
    """Accelerations `q̈ = Σ a sin(2πft + p) + noise`, integrated to velocities and positions.

    The sinusoids are integrated without drift: `q̇ = -Σ a/(2πf) cos(…)`, `q = offset - Σ a/(2πf)² sin(…)`. The noise is
    held over 10 ms and integrated exactly, from rest.

    Attributes:
        offset: Mean joint positions, rad (n,).
        amplitude: Acceleration amplitudes a, rad/s² (n, k).
        frequency: Frequencies f, Hz (n, k).
        phase: Phases p, rad (n, k).
        noise: Standard deviation of the acceleration noise, rad/s².
    """

    offset: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray
    noise: float = 0.0

    def __post_init__(self) -> None:
        make_arrays(self, "An excitation", "offset", "amplitude", "frequency", "phase")
        shapes = {self.amplitude.shape, self.frequency.shape, self.phase.shape}
        if len(shapes) != 1 or self.amplitude.ndim != 2 or self.offset.shape != self.amplitude.shape[:1]:
            raise InputError(
                "An excitation needs offset (n,) and amplitude, frequency and phase (n, k), got shapes "
                f"{self.offset.shape}, {self.amplitude.shape}, {self.frequency.shape} and {self.phase.shape}."
            )
        if not (self.frequency > 0).all():
            raise InputError(f"An excitation needs positive frequencies, got {self.frequency.tolist()} Hz.")
        if not (is_number(self.noise) and 0 <= self.noise < np.inf):
            raise InputError(f"Acceleration noise needs a standard deviation of zero or more, got {self.noise} rad/s².")

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.offset)

    def with_noise(self, factor: float) -> "Excitation":
        """The excitation with acceleration noise scaled by a factor."""
        return replace(self, noise=factor * self.noise)

    def trajectory(self, time: np.ndarray, rng: np.random.Generator | None = None) -> Trajectory:
        """Positions, velocities and accelerations.

        Args:
            time: Increasing times, s (N,). The noise starts at zero.
            rng: Generator of the acceleration noise; without it there is none.

        Returns:
            q in rad, q̇ in rad/s, q̈ in rad/s², each (N, n).
        """
        w = 2 * np.pi * self.frequency
        angle = w[:, :, None] * np.asarray(time) + self.phase[:, :, None]
        sin, cos = np.sin(angle), np.cos(angle)
        q = self.offset - np.einsum("nk,nkt->tn", self.amplitude / w**2, sin)
        dq = -np.einsum("nk,nkt->tn", self.amplitude / w, cos)
        ddq = np.einsum("nk,nkt->tn", self.amplitude, sin)
        if rng is None:
            return q, dq, ddq
        noise = self._integrated_noise(time, rng)
        return q + noise[0], dq + noise[1], ddq + noise[2]

    def _integrated_noise(self, time: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
        h = 0.01
        time = np.asarray(time)
        interval = np.floor(np.maximum(time, 0) / h + 1e-6).astype(int)
        a = self.noise * rng.normal(size=(interval[-1] + 1, len(self.offset)))
        start = np.zeros_like(a[:1])
        v = np.concatenate([start, np.cumsum(a * h, axis=0)])[:-1]
        x = np.concatenate([start, np.cumsum(v * h + a * h**2 / 2, axis=0)])[:-1]
        s = (time - interval * h)[:, None]
        a, v, x = (np.where(time[:, None] < 0, 0, y[interval]) for y in (a, v, x))
        return x + v * s + a * s**2 / 2, v + a * s, a


DOUBLE_PENDULUM = Excitation(
    offset=np.array([-1.006, 1.124]),
    amplitude=np.array([[0.901, 1.378], [5.002, 1.406]]),
    frequency=np.array([[0.374, 0.189], [0.396, 0.801]]),
    phase=np.array([[0.540, 6.002], [3.544, 5.862]]),
    noise=0.02,
)
"""Excitation of the paper's double pendulum. The paper prints none; these values were fitted to its two condition
numbers and to the simplified column of Table III, and rounded. The level of the acceleration noise is our choice."""

BOWING = Excitation(
    offset=np.array([-0.05, 0.45]),
    amplitude=np.array([[0.35, 0.50], [1.20, 1.60]]),
    frequency=np.array([[0.23, 0.41], [0.31, 0.57]]),
    phase=np.array([[0.30, 1.90], [2.50, 0.70]]),
)
"""Excitation of the scene `bowing`, at ankle and hip: slow, by some 25° and 50°."""


LASTING, RESTING = (0.6, 1.2), (0.05, 0.4)
"""Shortest and longest move and rest, s, for an arm of some kilograms at a brisk pace."""


@dataclass(frozen=True, eq=False)
class Trapezoids:
    """Successive moves of each joint: a third acceleration, a third constant velocity, a third deceleration.

    Accelerations jump four times per move, at times that differ between joints.

    Attributes:
        start: Start times of the moves, s, increasing (n, k).
        lasting: Durations of the moves, s, which end before the next one starts (n, k).
        goals: Positions before the first and after each move, rad (n, k + 1).
    """

    start: np.ndarray
    lasting: np.ndarray
    goals: np.ndarray

    def __post_init__(self) -> None:
        make_arrays(self, "A motion with trapezoidal velocities", "start", "lasting", "goals")
        moves = self.start.shape
        if len(moves) != 2 or self.lasting.shape != moves or self.goals.shape != (moves[0], moves[1] + 1):
            raise InputError(
                "Trapezoidal velocities need start (n, k), lasting (n, k) and goals (n, k + 1), got shapes "
                f"{self.start.shape}, {self.lasting.shape} and {self.goals.shape}."
            )
        rests = self.start[:, 1:] - (self.start + self.lasting)[:, :-1]
        if not (self.lasting > 0).all() or not (rests >= 0).all():
            raise InputError(
                "A move with trapezoidal velocity needs to take some time, and to end before the next one."
            )

    @classmethod
    def drawn(cls, rng: np.random.Generator, joints: int, seconds: float) -> "Trapezoids":
        """Random moves between random positions that last at least a given time.

        Positions are within 0.9 rad of the middle: the workspace of an arm without its ends.
        """
        moves = int(np.ceil(seconds / (LASTING[0] + RESTING[0]))) + 1
        lasting, resting = (rng.uniform(*limits, size=(joints, moves)) for limits in (LASTING, RESTING))
        ends = np.cumsum(lasting + resting, axis=1)
        return cls(ends - lasting, lasting, rng.uniform(-0.9, 0.9, size=(joints, moves + 1)))

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.start)

    def with_noise(self, factor: float) -> "Trapezoids":
        """The motion itself, as it has no noise."""
        return self

    def trajectory(self, time: np.ndarray, rng: np.random.Generator | None = None) -> Trajectory:
        """Positions, velocities and accelerations, at rest before the first move and after the last.

        Args:
            time: Times, s (N,).
            rng: Not used; these motions have no noise.

        Returns:
            q in rad, q̇ in rad/s, q̈ in rad/s², each (N, n).
        """
        states = [self._of_joint(j, np.asarray(time, float)) for j in range(self.joints)]
        q, dq, ddq = (np.stack(each, axis=1) for each in zip(*states, strict=True))
        return q, dq, ddq

    def _of_joint(self, joint: int, time: np.ndarray) -> Trajectory:
        """Position, velocity and acceleration of one joint, each (N,)."""
        move = np.maximum(np.searchsorted(self.start[joint], time, side="right") - 1, 0)
        begin, lasting = self.start[joint, move], self.lasting[joint, move]
        before, way = self.goals[joint, move], np.diff(self.goals[joint])[move]
        u = np.clip((time - begin) / lasting, 0, 1)
        # In units of a move: constant velocity between the two ramps.
        part = 1 / 3
        rate = 1 / (1 - part)
        rising, falling = u < part, u > 1 - part
        ramp = np.where(falling, 1 - u, u)
        share = np.where(rising | falling, rate / part * ramp**2 / 2, rate * (u - part / 2))
        share = np.where(falling, 1 - share, share)
        speed = rate * np.minimum(1, np.minimum(u, 1 - u) / part)
        moving = (u > 0) & (u < 1)
        bend = rate / part * (rising.astype(float) - falling) * moving
        return before + way * share, way * speed / lasting, way * bend / lasting**2


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
        make_arrays(self, "A Fourier trajectory", "center", "coefficients")
        shape = self.coefficients.shape
        if self.center.ndim != 1 or shape[:1] != self.center.shape or len(shape) != 2 or shape[1] % 2 or not shape[1]:
            raise InputError(
                "A Fourier trajectory needs a center (n,) and coefficients (n, 2 K - 2) with K of at least 2, got "
                f"shapes {self.center.shape} and {shape}."
            )
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
