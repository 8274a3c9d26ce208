"""Collisions as walls of a search for motions: a barrier that rises without limit, and ways back from behind it.

With d the distances of what is closer than `far` at a time t, and c that of the walls, the barrier is

    b = 1/N Σ_t Σ_d (far - d)²/((d - c) far),     zero with its slope where everything is farther.
"""

import numpy as np

from sim.motion.collisions import Collisions

THICK = 1.1
"""Distance of the walls in clearances: more than 1, since between two times bodies come a little closer."""

FAR = 4.0
"""Distance in clearances at which walls begin to be felt."""

WEIGHT = 0.03
"""Weight of the barrier against costs that are logarithms."""

POSTURES, HALVINGS = 6, 5
"""Postures that a motion which collides is shrunk about, and how often the part that stays of it is halved."""

ROOM = 0.9
"""Part of a motion that stays at most, so that it leaves all limits too."""


class Walls:
    """What the variables x (n, w) of a motion must not let touch."""

    def __init__(self, collisions: Collisions, maps: np.ndarray, middle: np.ndarray, half_range: np.ndarray) -> None:
        """Sets up the walls.

        Args:
            collisions: What must not touch.
            maps: What takes the variables of each joint to its positions from `middle` at N times (n, N, w); the first
                one of them counts in parts of the range.
            middle: Positions where x is zero (n,).
            half_range: What the first variables count in (n,).
        """
        self.collisions, self.maps, self.middle, self.half_range = collisions, maps, middle, half_range

    def hit(self, x: np.ndarray) -> bool:
        """Whether bodies come closer than the clearance at one of the times."""
        return bool(self.collisions.depth(self._positions(x)).any())

    def barrier(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """The weighted barrier and its derivatives by the variables (n, w); infinite behind a wall."""
        clearance = self.collisions.clearance
        value, slope = self.collisions.barrier_and_slope(self._positions(x), THICK * clearance, FAR * clearance)
        each = WEIGHT / self.maps.shape[1]
        return each * value, each * np.einsum("gj,jgw->jw", slope, self.maps)

    def shrunk(self, x: np.ndarray) -> np.ndarray | None:
        """The largest part of a motion, about one of its postures, in front of all walls (n, w), or None."""
        q, clearance = self._positions(x), self.collisions.clearance
        free = q[self.collisions.depth(q, THICK * clearance) == 0]
        # Those with most room, which is counted as far as walls are felt.
        free = free[np.argsort(self.collisions.depth(free, FAR * clearance), kind="stable")]
        roomy = free[: max(POSTURES, len(free) // 2)]
        found, largest = None, 0.0
        for posture in roomy[np.unique(np.linspace(0, len(roomy) - 1, POSTURES).astype(int))] if len(roomy) else ():
            center = np.zeros_like(x)
            center[:, 0] = (posture - self.middle) / self.half_range
            part = self._part(x, center)
            if part > largest:
                found, largest = center + part * (x - center), part
        return found

    def _part(self, x: np.ndarray, center: np.ndarray) -> float:
        """How much of a motion may stay about a posture."""
        low, high = 0.0, ROOM
        for _ in range(HALVINGS):
            part = (low + high) / 2
            q = self._positions(center + part * (x - center))
            touches = self.collisions.depth(q, THICK * self.collisions.clearance).any()
            low, high = (low, part) if touches else (part, high)
        return low

    def _positions(self, x: np.ndarray) -> np.ndarray:
        return np.asarray((self.maps @ x[:, :, None])[..., 0].T) + self.middle
