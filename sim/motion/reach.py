"""Ranges of independent joints in which the loops of a mechanism close, and their dependent joints stay in theirs."""

from collections.abc import Mapping

import numpy as np

from ident.errors import InputError
from ident.mechanism.tree import Tree

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
