"""Choice of the time constant for smoothing angles alone: the one that predicts the fitted channels best."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from ident.estimation.part import Part
from ident.trajectory.from_angles import FromAngles, unexplained, unexplained_anew
from ident.trajectory.pieces import cut
from ident.trajectory.result import TrajectoryEstimate

FIRST, LONGEST = 0.04, 0.5
"""Time constants of smoothing, s: the first to try, a filter at 4 Hz, and the longest."""

STEPS = 1.0, 0.5, 0.25
"""Steps in octaves by which the constant is changed as long as that is better."""

TRIED, COMPARED = 20_000, 1_500
"""Approximate largest numbers of samples for the choice: of angles to smooth, and of channels to compare."""

FAR_BETTER = 0.5
"""Geometric mean of the channels' residuals with columns fitted again, over that of the estimate, below which the
estimate is too poor to choose by."""


def chosen_smoothing(fitted: Sequence[Part[slice]], estimate: TrajectoryEstimate) -> float:
    """Time constant with which angles alone predict the channels of the fitted parts best, s.

    The estimate's parameters predict: columns fitted again for every constant would compensate for accelerations that
    are smoothed too much. Only if these explain far more, because the estimate is poor, do they choose.
    """
    measurement = estimate.measurement
    thetas = [estimate.parameters_of(k) for k in range(len(fitted))]
    every = zip(fitted, estimate.steps, strict=True)
    cuts = [cut(part.log, measurement, part.samples, step, least=1) for part, step in every]
    parts = [(piece, theta) for own, theta in zip(cuts, thetas, strict=True) for piece in own]
    parts = parts[:: -(-sum(len(piece.time) for piece, _ in parts) // TRIED)]
    share = -(-sum(len(piece.when) for piece, _ in parts) // COMPARED)
    thin = [(FromAngles(measurement, piece, share), theta) for piece, theta in parts]

    def left(T: float) -> float:
        return unexplained([piece.compared(T, theta) for piece, theta in thin])

    def left_anew(T: float) -> float:
        every = [piece.compared(T, theta, columns=True) for piece, theta in thin]
        return unexplained_anew(every, measurement.equations.channels)

    finest = min(float(np.median(np.diff(piece.time))) for piece, _ in parts)
    best = _minimised(left, finest)
    return _minimised(left_anew, finest) if left_anew(best) < left(best) + np.log(FAR_BETTER) else best


def _minimised(misfit: Callable[[float], float], finest: float) -> float:
    """Time constant with the least misfit near the first, between the finest and the longest, s."""
    lowest, highest = np.log2(finest / FIRST), np.log2(LONGEST / FIRST)
    tried = cache(lambda octaves: misfit(FIRST * 2**octaves))
    best = float(np.clip(0.0, lowest, highest))
    for step in STEPS:
        better = True
        while better:
            near = min((best, *np.clip([best - step, best + step], lowest, highest).tolist()), key=tried)
            better, best = near != best, near
    return float(FIRST * 2**best)
