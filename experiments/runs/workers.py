"""Runs of many jobs: processes of this machine, and outcomes saved as they come in, so that a run can be resumed."""

import json
import os
import pickle
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
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

from experiments.runs.environment import THREADS, environment, held_back, seldom_collected
from ident.display.brief import listed
from ident.errors import InputError
from ident.estimation.sources import in_order
from ident.files.arrays import arrays
from ident.files.atomic import save_arrays
from ident.files.limits import parsed_json, reason

SAVE_EVERY = 5.0
"""Seconds between two saves."""

SHOWN = 3
"""Number of differing files that a message names."""

LISTS = "files", "logs"
"""Settings that are lists of files."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """File with the outcomes of a run.

    Attributes:
        what: Name of the outcomes, e.g. "trials".
        file: NPZ file with the outcomes, replaced atomically.
        identity: Settings that all outcomes of one run share, in JSON types.
        check: Raises an `InputError` if the outcomes of an earlier run are not as they have to be.
    """

    what: str
    file: Path
    identity: Mapping[str, Any]
    check: Callable[[Sequence[Any]], object] | None = None

    def done(self) -> list[str]:
        """Outcomes of an interrupted run, as JSON.

        Raises:
            InputError: There are none, or they belong to another run.
        """
        try:
            data = arrays(self.file)
            kept, outcomes = parsed_json(str(data["identity"])), bytes(data["outcomes"]).decode().splitlines()
            parsed = [parsed_json(text) for text in outcomes]
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
            self.file.replace(self.file.with_stem(f"{self.file.stem}_before"))

    def keep(self) -> None:
        """Saves that nothing is done, if nothing is saved, so that a run that a full disk has ended can be resumed.

        Without room even for that, the file of an earlier run is put back.
        """
        if self.file.exists():
            return
        try:
            self.save([])
        except OSError:
            with suppress(OSError):
                self.file.with_stem(f"{self.file.stem}_before").replace(self.file)
        else:
            print(f"\nNone of the {self.what} is done; once there is room run again with --resume.", file=sys.stderr)

    def collect(self, batches: Iterable[Sequence[str]], total: int, done: Sequence[str] = ()) -> list[str]:
        """Collects outcomes and saves them every few seconds, at the end, and on any error.

        Args:
            batches: Outcomes in order, a few at a time, as JSON.
            total: Number of outcomes to reach.
            done: The first of them, from an interrupted run; without any, an earlier run's file is set aside.

        Raises:
            OSError: They could not be saved; the file has those of the last save.
        """
        if not done:
            self.set_aside()
        outcomes, saved = list(done), time.monotonic()
        try:
            try:
                with tqdm(desc=self.what.capitalize(), total=total, initial=len(done), file=sys.stderr) as bar:
                    for batch in batches:
                        outcomes.extend(batch)
                        bar.update(len(batch))
                        if time.monotonic() - saved > SAVE_EVERY:
                            self.save(outcomes)
                            saved = time.monotonic()
            finally:
                if len(outcomes) > len(done):
                    self.save(outcomes)
        except BaseException:
            if self.file.exists():
                print(f"\nThe {self.what} done so far are in {self.file}; run again with --resume.", file=sys.stderr)
            raise
        return outcomes

    def save(self, outcomes: Sequence[str]) -> None:
        """Writes the file."""
        # As letters of four bytes each, texts of numbers would take ten times the room of these.
        lines = np.frombuffer("\n".join(outcomes).encode(), np.uint8)
        save_arrays(self.file, {"identity": json.dumps(self.identity), "outcomes": lines})


def named(key: str, kept: Any, wanted: Any) -> str:
    """The name of a setting that differs from an earlier run's, with its files that differ if it is a list of such."""
    if key not in LISTS:
        return key
    before = kept if isinstance(kept, list) else []
    files = [name for each in wanted if each not in before for name in _names(each)]
    files = files or [name for each in before if each not in wanted for name in _names(each)]
    return f"{key} ({listed(files, SHOWN)})" if files else key


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
        done = [*kept.done()[: len(tasks)]] if self.resume else []
        again = [k for k, outcome in enumerate(done) if lost(tasks[k], json.loads(outcome))]
        left, together = list(tasks[len(done) :]), partial(_done, work, batch > 0)
        size = max(1, min(batch, 1 + len(left) // 16))
        number = max(1, min(self.number, len(left) + len(again)))
        with worker_pool(number) as executor:
            # Two tasks for each, so that no worker waits.
            results = partial(in_order, executor, together, ahead=2 * number)
            with closing(results([[tasks[k]] for k in again])) as batches:
                for k, (outcome,) in zip(again, batches, strict=True):
                    done[k] = outcome
            if again:
                kept.save(done)
            with closing(results([left[k : k + size] for k in range(0, len(left), size)])) as batches:
                return [json.loads(text) for text in kept.collect(batches, len(tasks), done)]


def _done(work: Callable[[Any], Any], together: bool, tasks: Sequence[Any]) -> list[str]:
    """Outcomes of tasks, together or one by one, as JSON."""
    return [json.dumps(outcome) for outcome in (work(tasks) if together else map(work, tasks))]


class DeadWorkerError(InputError):
    """A worker process died in the middle of a task."""


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
