"""Who does the work of trials and sweeps: processes of this machine, or a Dask cluster's workers."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor
from contextlib import contextmanager
from dataclasses import dataclass

from experiments.cli import options
from experiments.runs.processes import Processes
from ident.errors import InputError


@dataclass(frozen=True, eq=False)
class WorkerPool:
    """Workers for the duration of a block.

    Attributes:
        executor: Takes their work.
        ahead: Number of tasks to submit ahead, so that nobody waits for work.
        threads: Number of threads that each may use for simulations, so that all together fit the machine.
    """

    executor: Executor
    ahead: int
    threads: int


@contextmanager
def worker_pool(workers: int, scheduler: str | None = None, tls: Sequence[str] | None = None) -> Iterator[WorkerPool]:
    """Workers with one thread each for linear algebra, so that sums are taken in the same order everywhere.

    Args:
        workers: Number of local processes.
        scheduler: Address of a Dask scheduler, `tcp://host:port` or `tls://host:port`, whose workers are taken instead.
        tls: Files for the latter, as for `cluster.connected`.

    Raises:
        InputError: A worker died, or the scheduler cannot be reached, has no workers or was lost.
    """
    if tls is not None and not (scheduler or "").startswith("tls://"):
        raise InputError("The files of --tls are for a --scheduler at tls://HOST:PORT.")
    if scheduler is None:
        with _local(workers) as executor:
            yield WorkerPool(executor, 2 * workers, max(1, (os.cpu_count() or 1) // workers))
    else:
        with options.extra("cluster"):
            from experiments.runs import cluster
        with cluster.connected(scheduler, tls) as (executor, number):
            yield WorkerPool(executor, 2 * number, 1)


@contextmanager
def _local(number: int) -> Iterator[Executor]:
    executor = Processes(number)
    try:
        executor.start()
        yield executor
    except BrokenExecutor:
        raise InputError("A worker process died, perhaps for want of memory; use fewer --workers.") from None
    finally:
        executor.kill()
