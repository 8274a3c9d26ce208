"""Work handed to an executor a little ahead of whoever takes its results."""

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Executor, Future
from itertools import islice
from typing import TypeVar

from ident.errors import InputError

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_order(
    executor: Executor, function: Callable[[Item], Result], items: Iterable[Item], *, ahead: int | None = None
) -> Generator[Result, None, None]:
    """`map(function, items)` through an executor, in the order of the items whoever finishes first.

    An item is drawn and submitted only when fewer than `ahead` are unfinished or wait for their turn, so that there may
    be endlessly many large ones. What is pending is cancelled when the iterator is closed or anything fails; an
    error comes at its item's turn, after the results of all items before it.

    Args:
        executor: Any executor: threads, processes, a cluster's. It stays open.
        function: What becomes of an item; for other processes a module's function or a partial of one.
        items: Its arguments, drawn one by one in the thread that takes the results.
        ahead: Largest number of items that are submitted and not yet taken, more than there are workers to keep them
            all busy; by default twice the number of processors here.

    Raises:
        InputError: `ahead` is not positive.
    """
    ahead = 2 * (os.cpu_count() or 1) if ahead is None else ahead
    if ahead < 1:
        raise InputError(f"At least one item must be submitted ahead, got {ahead}.")
    waiting = iter(items)
    pending: deque[Future[Result]] = deque()
    try:
        while True:
            pending.extend(executor.submit(function, item) for item in islice(waiting, ahead - len(pending)))
            if not pending:
                return
            yield pending.popleft().result()
    finally:
        for future in pending:
            future.cancel()
