"""Where a function of each run is called: here, in processes of this computer, or by the workers of
a Dask scheduler (extra `fleet`).

One task a run; results come in the order of the runs. Dask gives the tasks of a lost worker to
another one. Anyone who reaches an open scheduler can run code on its workers; certificates of
``tls://`` come from Dask's configuration.
"""

from __future__ import annotations

import multiprocessing
import re
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, Generic, TypeVar

from jbclog import __version__
from jbclog.analysis.derived_files import METHODS_TEXT
from jbclog.analysis.opening import open_run
from jbclog.analysis.run import Run
from jbclog.core.errors import RecordError, UsageError, unexpected_error_text
from jbclog.core.text import clean, shortened

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
A = TypeVar("A")

ADDRESS: Final = re.compile(r"(tcp|tls)://(\[[0-9A-Fa-f:.]+\]|[^\s:/@\[\]]+):\d{1,5}")
CONNECT_S: Final = 10.0
NO_WORKER_S: Final = 30.0
"""How long a scheduler may have no worker."""
LOOK_S: Final = 2.0
AHEAD: Final = 4
"""Tasks of each thread that are started ahead, which bounds the results held."""
MADE_BY: Final = f"jbclog {__version__}, {METHODS_TEXT}"
MOST_SAID: Final = 300


@dataclass(frozen=True, slots=True)
class OfRun(Generic[T]):
    """Calls a function of a run by the run's path, also in another process.

    A `RecordError`, and an error of type `caught`, is returned with its run; any other ends the
    work.
    """

    function: Callable[[Run], T]
    caught: type[Exception] = RecordError
    made_by: str = MADE_BY

    def __call__(self, path: str) -> tuple[T | None, str | None]:
        """Return the result and None, or None and why the run cannot be read."""
        if self.made_by != MADE_BY:
            raise UsageError(
                f"a worker has {MADE_BY}, here is {self.made_by}; install the same on all"
            )
        try:
            return self.function(open_run(path)), None
        except UsageError:
            raise
        except (RecordError, self.caught) as error:
            return None, why_unreadable(error)


def why_unreadable(error: Exception) -> str:
    """Return why a run cannot be read; rows of others can raise anything."""
    if isinstance(error, RecordError):
        return str(error)
    return f"its tables cannot be read: {unexpected_error_text(error)}"


@dataclass(frozen=True, slots=True)
class Workers:
    """Calls a function for each task, in so many processes, or on a scheduler at
    ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.
    """

    processes: int = 1
    scheduler: str | None = None

    def __post_init__(self) -> None:
        """Raise `UsageError` for an address that none is, or without Dask."""
        if self.processes < 1:
            raise UsageError(f"processes must be at least 1 (got {self.processes})")
        if self.scheduler is None:
            return
        if not ADDRESS.fullmatch(self.scheduler):
            raise UsageError(
                f"{clean(self.scheduler):.100}: a scheduler is tcp://HOST:PORT or tls://HOST:PORT"
            )
        try:
            import distributed  # noqa: F401
        except ModuleNotFoundError as error:
            raise UsageError(
                f"{error}: `pip install 'jbclog[fleet]'` installs what a scheduler needs"
            ) from None

    def map(self, function: Callable[[A], T], tasks: Sequence[A]) -> Iterator[T]:
        """Yield the results in the order of the tasks.

        Raises what the function raises, and `RecordError` if processes, the scheduler or all its
        workers are lost.
        """
        if self.scheduler is not None:
            return _on_scheduler(self.scheduler, function, tasks)
        if self.processes > 1:
            return _in_processes(self.processes, function, tasks)
        return map(function, tasks)


HERE: Final = Workers()


def _in_processes(count: int, function: Callable[[A], T], tasks: Sequence[A]) -> Iterator[T]:
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
        try:
            yield from pool.map(function, tasks)
        except BrokenProcessPool as error:
            raise RecordError(
                "a process that read runs was killed, perhaps for lack of memory; no answer. In a"
                ' script, what starts them must stand below `if __name__ == "__main__":`'
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


def _on_scheduler(address: str, function: Callable[[A], T], tasks: Sequence[A]) -> Iterator[T]:
    from asyncio import CancelledError

    from distributed import KilledWorker

    with _connected(address) as client:
        left = iter(tasks)
        ahead = AHEAD * sum(client.nthreads().values())
        begun = deque(client.submit(function, task, pure=False) for task in islice(left, ahead))
        try:
            while begun:
                yield _result(client, begun.popleft(), address)
                begun.extend(client.submit(function, task, pure=False) for task in islice(left, 1))
        except KilledWorker as error:
            raise RecordError(
                f"{address}: workers ended while they read the same run, perhaps for lack of"
                f" memory: {_line(error)}"
            ) from error
        except CancelledError as error:
            raise RecordError(f"{address}: the scheduler is gone; start it and repeat") from error


def _connected(address: str) -> Client:
    from distributed import Client, Security

    security = Security(require_encryption=True) if address.startswith("tls:") else None
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False, security=security)
    except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
        raise RecordError(
            f"{address}: no scheduler answers ({_line(error)}); start `dask scheduler` there"
        ) from error
    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        client.close()
        raise RecordError(
            f"{address}: the scheduler has no worker; start `dask worker {address}`"
        ) from None
    return client


def _result(client: Client, future: Future[Any], address: str) -> Any:
    """Return the result of a task. Raises `RecordError` if no worker is left."""
    last_seen = time.monotonic()
    while True:
        try:
            return future.result(timeout=LOOK_S)
        except TimeoutError:
            if future.status in ("finished", "error"):
                return future.result()
            if client.nthreads():
                last_seen = time.monotonic()
            elif time.monotonic() - last_seen > NO_WORKER_S:
                raise RecordError(
                    f"{address}: the scheduler has had no worker for {NO_WORKER_S:g} s; start"
                    f" `dask worker {address}`"
                ) from None


def _line(error: Exception) -> str:
    return shortened(clean(" ".join(str(error).split())) or type(error).__name__, MOST_SAID)
