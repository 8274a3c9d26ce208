"""Ordered map over an executor with a bounded number of pending items."""

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
    """Yields `map(function, items)` computed by an executor, in the order of the items.

    An item is drawn and submitted only when fewer than `ahead` results are pending or not yet taken, so that items may
    be large and endless. Pending work is cancelled when the iterator is closed or anything fails; an error is raised
    at its item's turn, after the results of all items before it.

    Args:
        executor: Any executor: threads, processes, a cluster's. It stays open.
        function: Function of an item; for other processes a module-level function or a partial of one.
        items: Arguments, drawn one by one in the thread that takes the results.
        ahead: Largest number of items submitted and not yet taken; more than the number of workers keeps all of them
            busy. By default twice the number of local processors.

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
