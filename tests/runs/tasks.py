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


def first_waits_for(last, folder, k):
    (folder / str(k)).touch()
    end = time.monotonic() + 20
    while k == 0 and not (folder / str(last)).exists() and time.monotonic() < end:
        time.sleep(0.01)
    return (folder / str(last)).exists()
