"""How a hand moves that holds the end of an arm: along with it, but with a will of its own."""

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Hand:
    """Slow wandering of a hand about the pose that it holds.

    Attributes:
        lift: Constant displacement, m; upwards it supports the arm.
        shift: Amplitudes of the wandering along the world's axes, m.
        shift_frequency: Their frequencies, Hz.
        turn: Amplitudes of a wandering rotation vector, rad.
        turn_frequency: Their frequencies, Hz.
    """

    lift: tuple[float, float, float] = (0.0, 0.0, 0.02)
    shift: tuple[float, float, float] = (0.01, 0.01, 0.01)
    shift_frequency: tuple[float, float, float] = (0.31, 0.43, 0.53)
    turn: tuple[float, float, float] = (0.03, 0.03, 0.03)
    turn_frequency: tuple[float, float, float] = (0.37, 0.47, 0.61)

    def pose(self, time: float, position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pose of the hand when what it holds ought to be at a pose.

        Args:
            time: Time in s.
            position: Desired position of the held body, m (3,).
            quaternion: Its desired orientation, w, x, y, z (4,).

        Returns:
            Position and quaternion of the hand.
        """
        shift = np.array(self.shift) * np.sin(2 * np.pi * np.array(self.shift_frequency) * time)
        turn = np.array(self.turn) * np.sin(2 * np.pi * np.array(self.turn_frequency) * time)
        turned = quaternion.copy()
        mujoco.mju_quatIntegrate(turned, turn, 1.0)
        return position + np.array(self.lift) + shift, turned
