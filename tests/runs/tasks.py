"""Tasks for the processes of `test_workers`, in a module that imports quickly."""

import os
import signal
import threading
from multiprocessing.connection import Connection


def size(data, *, plus=0):
    return len(data) + plus


def refuse(what):
    raise ValueError(f"not {what}")


def unpicklable():
    return threading.Lock()


def die(*_):
    os.kill(os.getpid(), signal.SIGKILL)


def dies_in_the_middle_of_its_result():
    def send(connection, data):
        os.write(connection.fileno(), data[: len(data) // 2])
        die()

    Connection._send = send
    return bytes(1000)


def never_ends(_):
    threading.Event().wait()


def blocked_signals():
    return signal.pthread_sigmask(signal.SIG_BLOCK, [])
