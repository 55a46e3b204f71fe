"""The workers of a Dask scheduler at ``tcp://HOST:PORT`` or ``tls://HOST:PORT``.

Anyone who reaches an open scheduler can run code on all workers. Certificates of ``tls://`` come
from Dask's configuration. Each task compares its worker's version of jbclog, because workers may
join later. The scheduler gives tasks of a killed worker to another one.
"""

from __future__ import annotations

import logging
import re
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TypeVar

import jbclog
from jbclog.analysis.metrics.definitions import METHODS
from jbclog.analysis.verdict import RULES
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.text import clean, shortened

if TYPE_CHECKING:
    from distributed import Client, Future

A = TypeVar("A")
T = TypeVar("T")

ADDRESS: Final = re.compile(r"(tcp|tls)://(\[[0-9A-Fa-f:.]+\]|[^\s:/@\[\]]+):(\d{1,5})")
CONNECT_S: Final = 10.0
NO_WORKER_S: Final = 30.0
"""How long the scheduler may have no worker."""
LOOK_S: Final = 2.0
AHEAD: Final = 4
"""Tasks per worker thread started ahead."""
LEAST_AHEAD: Final = 16
MOST_SAID: Final = 300
CERTIFICATES: Final = (
    "; certificates come from Dask's configuration: DASK_DISTRIBUTED__COMM__TLS__CA_FILE,"
    " …__CLIENT__CERT and …__CLIENT__KEY"
)
NOT_INSTALLED: Final = "{}: `pip install 'jbclog[fleet]'` installs what a scheduler needs"


