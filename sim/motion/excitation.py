"""Joint motions that excite the inertial parameters: sums of sinusoids in acceleration, integrated."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ident.annotations import typed
from ident.arguments import is_number
from ident.errors import InputError

NOISE_INTERVAL = 0.01
"""Interval in s over which a sample of acceleration noise is held."""


Trajectory = tuple[np.ndarray, np.ndarray, np.ndarray]
"""q in rad, q̇ in rad/s and q̈ in rad/s² of samples, each (N, n)."""


class DesiredMotion(Protocol):
    """A motion that servos follow: an `Excitation`, or `sim.motion.trapezoids.Trapezoids`."""

    @property
    def joints(self) -> int:
        """Number of joints n."""

    def trajectory(self, time: np.ndarray, rng: np.random.Generator | None = None) -> Trajectory:
        """Positions, velocities and accelerations at increasing times, with noise if a generator is given."""

    def with_noise(self, factor: float) -> "DesiredMotion":
        """The motion with noise scaled by a factor."""


@typed("noise")
@dataclass(frozen=True, eq=False)
class Excitation:
    """Accelerations `q̈ = Σ a sin(2πft + p) + noise`, integrated to velocities and positions.

    The sinusoids are integrated without drift: `q̇ = -Σ a/(2πf) cos(…)`, `q = offset - Σ a/(2πf)² sin(…)`. The noise is
    held over `NOISE_INTERVAL` and integrated exactly, from rest.

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
        for name in ("offset", "amplitude", "frequency", "phase"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float))
        shapes = {self.amplitude.shape, self.frequency.shape, self.phase.shape}
        if len(shapes) != 1 or self.amplitude.ndim != 2 or self.offset.shape != self.amplitude.shape[:1]:
            raise InputError(
                "An excitation needs offset (n,) and amplitude, frequency and phase (n, k), got shapes "
                f"{self.offset.shape}, {self.amplitude.shape}, {self.frequency.shape} and {self.phase.shape}."
            )
        if not all(np.isfinite(x).all() for x in (self.offset, self.amplitude, self.frequency, self.phase)):
            raise InputError("An excitation needs finite numbers, got NaN or infinity.")
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
        h = NOISE_INTERVAL
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
