"""Handling of Ctrl-C and requests to terminate: blocked, silent during imports, and enforced if nothing obeys them."""

import multiprocessing
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

GRACE = 1.5
"""Seconds that a command has to clean up after a request to terminate."""

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
