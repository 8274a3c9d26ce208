"""Limits of a motion beyond those of its joints: bodies that collide, and loops that cannot close."""

from collections.abc import Mapping

import numpy as np

from ident.errors import InputError
from ident.mechanism.tree import Tree
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


SAMPLES = 200
"""Random postures at which a range is checked, besides its corners: one in a hundred may be missed, not more."""

SHARES = np.linspace(1, 0.05, 20)
"""Shares of a given range that are tried on either side of the rest position."""

STOP = 0.02
"""Share of a dependent joint's range that stays free at each stop."""


def reachable(
    tree: Tree, ranges: Mapping[str, tuple[float, float]], rest: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The largest part of given ranges about a posture in which all loops close, lower and upper limits (n,).

    Args:
        tree: The tree with its closed loops, of hinges and slides.
        ranges: Limits of joints by name, of which those of the dependent ones count.
        rest: Coordinates of the posture (n,), from which ranges are shrunk on either side.
        low: Given lower limits (n,).
        high: Given upper limits (n,).

    Raises:
        InputError: Loops do not close even close to the posture.
    """
    n, rng = len(low), np.random.default_rng(0)
    center = np.clip(rest, low, high)
    corners = np.stack(np.meshgrid(*[[0.0, 1.0]] * min(n, 6)), -1).reshape(-1, min(n, 6))
    # Most ranges that are too large fail in a corner.
    units = np.pad(corners, ((0, 0), (0, n - corners.shape[1])), mode="edge"), rng.random((SAMPLES, n))
    limits = np.array([ranges.get(joint, (-np.inf, np.inf)) for joint in tree.dependent])
    room = np.where(np.isfinite(limits).all(axis=1), STOP * (limits[:, 1] - limits[:, 0]), 0)

    def holds(shares: np.ndarray) -> bool:
        first, last = center + shares[0] * (low - center), center + shares[1] * (high - center)
        return all(fits(first + some * (last - first)) for some in units)

    def fits(q: np.ndarray) -> bool:
        y = tree.dependent_states(q)[0]
        return bool(((y >= limits[:, 0] + room) & (y <= limits[:, 1] - room)).all() and tree.closes(q).all())

    together = next((share for share in SHARES if holds(np.full((2, n), share))), None)
    if together is None:
        raise InputError(
            f"The loops of {', '.join(tree.dependent)} do not close, or leave these joints' ranges, near the rest "
            "position. Give a smaller range with --position, or correct the model's posture."
        )
    shares = np.full((2, n), together)
    for side, k in np.ndindex(2, n):
        for share in SHARES[together < SHARES]:
            wider = shares.copy()
            wider[side, k] = share
            if holds(wider):
                shares = wider
                break
    return center + shares[0] * (low - center), center + shares[1] * (high - center)
