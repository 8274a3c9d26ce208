"""An executor in this process."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Here(Executor):
    """Runs tasks at once in this process, in place of `workers.Processes`."""

    def __init__(self, number: int = 1) -> None:
        """Starts nothing."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """A finished or failed future."""
        future: Future[Any] = Future()
        try:
            future.set_result(work(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future

    def start(self) -> None:
        """Does nothing."""

    def kill(self) -> None:
        """Does nothing."""
