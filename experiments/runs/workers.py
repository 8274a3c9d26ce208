"""Worker pools for trials and sweeps: processes of this machine."""

import json
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import Any

from experiments.runs.checkpoint import Checkpoint
from experiments.runs.environment import THREADS, environment, held_back, seldom_collected
from ident.errors import InputError
from ident.estimation.pieces import in_order


@dataclass(frozen=True, eq=False)
class WorkerPool:
    """Workers for the duration of a block.

    Attributes:
        executor: Executor for their tasks.
        ahead: Number of tasks to submit ahead, so that no worker waits.
    """

    executor: Executor
    ahead: int


@dataclass(frozen=True)
class Workers:
    """Workers that share a run.

    Attributes:
        number: As for `worker_pool`.
        resume: True to go on from what an interrupted run has done.
    """

    number: int = 1
    resume: bool = False

    @property
    def threads(self) -> int:
        """Number of threads for simulations in each worker, so that all together fit the machine."""
        return max(1, (os.cpu_count() or 1) // self.number)

    def pool(self, tasks: int) -> AbstractContextManager[WorkerPool]:
        """Pool for a number of tasks, as from `worker_pool`."""
        return worker_pool(max(1, min(self.number, tasks)))

    def collected(
        self,
        work: Callable[[Any], Any],
        tasks: Sequence[Any],
        kept: Checkpoint,
        lost: Callable[[Any, Any], bool] = lambda task, outcome: False,
        batch: int = 0,
    ) -> list[Any]:
        """Outcomes of all tasks in order, whoever does them, or of those that an interrupted run has left.

        Args:
            work: Function of a task that returns its outcome in JSON types; sent to the workers.
            tasks: The tasks.
            kept: File of the outcomes.
            lost: True of a task and its outcome by an interrupted run if it has to be done again, as what it wrote
                is gone.
            batch: Largest number of tasks of a worker at a time, of which `work` then takes and returns a list.
        """
        done = [*kept.done()[: len(tasks)]] if self.resume else []
        again = [k for k, outcome in enumerate(done) if lost(tasks[k], json.loads(outcome))]
        left, together = list(tasks[len(done) :]), partial(_together if batch else _one_by_one, work)
        size = max(1, min(batch, 1 + len(left) // 16))
        with self.pool(len(left) + len(again)) as pool:
            results = partial(in_order, pool.executor, together, ahead=pool.ahead)
            with closing(results([[tasks[k]] for k in again])) as batches:
                for k, (outcome,) in zip(again, batches, strict=True):
                    done[k] = outcome
            if again:
                kept.save(done)
            with closing(results([left[k : k + size] for k in range(0, len(left), size)])) as batches:
                return [json.loads(text) for text in kept.collect(batches, len(tasks), done)]


def _one_by_one(work: Callable[[Any], Any], tasks: Sequence[Any]) -> list[str]:
    return [json.dumps(work(task)) for task in tasks]


def _together(work: Callable[[Any], Sequence[Any]], tasks: Sequence[Any]) -> list[str]:
    return list(map(json.dumps, work(tasks)))


class DeadWorkerError(InputError):
    """A worker process died in the middle of a task."""


@contextmanager
def worker_pool(workers: int) -> Iterator[WorkerPool]:
    """Yields workers with one thread each for linear algebra, so that sums have the same order everywhere.

    Args:
        workers: Number of local processes.

    Raises:
        DeadWorkerError: A local worker died.
    """
    with _local(workers) as executor:
        yield WorkerPool(executor, 2 * workers)


@contextmanager
def _local(number: int) -> Iterator[Executor]:
    """Yields local processes that ignore Ctrl-C and requests to terminate, which their parent handles."""
    if os.name == "posix":
        # Started later, the tracker of shared resources would unblock signals.
        resource_tracker.ensure_running()
    with ExitStack() as stack:
        with environment(dict.fromkeys(THREADS, "1")), held_back():
            executor = Processes(number)
            stack.callback(executor.kill)
        try:
            yield executor
        except BrokenExecutor:
            raise DeadWorkerError("A worker process died, perhaps for want of memory; use fewer --workers.") from None


class Processes(ThreadPoolExecutor):
    """Thread pool whose threads each pass tasks to a process, through a pipe of their own.

    A thread that waits for a process ends with it, even in the middle of a large result, and the processes end with
    their parent, however it died. With a shared pipe, as in Python's own pool and in loky's, both may wait forever.
    """

    def __init__(self, number: int) -> None:
        """Starts the processes, which inherit environment and blocked signals."""
        super().__init__(number)
        self._started: list[SpawnProcess] = []
        self._free: SimpleQueue[Connection] = SimpleQueue()
        context = get_context("spawn")
        for _ in range(number):
            here, there = context.Pipe()
            process = context.Process(target=_serve, args=(there,), daemon=True)
            process.start()
            there.close()
            self._started.append(process)
            self._free.put(here)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submits a task; its future raises `BrokenExecutor` if the process died."""
        # A signal in the middle of this would leave a lock of the threads' closed for good.
        with held_back():
            return super().submit(self._sent, (function, args, kwargs))

    def kill(self) -> None:
        """Ends the processes, also in the middle of their work."""
        for process in self._started:
            process.kill()
        self.shutdown(cancel_futures=True)
        for process in self._started:
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
    """Runs incoming tasks until the connection ends with the parent."""
    with suppress(EOFError, OSError), seldom_collected():
        while True:
            task = connection.recv_bytes()
            try:
                function, args, kwargs = pickle.loads(task)
                reply = pickle.dumps((True, function(*args, **kwargs)))
            except Exception as error:
                reply = pickle.dumps((False, error))
            connection.send_bytes(reply)
