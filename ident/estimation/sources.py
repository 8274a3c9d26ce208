"""Sources of samples: one piece, or many that need not fit into memory together; and an ordered map over pieces."""

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Executor, Future
from itertools import islice
from typing import TypeVar

from ident.errors import InputError
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples, arrays_of
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording

Item = TypeVar("Item")
Result = TypeVar("Result")

Source = Samples | Recording | Iterable[Samples | Recording]
"""One piece, or an iterable of pieces that need not fit into memory together."""


def pieces(source: Source, equations: Equations) -> Iterator[Samples]:
    """Yields the checked pieces of a source, all with the same columns and types.

    Args:
        source: Samples or a recording, or an iterable of them.
        equations: Equations to fit.

    Raises:
        InputError: A piece does not fit the mechanism or the first one, or there is none.
    """
    first: Samples | None = None
    alone = isinstance(source, Samples | Recording)
    for k, piece in enumerate([source] if alone else source):  # type: ignore[arg-type]
        where = "The samples" if alone else f"Piece {k}"
        if not isinstance(piece, Samples | Recording):
            raise InputError(f"{where} must be Samples or a recording, got {type(piece).__name__}.")
        samples = piece if isinstance(piece, Samples) else _of_recording(piece, equations.mechanism.tree)
        fitting = equations.checked(samples, where)
        if first is not None:
            _compare(samples, first, where)
        first = first or samples
        yield fitting
    if first is None:
        raise InputError("Identification needs at least one piece of samples, got none.")


def _of_recording(recording: Recording, tree: Tree) -> Samples:
    if recording.base is not None:
        raise InputError("A recording of a moving base needs the base's motion: make Samples with it.")
    return Samples(Motion(*recording.joint_states(tree.joints)), recording.total_wrench(tree).in_base)


def _compare(samples: Samples, first: Samples, where: str) -> None:
    before = arrays_of(first)
    for name, x in arrays_of(samples).items():
        if x.dtype != before[name].dtype:
            raise InputError(
                f"{where}: '{name}' is {x.dtype} where the first piece has {before[name].dtype}; all need one type."
            )
    optional = {"base": (samples.motion.base, first.motion.base), "covariance": (samples.covariance, first.covariance)}
    for name, (own, other) in optional.items():
        if (own is None) != (other is None):
            raise InputError(f"{where}: either all pieces have '{name}' or none has.")


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
