"""Barrier against collisions in the design of motions, and shrinking of motions that collide.

With d the distances below `far` at a time t, and c the distance of the walls, at which it is infinite, the barrier is

    b = 1/N Σ_t Σ_d (far - d)²/((d - c) far),     zero with its slope if all distances are larger.
"""

import numpy as np

from sim.motion.collisions import Collisions

THICK = 1.1
"""Distance of the walls in clearances: more than 1, because bodies come slightly closer between two times."""

FAR = 4.0
"""Distance in clearances below which the barrier is not zero."""

WEIGHT = 0.03
"""Weight of the barrier relative to costs, which are logarithms."""

POSTURES, HALVINGS = 6, 5
"""Number of postures about which a motion that collides is shrunk, and of bisections for the factor."""

ROOM = 0.9
"""Largest factor of a shrunk motion, so that it is strictly inside all limits too."""


class Walls:
    """Collisions of a motion as a function of its variables x (n, w)."""

    def __init__(self, collisions: Collisions, maps: np.ndarray, middle: np.ndarray, half_range: np.ndarray) -> None:
        """Sets up the walls.

        Args:
            collisions: Collisions to avoid.
            maps: Matrices from the variables of each joint to its positions relative to `middle` at N times (n, N, w);
                the first variable is the mean position in units of `half_range`.
            middle: Positions for x = 0 (n,).
            half_range: Units of the first variables (n,).
        """
        self.collisions, self.maps, self.middle, self.half_range = collisions, maps, middle, half_range

    def hit(self, x: np.ndarray) -> bool:
        """True if bodies come closer than the clearance at one of the times."""
        return bool(self.collisions.depth(self._positions(x)).any())

    def barrier(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        """The weighted barrier and its derivatives by the variables (n, w); infinite behind a wall."""
        clearance = self.collisions.clearance
        value, slope = self.collisions.barrier_and_slope(self._positions(x), THICK * clearance, FAR * clearance)
        each = WEIGHT / self.maps.shape[1]
        return each * value, each * np.einsum("gj,jgw->jw", slope, self.maps)

    def shrunk(self, x: np.ndarray) -> np.ndarray | None:
        """The motion shrunk about one of its postures as little as needed to avoid all walls (n, w), or None."""
        q, clearance = self._positions(x), self.collisions.clearance
        free = q[self.collisions.depth(q, THICK * clearance) == 0]
        # Postures with the largest distances first, by the depth below `FAR`.
        free = free[np.argsort(self.collisions.depth(free, FAR * clearance), kind="stable")]
        roomy = free[: max(POSTURES, len(free) // 2)]
        best, largest = None, 0.0
        for posture in roomy[np.unique(np.linspace(0, len(roomy) - 1, POSTURES).astype(int))] if len(roomy) else ():
            center = np.zeros_like(x)
            center[:, 0] = (posture - self.middle) / self.half_range
            part = self._part(x, center)
            if part > largest:
                best, largest = center + part * (x - center), part
        return best

    def _part(self, x: np.ndarray, center: np.ndarray) -> float:
        """Largest factor of a motion about a posture, by bisection."""
        low, high = 0.0, ROOM
        for _ in range(HALVINGS):
            part = (low + high) / 2
            q = self._positions(center + part * (x - center))
            touches = self.collisions.depth(q, THICK * self.collisions.clearance).any()
            low, high = (low, part) if touches else (part, high)
        return low

    def _positions(self, x: np.ndarray) -> np.ndarray:
        return np.asarray((self.maps @ x[:, :, None])[..., 0].T) + self.middle
