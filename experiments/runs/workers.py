"""Runs of many jobs: processes of this machine, and outcomes saved as they come in, so that a run can be resumed."""

import json
import os
import pickle
import sys
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np
from tqdm import tqdm

from experiments.runs import THREADS, environment, held_back, seldom_collected
from ident.display.brief import listed
from ident.errors import InputError
from ident.files.arrays import arrays
from ident.files.atomic import save_arrays
from ident.files.limits import parsed_json, reason
from ident.tolerances import NAMED

SAVE_EVERY = 5.0
"""Seconds between two saves."""

LISTS = "files", "logs"
"""Settings that are lists of files."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """File with the outcomes of a run.

    Attributes:
        what: Name of the outcomes, e.g. "trials".
        file: NPZ file with the outcomes, replaced atomically.
        identity: Settings that all outcomes of one run share, in JSON types.
        check: Raises an `InputError` if outcomes of an earlier run, None where it has none, are not as they have to be.
    """

    what: str
    file: Path
    identity: Mapping[str, Any]
    check: Callable[[Sequence[Any]], object] | None = None

    def done(self) -> list[str]:
        """Outcomes of an interrupted run in the order of its tasks, as JSON; empty where it has none.

        Raises:
            InputError: Nothing was done, or they belong to another run.
        """
        if not self.file.exists():
            raise InputError(f"--resume goes on with the {self.what} in {self.file}, but none is done; leave it out.")
        try:
            data = arrays(self.file)
            kept, outcomes = parsed_json(str(data["identity"])), bytes(data["outcomes"]).decode().splitlines()
            parsed = [parsed_json(text) if text else None for text in outcomes]
            wanted = json.loads(json.dumps(self.identity))
            different = [named(key, kept.get(key), wanted[key]) for key in wanted if kept.get(key) != wanted[key]]
            if self.check is not None and not different:
                self.check(parsed)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            needed = f"the {self.what} of an earlier run in {self.file}"
            raise InputError(f"--resume needs {needed} ({reason(error)}).") from None
        if different:
            raise InputError(
                f"The {self.what} in {self.file} are of another run: {', '.join(different)} differ; leave out --resume."
            )
        return outcomes

    def set_aside(self) -> None:
        """Renames the file of an earlier run, if there is one."""
        if self.file.exists():
            self.file.replace(self._before)

    @property
    def _before(self) -> Path:
        """File of an earlier run."""
        return self.file.with_stem(f"{self.file.stem}_before")

    def collect(self, answers: Iterable[Mapping[int, str]], outcomes: list[str]) -> None:
        """Collects outcomes and saves them every few seconds, at the end, and on any error.

        Args:
            answers: Outcomes by the numbers of their tasks, a few at a time, as JSON.
            outcomes: Outcomes of all tasks, where they are put; empty where they are missing.

        Raises:
            OSError: They could not be saved; the file has those of the last save.
        """
        before, saved = sum(map(bool, outcomes)), time.monotonic()
        try:
            with tqdm(desc=self.what.capitalize(), total=len(outcomes), initial=before, file=sys.stderr) as bar:
                for some in answers:
                    for k, outcome in some.items():
                        outcomes[k] = outcome
                    bar.update(len(some))
                    if time.monotonic() - saved > SAVE_EVERY:
                        self.save(outcomes)
                        saved = time.monotonic()
            self.save(outcomes)
        except BaseException:
            self._keep(outcomes)
            raise

    def _keep(self, outcomes: Sequence[str]) -> None:
        """Saves the outcomes of a run that ends early; if there is no room for a file, an earlier run's is put back."""
        with suppress(OSError):
            self.save(outcomes)
        if self.file.exists():
            done = f"The {self.what} done so far" if any(outcomes) else f"None of the {self.what} is done; settings"
            print(f"\n{done} are in {self.file}; run again with --resume.", file=sys.stderr)
        else:
            with suppress(OSError):
                self._before.replace(self.file)

    def save(self, outcomes: Sequence[str]) -> None:
        """Writes the file."""
        # As letters of four bytes each, texts of numbers would take ten times the room of these.
        lines = np.frombuffer("\n".join(outcomes).rstrip("\n").encode(), np.uint8)
        save_arrays(self.file, {"identity": json.dumps(self.identity), "outcomes": lines})


