"""Comparable times: taken in turns, in one process."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from experiments.data import paper
from ident.model import compiled

MOST = 51
"""Largest number of repetitions."""


@dataclass(frozen=True)
class Effort:
    """Durations and sizes of the measurements.

    Attributes:
        seconds: Shortest time of all repetitions of one comparison.
        least: Smallest number of repetitions.
        sizes: Numbers of samples N, increasing.
        streamed: Number of samples of the longest stream.
        trials: Monte Carlo trials.
        samples: Samples of a simulated recording.
        bodies: Numbers of bodies of arms, increasing.
        linearised: Samples of a linearisation of the trajectory estimate.
    """

    seconds: float = 0.5
    least: int = 3
    sizes: tuple[int, ...] = (1000, 10_000, 100_000)
    streamed: int = 1_000_000
    trials: int = 1000
    samples: int = paper.SAMPLES
    bodies: tuple[int, ...] = (3, 10, 30, 100, 300)
    linearised: int = 200


QUICK = Effort(0.01, 3, (100, 300), 5000, 20, 50, (3, 10), 50)
"""Enough to check that everything runs."""


@dataclass(frozen=True)
class Comparison:
    """Times of two ways to the same result.

    Attributes:
        task: Name of the task.
        mechanism: Name of the mechanism.
        bodies: Its number of bodies b.
        samples: Number of samples N.
        peer: Name of the other library.
        ours: Median of our times, s.
        theirs: Median of theirs, s.
        numpy: Median of ours without compiled code, s; None where there is none.
        ratio: Ratio of the medians, theirs to ours.
        lowest: Smallest ratio of neighbouring repetitions.
        highest: Largest ratio of neighbouring repetitions.
        repetitions: Number of repetitions.
    """

    task: str
    mechanism: str
    bodies: int
    samples: int
    peer: str
    ours: float
    theirs: float
    numpy: float | None
    ratio: float
    lowest: float
    highest: float
    repetitions: int

    @classmethod
    def of(cls, task: str, mechanism: str, bodies: int, samples: int, peer: str, times: np.ndarray) -> "Comparison":
        """Comparison from alternating times, s (repetitions, 2 or 3): ours, theirs and, if compiled, ours without."""
        ours, theirs, *numpy = np.median(times, axis=0).tolist()
        plain = numpy[0] if numpy else None
        return cls(task, mechanism, bodies, samples, peer, ours, theirs, plain, *ratio(times[:, :2]), len(times))


def with_and_without(ours: Callable[[], object], theirs: Callable[[], object]) -> list[Callable[[], object]]:
    """Our way, theirs and, if there is compiled code, ours without it."""

    def plain() -> object:
        with compiled.switched(False):
            return ours()

    return [ours, theirs, plain] if compiled.available() else [ours, theirs]


def alternating(ways: Sequence[Callable[[], object]], seconds: float, least: int) -> np.ndarray:
    """Times of several ways in turns, after one warm-up of each, s (repetitions, ways)."""
    for way in ways:
        way()
    rounds: list[list[float]] = []
    start = time.perf_counter()
    while len(rounds) < least or (time.perf_counter() - start < seconds and len(rounds) < MOST):
        rounds.append([timed(way) for way in ways])
    return np.array(rounds)


def timed(way: Callable[[], object]) -> float:
    """Seconds of one call, without the deallocation of its result."""
    start = time.perf_counter()
    result = way()
    took = time.perf_counter() - start
    del result
    return took


def ratio(times: np.ndarray) -> tuple[float, float, float]:
    """Ratio of the second median to the first, and the extremes of the repetitions' ratios; times (repetitions, 2)."""
    first, second = np.median(times, axis=0)
    each = times[:, 1] / times[:, 0]
    return float(second / first), float(each.min()), float(each.max())
