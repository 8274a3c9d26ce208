"""Fits with friction and rotor inertias bounded below by zero.

At a minimum under bounds (conditions of Karush, Kuhn and Tucker) each parameter at zero would be negative if it were
free.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ident.trajectory.fit.fitted import Start, TrajectoryFit

Solve = Callable[..., TrajectoryFit]
"""Function that fits the parameters of a mask `free` (p,) from a start, in at most `rounds` rounds."""


def with_positive(solve: Solve, drives: np.ndarray, begin: Start, free: np.ndarray, rounds: int) -> TrajectoryFit:
    """Fit with no drive below zero.

    After the largest number of rounds no drive is freed again: the fit that goes on from there does that.

    Args:
        solve: Function that fits without bounds.
        drives: Mask of the drives (p,).
        begin: Starting point.
        free: Mask of the parameters to fit (p,); other drives may be freed.
        rounds: Largest number of rounds of each fit.
    """
    fit = _bounded(solve, drives, begin, free, rounds)
    # A drive that is negative while others are negative too may be positive once these are zero.
    untried = drives.copy()
    while rounds and fit.status != "stopped" and (gains := _gains(fit, untried & ~fit.free)).any():
        best = np.arange(len(drives)) == np.argmax(gains)
        untried &= ~best
        fit = _bounded(solve, drives, fit.end, fit.free | best, rounds)
    return replace(fit, bounded=drives & ~fit.free)


def _bounded(solve: Solve, drives: np.ndarray, begin: Start, free: np.ndarray, rounds: int) -> TrajectoryFit:
    """Fit with drives that come out negative fixed at zero."""
    fit = solve(begin, free=free, rounds=rounds)
    while fit.status != "interrupted" and (negative := drives & fit.free & (fit.theta < 0)).any():
        theta = np.where(negative, 0.0, fit.theta)
        fit = solve(replace(fit.end, theta=theta), free=fit.free & ~negative, rounds=rounds)
    return fit


def _gains(fit: TrajectoryFit, held: np.ndarray) -> np.ndarray:
    """Decrease of the cost if one parameter at zero were free, zero if it would be negative (p,)."""
    gains = np.zeros(len(held))
    if fit.shares and fit.status != "interrupted":
        values, std = replace(fit, scatters=None).scores(np.eye(len(held))[held])
        gains[held] = np.where(values > 0, (values / std) ** 2, 0.0)
    return gains
