"""Environment of commands and workers: variables, garbage collection, and requests to end."""

import atexit
import gc
import multiprocessing
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress

GRACE = 1.5
"""Seconds that a command has to clean up after a request to end, and in which further ones are those of an impatient
hand."""

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a command to end."""


def end_silently() -> None:
    """Lets Ctrl-C end this process without a traceback, while it only imports."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def ended_after(seconds: float, message: str) -> Iterator[None]:
    """Ends this process and its children if a block goes on for so long after a request to terminate.

    Libraries that compute for minutes, or swallow exceptions raised during their calls, would go on. Incomplete files
    have names of their own, and the next run removes them. Ctrl-C sets no limit: an estimate that it interrupts is
    still reported. For the main thread.

    Args:
        seconds: Time limit after the request.
        message: Text to print before the process ends.
    """
    here, there = socket.socketpair()
    there.setblocking(False)
    done = threading.Event()

    def watch() -> None:
        # Python's own handlers wait for the main thread; these bytes do not.
        asked = False
        while not asked and (numbers := here.recv(16)):
            asked = signal.SIGTERM in numbers
        if asked and not done.wait(seconds):
            for process in multiprocessing.active_children():
                process.kill()
            with suppress(OSError, ValueError):
                print(message, file=sys.stderr, flush=True)
            os._exit(130)

    before = signal.set_wakeup_fd(there.fileno(), warn_on_full_buffer=False)
    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        signal.set_wakeup_fd(before)
        there.close()
        watcher.join()
        here.close()


@contextmanager
def held_back() -> Iterator[None]:
    """Blocks Ctrl-C and termination until the end of a block, if the system supports it.

    Processes that start in the block have them blocked for good.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that limit the threads of linear algebra."""

GARBAGE = 1_000_000
"""New objects after which Python looks for garbage cycles. Recorded equations and imported libraries are many small
objects that stay: scanning them takes a twentieth of a short command's time, which makes fewer than so many."""


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Sets variables of this process, and of those that it starts, for the duration of a block."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            os.environ.update({} if value is None else {name: value})


def default_variables() -> dict[str, str]:
    """Variables for a command's libraries that its user has not set.

    Matrices here are too small, or too tall and thin, for several threads: these would only wait, and make sums depend
    on the machine. MuJoCo starts a process to look for a screen, which nothing here needs.
    """
    threads = {} if any(name in os.environ for name in THREADS) else dict.fromkeys(THREADS, "1")
    screen = {} if "MUJOCO_GL" in os.environ else {"MUJOCO_GL": "disable"}
    return threads | screen


def one_thread_each() -> bool:
    """True if variables limit linear algebra to one thread, so that threads of ours do not compete with its own."""
    return {os.environ[name] for name in THREADS if name in os.environ} == {"1"}


def seldom_collected() -> None:
    """Makes garbage collection of this process rarer, and skips it at the end, a tenth of a short command's time."""
    gc.set_threshold(GARBAGE)
    atexit.register(gc.freeze)
