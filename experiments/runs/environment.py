"""What libraries are told by the environment, which they look at when they are first imported, and Python itself."""

import atexit
import gc
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""What says how many threads linear algebra takes."""

GARBAGE = 100_000
"""New objects after which Python looks for cycles of garbage. Recorded equations and imported libraries are many small
objects that stay; to look through them as often as usual takes a twentieth of a short command's time."""


@contextmanager
def environment(values: Mapping[str, str]) -> Iterator[None]:
    """Variables of this process, and of those that it starts, for the duration of a block."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            os.environ.update({} if value is None else {name: value})


def unsaid(*, film: bool) -> dict[str, str]:
    """What a command's libraries are told unless its user has told them something.

    Matrices here are too small, or too tall and thin, for several threads, which would spin beside the one that works
    and make sums depend on the machine. MuJoCo starts a process to look for a screen, which only films need.
    """
    threads = {} if any(name in os.environ for name in THREADS) else dict.fromkeys(THREADS, "1")
    screen = {} if film or "MUJOCO_GL" in os.environ else {"MUJOCO_GL": "disable"}
    return threads | screen


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Cycles of garbage are looked for less often for the duration of a block."""
    before = gc.get_threshold()
    gc.set_threshold(before[0] and max(before[0], GARBAGE))
    try:
        yield
    finally:
        gc.set_threshold(*before)


def end_at_once() -> None:
    """Has this process look for no garbage at its end in all that was imported, a tenth of a short command."""
    atexit.register(gc.freeze)
