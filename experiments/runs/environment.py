"""Environment of a run: variables that libraries read at their first import, garbage collection, optional packages."""

import atexit
import gc
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from ident.errors import InputError

THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that limit the threads of linear algebra."""

GARBAGE = 100_000
"""New objects after which Python looks for garbage cycles. Recorded equations and imported libraries are many small
objects that stay; at the usual rate, scanning them takes a twentieth of a short command's time."""


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


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Makes garbage collection rarer for the duration of a block."""
    before = gc.get_threshold()
    gc.set_threshold(before[0] and max(before[0], GARBAGE))
    try:
        yield
    finally:
        gc.set_threshold(*before)


def end_at_once() -> None:
    """Skips the garbage collection at the end of the process, which takes a tenth of a short command."""
    atexit.register(gc.freeze)


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Turns a failing import in a block into a sentence that names the extra to install."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"This needs the package '{error.name}', which the extra '{name}' brings: pip install -e '.[{name}]'."
        ) from None