def named(key: str, kept: Any, wanted: Any) -> str:
    """The name of a setting that differs from an earlier run's, with its files that differ if it is a list of such."""
    if key not in LISTS:
        return key
    before = kept if isinstance(kept, list) else []
    files = [name for each in wanted if each not in before for name in _names(each)]
    files = files or [name for each in before if each not in wanted for name in _names(each)]
    return f"{key} ({listed(files, NAMED)})" if files else key


def _names(entry: Any) -> list[str]:
    """Names of the files in an entry: text, the sum of a file, or those of several."""
    if isinstance(entry, str):
        return [entry]
    files = entry.get("files", [entry]) if isinstance(entry, dict) else []
    return [str(each["file"]) for each in files if isinstance(each, dict) and "file" in each]


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
        outcomes = [""] * len(tasks)
        if self.resume:
            done = kept.done()[: len(tasks)]
            outcomes[: len(done)] = done
        for k, text in enumerate(outcomes):
            if text and lost(tasks[k], json.loads(text)):
                outcomes[k] = ""
        left = [k for k, text in enumerate(outcomes) if not text]
        size = max(1, min(batch, 1 + len(left) // 16))
        parts = [left[k : k + size] for k in range(0, len(left), size)]
        number, together = max(1, min(self.number, len(left))), partial(_done, work, batch > 0)
        # Two tasks for each, so that no worker waits.
        with (
            worker_pool(number) as executor,
            closing(_answers(executor, together, tasks, parts, 2 * number)) as answers,
        ):
            if not self.resume:
                kept.set_aside()
            kept.collect(answers, outcomes)
        return [json.loads(text) for text in outcomes]


def _answers(
    executor: Executor, work: Callable[[Any], list[str]], tasks: Sequence[Any], parts: Iterable[list[int]], ahead: int
) -> Generator[dict[int, str], None, None]:
    """Yields outcomes by the numbers of their tasks as workers finish parts of these, of which few are submitted ahead.

    Raises:
        DeadWorkerError: A worker died.
    """
    todo, pending = deque(parts), dict[Future[list[str]], list[int]]()
    try:
        while todo or pending:
            if todo:
                part = todo.popleft()
                pending[executor.submit(work, [tasks[k] for k in part])] = part
            finished, _ = wait(pending, 0 if todo and len(pending) < ahead else None, FIRST_COMPLETED)
            # What is done is kept before what failed ends the run; the first task at which it did is named.
            for future in sorted(finished, key=lambda future: (future.exception() is not None, pending[future])):
                part = pending.pop(future)
                try:
                    yield dict(zip(part, future.result(), strict=True))
                except BrokenExecutor:
                    raise DeadWorkerError(tasks[part[0]]) from None
    finally:
        for future in pending:
            future.cancel()


def _done(work: Callable[[Any], Any], together: bool, tasks: Sequence[Any]) -> list[str]:
    """Outcomes of tasks, together or one by one, as JSON."""
    return [json.dumps(outcome) for outcome in (work(tasks) if together else map(work, tasks))]


class DeadWorkerError(InputError):
    """A worker process died.

    Attributes:
        task: The task that it had begun; None if that is not known.
    """

    def __init__(self, task: Any = None) -> None:
        """Error with the usual reason."""
        super().__init__("A worker process died, perhaps for want of memory; use fewer --workers.")
        self.task = task


@contextmanager
def worker_pool(number: int) -> Iterator[Executor]:
    """Yields so many local processes, which ignore Ctrl-C and requests to terminate: their parent handles these.

    Each has one thread for linear algebra, so that sums have the same order everywhere.

    Raises:
        DeadWorkerError: A worker died.
    """
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
            raise DeadWorkerError from None


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
    seldom_collected()
    with suppress(EOFError, OSError):
        while True:
            task = connection.recv_bytes()
            try:
                function, args, kwargs = pickle.loads(task)
                reply = pickle.dumps((True, function(*args, **kwargs)))
            except Exception as error:
                reply = pickle.dumps((False, error))
            connection.send_bytes(reply)
