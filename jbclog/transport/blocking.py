"""Run one session in a plain loop on one port: for single commands, and the shortest driver to
read.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeVar

from jbclog.core.clock import Clock, SystemClock
from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Ask, Gather, IoResult, Listen, Request, Steps, Wait
from jbclog.transport.port import REST_S, Budget, Port

T = TypeVar("T")

OpenPort = Callable[[], Port]
NOT_OPEN: Final = "the port is not open"


def run(
    steps: Steps[T],
    open_port: OpenPort,
    *,
    sleep: Callable[[float], None],
    clock: Clock | None = None,
) -> T:
    """Run `steps` to completion and return its result. Before its first `Reopen` it may only
    wait.
    """
    puller = _Driver(open_port, sleep, clock or SystemClock())
    heard: IoResult | None = None
    failure: LinkError | None = None
    try:
        while True:
            try:
                request = steps.throw(failure) if failure is not None else steps.send(heard)
            except StopIteration as end:
                result: T = end.value
                return result
            heard, failure = None, None
            try:
                heard = puller.do(request)
            except LinkError as error:
                failure = error
    finally:
        puller.close()


class _Driver:
    def __init__(self, open_port: OpenPort, sleep: Callable[[float], None], clock: Clock) -> None:
        self._open_port = open_port
        self._sleep = sleep
        self._now = clock.monotonic
        self._port: Port | None = None
        self._sent = 0.0
        self._budget = Budget()
        # end of a flooded port's pause, without which this thread would starve the others
        self._rests_until = 0.0

    def do(self, request: Request) -> IoResult:
        if isinstance(request, Ask):
            port = self._open()
            self._sent = self._now()
            port.write(request.data)
            self._budget.reads = 0
            return self._heard(self._read(port, self._sent + request.patience_s))
        if isinstance(request, Listen):
            return self._heard(self._read(self._open(), request.until))
        if isinstance(request, Wait):
            self._sleep(max(request.until - self._now(), 0.0))
            return self._heard(self._unasked())
        if isinstance(request, Gather):  # there are no other sessions
            return self._heard(self._unasked())
        self.close()
        self._port = self._open_port()
        return self._heard(b"")

    def _read(self, port: Port, until: float) -> bytes:
        """Return the next bytes; none at `until`."""
        if self._rests_until:
            self._sleep(max(min(self._rests_until, until) - self._now(), 0.0))
            self._rests_until = 0.0
        data = port.read(max(until - self._now(), 0.0))
        if data and self._budget.is_spent(len(data)):
            self._rests_until = self._now() + REST_S
        return data

    def close(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None
            self._rests_until = 0.0

    def _unasked(self) -> bytes:
        """Return the bytes that arrived during a wait. The next request reports a lost link."""
        try:
            return b"" if self._port is None else self._port.read_now()
        except LinkError:
            return b""

    def _open(self) -> Port:
        if self._port is None:
            raise LinkError(NOT_OPEN)
        return self._port

    def _heard(self, data: bytes) -> IoResult:
        return IoResult(self._now(), data, self._sent)
