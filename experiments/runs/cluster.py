"""A Dask cluster's workers as an executor."""

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future, InvalidStateError
from contextlib import ExitStack, contextmanager, suppress
from threading import Event, Thread
from typing import Any

from distributed import Client, KilledWorker
from distributed.security import Security

from ident.errors import InputError

ANSWER = 5.0
"""Seconds within which a scheduler must answer and have a worker."""


@contextmanager
def connected(address: str, tls: Sequence[str] | None = None) -> Iterator[tuple[Executor, int]]:
    """Yields an executor on a cluster's workers, and the number of tasks that they do at once.

    The scheduler redoes the tasks of workers that die.

    Args:
        address: Address of the scheduler, `tcp://host:port` or `tls://host:port`.
        tls: PEM files for the latter: certificate authority, own certificate and its key; by default those of Dask's
            configuration.

    Raises:
        InputError: The scheduler cannot be reached with these files, has no workers or unfit ones, or was lost; or one
            task has killed several workers.
    """
    # All that matters of its logs is raised, also after the client is closed.
    for name in ("distributed", "distributed.client", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    with ExitStack() as stack:
        try:
            security = _security(tls) if address.startswith("tls://") else None
            client = stack.enter_context(Client(address, timeout=ANSWER, set_as_default=False, security=security))
            client.wait_for_workers(1, timeout=ANSWER)
        # Without files for TLS Dask raises a TypeError.
        except (OSError, ValueError, TypeError, RuntimeError) as error:
            raise InputError(f"There is no Dask scheduler with workers at {address} ({error}).") from None
        executor = stack.enter_context(_Watched(client))
        _check_workers(client, executor, address)
        try:
            yield executor, sum(client.nthreads().values())
        except KilledWorker:
            raise InputError(
                f"Several workers of the cluster at {address} died of the same task, perhaps for want of memory."
            ) from None
        except CancelledError:
            raise InputError(f"The connection to the Dask scheduler at {address} was lost.") from None


def _check_workers(client: Any, executor: Executor, address: str) -> None:
    """Checks that workers have this package and one thread for linear algebra."""
    try:
        executor.submit(_threads_for_linear_algebra).result()
        threads = set(client.run(_threads_for_linear_algebra).values())
    except Exception as error:
        raise InputError(
            f"The cluster at {address} cannot run this: its scheduler and workers need this package and the same "
            f"versions as here ({str(error).partition(chr(10))[0]})."
        ) from None
    if threads != {"1"}:
        raise InputError(
            f"The workers of the cluster at {address} need one thread for linear algebra: start them with "
            "OPENBLAS_NUM_THREADS=1, as Dask's nanny does."
        )


def _security(tls: Sequence[str] | None) -> Any:
    if tls is None:
        return Security(require_encryption=True)
    authority, certificate, key = tls
    return Security(require_encryption=True, tls_ca_file=authority, tls_client_cert=certificate, tls_client_key=key)


class _Watched(Executor):
    """A Dask client's executor whose tasks end when the scheduler is lost.

    Dask cancels the tasks that it knows then, but not those submitted while it tries to reconnect.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._executor = client.get_executor()
        self._pending: set[Future[Any]] = set()
        self._ended = Event()
        Thread(target=self._watch, daemon=True).start()

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future = self._executor.submit(function, *args, **kwargs)
        self._pending.add(future)
        future.add_done_callback(self._pending.discard)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Disconnects without waiting for the workers' tasks."""
        self._ended.set()
        self._executor.shutdown(wait=False)

    def _watch(self) -> None:
        while not self._ended.wait(0.2):
            if self._client.status != "running":
                for future in list(self._pending):
                    with suppress(InvalidStateError):
                        future.set_exception(CancelledError())


def _threads_for_linear_algebra() -> str | None:
    """Number of threads from the environment that the process was started with."""
    return os.environ.get("OPENBLAS_NUM_THREADS")
