"""Processes of this machine that do tasks, in a module that costs them little to import."""

import os
import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from queue import SimpleQueue
from typing import Any

from experiments.runs.signals import held_back


class Processes(ThreadPoolExecutor):
    """Threads that each hand their task to a process, through a pipe that nobody else holds.

    So what waits for a process ends with it, be it in the middle of a large result, and the processes end with their
    parent, however it died. Where processes share a pipe, as in Python's own pool and in loky's, both may wait forever.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self._number = number
        self._children: list[SpawnProcess] = []
        self._free: SimpleQueue[Connection] = SimpleQueue()

    def start(self) -> None:
        """Starts the processes, deaf to Ctrl-C and requests to terminate, which are their parent's business."""
        context = get_context("spawn")
        if os.name == "posix":
            # Started later, the tracker of shared resources would let signals through again.
            resource_tracker.ensure_running()
        with _one_thread_each(), held_back():
            for _ in range(self._number):
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(there,), daemon=True)
                process.start()
                there.close()
                self._children.append(process)
                self._free.put(here)

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As every executor; `BrokenExecutor` is the result when the process died."""
        return super().submit(self._sent, (function, args, kwargs))

    def kill(self) -> None:
        """Ends the processes in the middle of their work."""
        for process in self._children:
            process.kill()
        self.shutdown(cancel_futures=True)
        for process in self._children:
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
    before = {name: os.environ[name] for name in names if name in os.environ}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name in names:
            del os.environ[name]
        os.environ.update(before)
