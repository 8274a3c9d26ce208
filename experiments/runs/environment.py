"""What libraries are told by the environment, which they look at when they are first imported."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""What says how many threads linear algebra takes."""


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
