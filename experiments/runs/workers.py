"""Who does the work of trials and sweeps: processes of this machine, or a Dask cluster's workers."""

import os
import pickle
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import Any

from ident.errors import InputError


@dataclass(frozen=True, eq=False)
class Crew:
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
def hired(workers: int, scheduler: str | None = None, tls: Sequence[str] | None = None) -> Iterator[Crew]:
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
            yield Crew(executor, 2 * workers, max(1, (os.cpu_count() or 1) // workers))
    else:
        # Local processes import this module too, and start sooner without what draws figures.
        from experiments.cli import options

        with options.extra("cluster"):
            from experiments.runs import cluster
        with cluster.connected(scheduler, tls) as (executor, number):
            yield Crew(executor, 2 * number, 1)


@contextmanager
def _local(workers: int) -> Iterator[Executor]:
    executor = Processes(workers)
    try:
        yield executor
    except BrokenExecutor:
        raise InputError("A worker process died, perhaps for want of memory; use fewer --workers.") from None
    finally:
        executor.kill()


class Processes(Executor):
    """Local processes that die at once and are deaf to Ctrl-C, which is their parent's business.

    Python's own pool of processes can wait forever for a large task on its way to a process that was killed (Python
    before 3.11.5). Here a thread waits for each process, with a pipe that nobody else holds, so that a death ends it.
    """

    def __init__(self, number: int) -> None:
        """Starts the processes."""
        self._processes: list[SpawnProcess] = []
        self._free: SimpleQueue[Connection] = SimpleQueue()
        self._threads = ThreadPoolExecutor(number)
        context = get_context("spawn")
        with _one_thread_each(), _not_interrupted():
            for _ in range(number):
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(there,), daemon=True)
                process.start()
                there.close()
                self._processes.append(process)
                self._free.put(here)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As every executor; `BrokenExecutor` is the result when the process died."""
        return self._threads.submit(self._sent, (function, args, kwargs))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Ends the processes when the work is done, or what has begun of it."""
        self._threads.shutdown(wait=True, cancel_futures=cancel_futures)
        self.kill()

    def kill(self) -> None:
        """Ends the processes in the middle of their work."""
        for process in self._processes:
            process.kill()
        self._threads.shutdown(cancel_futures=True)
        for process in self._processes:
            process.join()

    def _sent(self, task: object) -> Any:
        sent = pickle.dumps(task)
        connection = self._free.get()
        try:
            connection.send_bytes(sent)
            succeeded, result = pickle.loads(connection.recv_bytes())
        except (EOFError, OSError):
            raise BrokenExecutor("A worker process died.") from None
        finally:
            self._free.put(connection)
        if not succeeded:
            raise result
        return result


def _serve(connection: Connection) -> None:
    """Does the tasks that come in, until the connection ends with the parent."""
    with suppress(EOFError, OSError):
        while True:
            task = connection.recv_bytes()
            try:
                function, args, kwargs = pickle.loads(task)
                reply = pickle.dumps((True, function(*args, **kwargs)))
            except Exception as error:
                reply = pickle.dumps((False, error))
            connection.send_bytes(reply)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Lets the processes that start in a block use one thread for linear algebra."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _not_interrupted() -> Iterator[None]:
    """Holds Ctrl-C back while processes start, and lets them be deaf to it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Started later, the tracker of shared resources would let signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
