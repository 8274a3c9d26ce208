"""Motion of a hand that holds the end of an arm: it follows the arm with slow deviations."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Hand:
    """Slow deviations of a hand from the pose of the held body.

    Attributes:
        lift: Constant displacement, m; upwards it supports the arm.
        shift: Amplitudes of the displacement along the world's axes, m.
        shift_frequency: Their frequencies, Hz.
        turn: Amplitudes of the rotation vector, in the axes of the held body, rad.
        turn_frequency: Their frequencies, Hz.
    """

    lift: tuple[float, float, float] = (0.0, 0.0, 0.02)
    shift: tuple[float, float, float] = (0.01, 0.01, 0.01)
    shift_frequency: tuple[float, float, float] = (0.31, 0.43, 0.53)
    turn: tuple[float, float, float] = (0.03, 0.03, 0.03)
    turn_frequency: tuple[float, float, float] = (0.37, 0.47, 0.61)

    def poses(self, time: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses of the hand, from the desired poses of the held body.

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
