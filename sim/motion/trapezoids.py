"""Joint motions of programmed robots: moves from rest to rest with trapezoidal velocities, and rests in between."""

from dataclasses import dataclass

import numpy as np

from ident.errors import InputError
from sim.motion.excitation import Trajectory

REACH = 0.9
"""Largest angle of random moves from the middle, rad: the workspace of an arm without its ends."""

LASTING, RESTING = (0.6, 1.2), (0.05, 0.4)
"""Shortest and longest move and rest, s, for an arm of some kilograms at a brisk pace."""

RAMP = 1 / 3
"""Share of a move for its acceleration, and for its deceleration."""


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
        for name in ("start", "lasting", "goals"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))
        moves = self.start.shape
        if len(moves) != 2 or self.lasting.shape != moves or self.goals.shape != (moves[0], moves[1] + 1):
            raise InputError(
                "Trapezoidal velocities need start (n, k), lasting (n, k) and goals (n, k + 1), got shapes "
                f"{self.start.shape}, {self.lasting.shape} and {self.goals.shape}."
            )
        if not all(np.isfinite(x).all() for x in (self.start, self.lasting, self.goals)):
            raise InputError("Trapezoidal velocities need finite numbers, got NaN or infinity.")
        rests = self.start[:, 1:] - (self.start + self.lasting)[:, :-1]
        if not (self.lasting > 0).all() or not (rests >= 0).all():
            raise InputError(
                "A move with trapezoidal velocity needs to take some time, and to end before the next one."
            )

    @classmethod
    def drawn(cls, rng: np.random.Generator, joints: int, seconds: float) -> "Trapezoids":
        """Random moves between random positions that last at least a given time."""
        moves = int(np.ceil(seconds / (LASTING[0] + RESTING[0]))) + 1
        lasting, resting = (rng.uniform(*limits, size=(joints, moves)) for limits in (LASTING, RESTING))
        ends = np.cumsum(lasting + resting, axis=1)
        return cls(ends - lasting, lasting, rng.uniform(-REACH, REACH, size=(joints, moves + 1)))

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
        rate = 1 / (1 - RAMP)
        rising, falling = u < RAMP, u > 1 - RAMP
        ramp = np.where(falling, 1 - u, u)
        share = np.where(rising | falling, rate / RAMP * ramp**2 / 2, rate * (u - RAMP / 2))
        share = np.where(falling, 1 - share, share)
        speed = rate * np.minimum(1, np.minimum(u, 1 - u) / RAMP)
        moving = (u > 0) & (u < 1)
        bend = rate / RAMP * (rising.astype(float) - falling) * moving
        return before + way * share, way * speed / lasting, way * bend / lasting**2
