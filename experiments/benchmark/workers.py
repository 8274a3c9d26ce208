"""Speedup of work that is shared by several processes."""

import os
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

import numpy as np

from experiments.benchmark.mechanisms import double_pendulum
from experiments.benchmark.monte_carlo import BLOCKS, Trials
from experiments.benchmark.timing import Effort, alternating
from experiments.runs.workers import WorkerPool, worker_pool
from ident.estimation.pieces import in_order
from ident.regression.ordinary import least_squares


@dataclass(frozen=True)
class Shared:
    """Speed of work that several processes share.

    Attributes:
        task: Name of the work.
        workers: Number of processes.
        seconds: Median time.
        rate: Trials or samples per second.
        speedup: Ratio of one process's median time to this one.
    """

    task: str
    workers: int
    seconds: float
    rate: float
    speedup: float


def shared(effort: Effort) -> list[Shared]:
    """Speed of Monte Carlo trials and of one long identification, with 1, 2, 4, … processes up to the cores."""
    numbers = [2**k for k in range((os.cpu_count() or 1).bit_length())]
    trials, mechanism = Trials.of(effort.samples), double_pendulum()
    samples = mechanism.samples(effort.streamed)
    blocks = [range(k, k + effort.trials // BLOCKS) for k in range(0, effort.trials, effort.trials // BLOCKS)]

    def monte_carlo(pool: WorkerPool) -> None:
        list(in_order(pool.executor, trials.identified, blocks, ahead=pool.ahead))

    def identification(pool: WorkerPool) -> None:
        least_squares(mechanism.equations, samples, executor=pool.executor, ahead=pool.ahead)

    rows = []
    with ExitStack() as stack:
        pools = [stack.enter_context(worker_pool(number)) for number in numbers]
        for task, work, amount in (
            ("Monte Carlo", monte_carlo, effort.trials),
            ("identification of pieces", identification, effort.streamed),
        ):
            ways = [partial(work, pool) for pool in pools]
            times = np.median(alternating(ways, effort.seconds, effort.least), axis=0).tolist()
            rows += [Shared(task, n, t, amount / t, times[0] / t) for n, t in zip(numbers, times, strict=True)]
    return rows
