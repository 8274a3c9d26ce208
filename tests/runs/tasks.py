"""Tasks for the processes of `test_workers`, in a module that imports quickly."""

import os
import signal
import threading
import time


def size(data, *, plus=0):
    return len(data) + plus


def refuse(what):
    raise ValueError(f"not {what}")


def unpicklable():
    return threading.Lock()


def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)


def blocked_signals():
    return signal.pthread_sigmask(signal.SIG_BLOCK, [])


def wait_for_others(folder, others, number):
    """The number; the first task waits for so many others."""
    (folder / f"{number}").touch()
    while number == 0 and len(list(folder.iterdir())) <= others:
        time.sleep(0.01)
    return number
