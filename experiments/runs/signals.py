"""Ctrl-C and requests to terminate: held back, before there is anything to clean up, and where nothing obeys them."""

import multiprocessing
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

GRACE = 1.5
"""Seconds that a command has to clean up when it is asked to terminate."""

ENDING = (signal.SIGINT, signal.SIGTERM)
"""What asks a command to end."""


def end_silently() -> None:
    """Lets Ctrl-C end this process without a traceback, as long as all that it does is to import."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def ended_after(seconds: float, message: str) -> Iterator[None]:
    """Ends this process and those that it has started if a block goes on for so long after a request to terminate.

    Libraries that compute for minutes, or swallow what is raised in the middle of their calls, would go on. Files that
    are not whole yet have names of their own, and the next run removes them. Ctrl-C has all the time that it takes: an
    estimate that it interrupts is still reported. For the main thread.

    Args:
        seconds: How long it may go on.
        message: What is printed then.
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
    """Holds back Ctrl-C and termination until the end of a block, where the system can.

    Processes that start in the block hold them back for good.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
