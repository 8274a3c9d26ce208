"""Joint motions as finite Fourier series that start and end at rest, linear in their free coefficients."""

from dataclasses import dataclass

import numpy as np

from ident.errors import InputError

FEWEST = 2
"""Least number of harmonics: with fewer, a series that rests at its ends has no free coefficients."""


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
    if harmonics < FEWEST:
        raise InputError(f"A series that starts and ends at rest needs at least {FEWEST} harmonics, got {harmonics}.")
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
