"""An executor without others."""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any


class Here(Executor):
    """Does at once what it is given, in this process, in place of `workers.Processes`."""

    def __init__(self, number: int = 1) -> None:
        """Starts nothing."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Work that is done, or has failed."""
        future: Future[Any] = Future()
        try:
            future.set_result(work(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future

    def start(self) -> None:
        """Nothing is to start."""

    def kill(self) -> None:
        """Nothing is left to end."""
