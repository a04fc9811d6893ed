"""A Dask cluster, by the address of its scheduler. Needs the extra ``dask``."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from importlib import import_module
from itertools import islice
from time import monotonic, sleep
from typing import Any, TypeVar

from scp_planner.batch.executor import Answer, ExecutorError, Fate

T = TypeVar("T")
R = TypeVar("R")

SCHEMES_WITH_PORTS = ("tcp", "tls", "ucx", "ws", "wss")
POLL_TIME, LOOK_TIME = 0.01, 1.0
"""s between two looks at whether there is an answer, and at whether there are workers."""


class DaskExecutor:
    """Workers of a Dask cluster."""

    def __init__(self, address: str, connect_time: float = 10.0, patience: float = 120.0) -> None:
        try:
            self._distributed: Any = import_module("distributed")
        except ImportError:
            raise ExecutorError("Dask is not installed: pip install 'scp-planner[dask]'") from None
        self.address = address
        self.patience = patience
        try:
            _check(address)  # a client that was given what is no address would linger, and say so on stderr
            self.client = self._distributed.Client(address, timeout=connect_time, set_as_default=False)
        except (OSError, ValueError) as error:  # a time-out is an OSError too; an address may be none
            reason = str(error) or type(error).__name__
            raise ExecutorError(f"no Dask scheduler answers at {address}: {reason}") from None

    def run(self, function: Callable[[T], R], items: Iterable[T]) -> Generator[Answer[T, R], None, None]:
        """Call a function for every item; see `Executor`."""
        pending: dict[Any, T] = {}
        suspects: list[T] = []
        waiting = iter(items)

        def submitted(item: T) -> Any:
            # not pure: a scheduler that knows the result of an equal call must not answer from memory
            future = self.client.submit(function, item, pure=False)
            pending[future] = item
            return future

        try:
            ahead = max(4 * sum(self.client.nthreads().values()), 32)
            first = [submitted(item) for item in islice(waiting, ahead)]
            futures = self._distributed.as_completed(first, loop=self.client.loop)
            while not futures.is_empty():
                self._wait(futures.has_ready)
                future = next(futures)
                answer: Answer[T, R] = self._answer(pending.pop(future), future)
                for item in islice(waiting, 1):
                    futures.add(submitted(item))
                if answer.fate is Fate.LOST:
                    suspects.append(answer.item)
                else:
                    yield answer
            for item in suspects:
                future = submitted(item)
                self._wait(future.done)
                yield self._answer(pending.pop(future), future)
        finally:
            if pending and self.client.status == "running":
                self.client.cancel(list(pending), force=True)

    def close(self) -> None:
        """Leave the cluster."""
        self.client.close()

    def _wait(self, is_ready: Callable[[], bool]) -> None:
        """Wait for something, but not for ever on a cluster without workers."""
        looked = seen = monotonic()
        while not is_ready():
            sleep(POLL_TIME)
            if monotonic() - looked > LOOK_TIME:
                looked = monotonic()
                seen = looked if self._has_workers() else seen
                if looked - seen > self.patience:
                    raise ExecutorError(
                        f"the Dask cluster at {self.address} has had no workers for {looked - seen:.0f} s"
                    )

    def _has_workers(self) -> bool:
        try:
            return bool(self.client.nthreads())
        except OSError:  # of a scheduler that has gone, which shows by its futures
            return False

    def _answer(self, item: T, future: Any) -> Answer[T, R]:
        """Take what came of an item; a result that was lost with its worker is made anew meanwhile."""
        self._wait(lambda: future.status not in ("pending", "lost"))
        try:
            return Answer(item, Fate.DONE, future.result())
        except self._distributed.KilledWorker as error:
            died = error.allowed_failures + 1
            return Answer(item, Fate.LOST, None, f"{died} worker{'s' if died > 1 else ''} died at it")
        except (Exception, self._distributed.CancelledError) as error:
            if future.status != "error":  # not what was raised in a worker: nobody is there any more to ask
                raise ExecutorError(f"the Dask scheduler at {self.address} has gone") from None
            return Answer(item, Fate.ERROR, None, f"{type(error).__name__}: {error}")


def _check(address: str) -> None:
    """Raise ValueError if an address has an unknown scheme, or no port."""
    addressing, registry = (import_module(f"distributed.comm.{name}") for name in ("addressing", "registry"))
    scheme, place = addressing.parse_address(address)
    registry.get_backend(scheme)
    if scheme in SCHEMES_WITH_PORTS:
        addressing.parse_host_port(place)