class Scheduler:
    """The workers of the scheduler at an address."""

    def __init__(self, address: str) -> None:
        matched = ADDRESS.fullmatch(address)
        if matched is None or not 0 < int(matched[3]) < 65_536:
            raise UsageError(
                f"{_printable(address)}: a scheduler is tcp://HOST:PORT or tls://HOST:PORT, as"
                " tcp://dask.plant:8786"
            )
        try:
            import distributed  # noqa: F401
        except ModuleNotFoundError as error:
            raise UsageError(NOT_INSTALLED.format(error)) from None
        self.address = address

    def run(self, function: Callable[[A], T], tasks: Iterable[A]) -> Iterator[T]:
        """Yield the results in the order of the tasks.

        Raises `RecordError` if the scheduler or all workers are lost.
        """
        with _quiet(), self._connected() as client, self._explained():
            self._expect_versions(client)
            left = iter(tasks)
            begun = deque(
                self._submit(client, function, task) for task in islice(left, self._ahead(client))
            )
            while begun:
                result = self._result(client, begun.popleft())
                begun.extend(self._submit(client, function, task) for task in islice(left, 1))
                yield result

    @contextmanager
    def _connected(self) -> Iterator[Client]:
        from distributed import Client, Security

        try:
            security = (
                Security(require_encryption=True) if self.address.startswith("tls:") else None
            )
            client = Client(
                self.address, timeout=CONNECT_S, set_as_default=False, security=security
            )
        except (OSError, TimeoutError, ValueError, TypeError, RuntimeError) as error:
            raise RecordError(self._unreachable(error)) from error
        try:
            yield client
        finally:
            # the results are here; Dask's assertion fails if it is just reconnecting
            with suppress(AssertionError, OSError, RuntimeError):
                client.close(timeout=CONNECT_S)

    def _unreachable(self, error: BaseException) -> str:
        advice = ""
        if self.address.startswith("tls:"):
            advice = CERTIFICATES
        return (
            f"{self.address}: no scheduler answers ({_printable(error)}); start `dask scheduler`"
            f" there{advice}"
        )

    @contextmanager
    def _explained(self) -> Iterator[None]:
        from asyncio import CancelledError

        from distributed import KilledWorker
        from distributed.client import FutureCancelledError, FuturesCancelledError

        gone = (FutureCancelledError, FuturesCancelledError, CancelledError)
        try:
            yield
        except KilledWorker as error:
            raise RecordError(
                f"{self.address}: workers ended while they computed the same part, perhaps for lack"
                f" of memory: {_printable(error)}"
            ) from error
        except RuntimeError as error:
            if "deserialization" not in str(error):
                raise
            why = _printable(error.__cause__ or error)
            raise RecordError(
                f"{self.address}: the scheduler or a worker lacks what the function needs: {why}"
            ) from error
        except gone as error:
            raise RecordError(
                f"{self.address}: the scheduler is gone, nothing was computed; start it and repeat"
            ) from error

    def _expect_versions(self, client: Client) -> None:
        """Raise `RecordError` without workers, or if one of them has another version."""
        try:
            client.wait_for_workers(1, timeout=CONNECT_S)
        except TimeoutError:
            raise RecordError(
                f"{self.address}: the scheduler has no worker; start `dask worker {self.address}`"
            ) from None
        others = {
            name: found for name, found in self._versions(client).items() if found != version()
        }
        if others:
            name, found = next(iter(others.items()))
            raise RecordError(
                f"{self.address}: {_printable(name)} has another version ({len(others)} in all):"
                f" {_printable(found)}; here is {version()}. Install the same on all"
            )

    def _versions(self, client: Client) -> dict[str, object]:
        """Return the version of each worker, or the error that prevents it, and the scheduler's if
        it differs.
        """
        found: dict[str, object] = dict(client.run(version, on_error="return"))
        versions: Any = client.get_versions()
        here, there = (
            versions[name]["packages"]["distributed"] for name in ("client", "scheduler")
        )
        return found if here == there else found | {"the scheduler": f"Dask {there}"}

    def _submit(self, client: Client, function: Callable[[A], T], task: A) -> Future[Any]:
        return client.submit(checked, version(), function, task, pure=False)

    def _ahead(self, client: Client) -> int:
        return max(LEAST_AHEAD, AHEAD * int(sum(client.nthreads().values())))

    def _result(self, client: Client, future: Future[Any]) -> Any:
        """Return the result of a task. Raises `RecordError` if no worker is left."""
        last_seen = time.monotonic()
        while True:
            try:
                return future.result(timeout=LOOK_S)
            except TimeoutError:
                if future.status in ("finished", "error"):
                    return future.result()
                if client.status != "running" or client.nthreads():
                    last_seen = time.monotonic()
                elif time.monotonic() - last_seen > NO_WORKER_S:
                    raise RecordError(
                        f"{self.address}: since {NO_WORKER_S:g} s the scheduler has no worker;"
                        f" start `dask worker {self.address}`"
                    ) from None


def version() -> str:
    """Return the version of what computes here; workers are asked for it."""
    import distributed

    dask: str = distributed.__version__  # type: ignore[attr-defined]  # it is there
    python = ".".join(map(str, sys.version_info[:2]))
    return (
        f"jbclog {jbclog.__version__}, rules {RULES}, methods {METHODS}, Dask {dask}, Python"
        f" {python}"
    )


def checked(expected: str, function: Callable[[A], T], task: A) -> T:
    """Return the function's result, on a worker.

    Raises `RecordError` if its version is not `expected`.
    """
    if version() != expected:
        raise RecordError(
            f"a worker has another version: it has {version()}, asked was for {expected}. Install"
            " the same on all"
        )
    return function(task)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log from standard error: what matters is raised."""
    import distributed  # noqa: F401  # which makes its loggers

    logs = [
        logging.getLogger(name)
        for name in [*logging.root.manager.loggerDict]
        if name.split(".")[0] == "distributed"
    ]
    before = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for log, level in zip(logs, before, strict=True):
            log.setLevel(level)


def _printable(what: object) -> str:
    return shortened(clean(" ".join(str(what).split()) or type(what).__name__), MOST_SAID)
