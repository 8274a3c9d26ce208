"""How a hand moves that holds the end of an arm: along with it, but with a will of its own."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Hand:
    """Slow wandering of a hand about the pose that it holds.

    Attributes:
        lift: Constant displacement, m; upwards it supports the arm.
        shift: Amplitudes of the wandering along the world's axes, m.
        shift_frequency: Their frequencies, Hz.
        turn: Amplitudes of a wandering rotation vector, in the axes of what it holds, rad.
        turn_frequency: Their frequencies, Hz.
    """

    lift: tuple[float, float, float] = (0.0, 0.0, 0.02)
    shift: tuple[float, float, float] = (0.01, 0.01, 0.01)
    shift_frequency: tuple[float, float, float] = (0.31, 0.43, 0.53)
    turn: tuple[float, float, float] = (0.03, 0.03, 0.03)
    turn_frequency: tuple[float, float, float] = (0.37, 0.47, 0.61)

    def poses(self, time: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses of the hand when what it holds ought to be at poses.

        Args:
            time: Times in s (N,).
            position: Desired positions of the held body, m (N, 3).
            quaternion: Its desired orientations, w, x, y, z (N, 4).

        Returns:
            Positions and quaternions of the hand.
        """
        shift = np.array(self.shift) * np.sin(2 * np.pi * np.outer(time, self.shift_frequency))
        turn = np.array(self.turn) * np.sin(2 * np.pi * np.outer(time, self.turn_frequency))
        turned = _product(quaternion, Rotation.from_rotvec(turn).as_quat(scalar_first=True))
        return position + np.array(self.lift) + shift, turned


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of quaternions (N, 4)."""
    scalar = a[:, :1] * b[:, :1] - np.sum(a[:, 1:] * b[:, 1:], axis=1, keepdims=True)
    return np.hstack([scalar, a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])])
