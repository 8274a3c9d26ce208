"""Friction and rotor inertias are not negative: what a recording wants below zero is held there, at its bound.

The conditions of a minimum under bounds are those of Karush, Kuhn and Tucker: what is held at zero would be negative if
it were free.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ident.estimation.joint_fit import JointFit, Start

Solve = Callable[..., JointFit]
"""Fits from a start, the parameters of a mask `free` (p,) alone, in at most so many `rounds`."""


def with_positive(solve: Solve, drives: np.ndarray, begin: Start, free: np.ndarray, rounds: int) -> JointFit:
    """A fit with none of the drives below zero.

    Args:
        solve: Makes fits without that condition.
        drives: Mask of the drives (p,).
        begin: Where to begin.
        free: Parameters to fit (p,); drives among the others may be freed.
        rounds: Rounds of each fit.
    """
    fit = _bounded(solve, drives, begin, free, rounds)
    # A drive that is negative beside others that are may be positive without them.
    untried = drives.copy()
    while rounds and (gains := _gains(fit, untried & ~fit.free)).any():
        best = np.arange(len(drives)) == np.argmax(gains)
        untried &= ~best
        fit = _bounded(solve, drives, fit.end, fit.free | best, rounds)
    return replace(fit, bounded=drives & ~fit.free)


def _bounded(solve: Solve, drives: np.ndarray, begin: Start, free: np.ndarray, rounds: int) -> JointFit:
    """A fit with drives that come out negative held at zero."""
    fit = solve(begin, free=free, rounds=rounds)
    while fit.status != "interrupted" and (negative := drives & fit.free & (fit.theta < 0)).any():
        theta = np.where(negative, 0.0, fit.theta)
        fit = solve(replace(fit.end, theta=theta), free=fit.free & ~negative, rounds=rounds)
    return fit


def _gains(fit: JointFit, held: np.ndarray) -> np.ndarray:
    """Decrease of the cost if one parameter that is held at zero was free, zero where it would be negative (p,)."""
    gains = np.zeros(len(held))
    if fit.shares and fit.status != "interrupted":
        values, std = replace(fit, scatters=None).scores(np.eye(len(held))[held])
        gains[held] = np.where(values > 0, (values / std) ** 2, 0.0)
    return gains
