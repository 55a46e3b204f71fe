"""One session, pulled in a plain loop on one port: for verbs that ask a thing or two, and to read what a driver does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from jbclog.core.clock import Clock, SystemClock
from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Ask, Gather, Heard, Listen, Request, Steps, Wait
from jbclog.transport.port import REST_S, Budget

T = TypeVar("T")


class Port(Protocol):
    """What a driver wants of an open port (`transport.Port` is one)."""

    def fileno(self) -> int | None: ...
    def write(self, data: bytes) -> None: ...
    def read_now(self) -> bytes: ...
    def read(self, timeout_s: float) -> bytes: ...
    def close(self) -> None: ...


OpenPort = Callable[[], Port]


def run(steps: Steps[T], open_port: OpenPort, *, sleep: Callable[[float], None], clock: Clock | None = None) -> T:
    """Pull `steps` to its end and give what it returns. Before its first `Reopen` it may only wait."""
    puller = _Puller(open_port, sleep, clock or SystemClock())
    heard: Heard | None = None
    failure: LinkError | None = None
    try:
        while True:
            try:
                wish = steps.throw(failure) if failure else steps.send(heard) if heard else next(steps)
            except StopIteration as end:
                result: T = end.value
                return result
            heard, failure = None, None
            try:
                heard = puller.do(wish)
            except LinkError as error:
                failure = error
    finally:
        puller.close()


class _Puller:
    """Does one wish at a time."""

    def __init__(self, open_port: OpenPort, sleep: Callable[[float], None], clock: Clock) -> None:
        self._open_port = open_port
        self._sleep = sleep
        self._now = clock.monotonic
        self._port: Port | None = None
        self._sent = 0.0
        self._budget = Budget()
        self._rests_until = 0.0  # a port that brings more than answers: a thread that never waits keeps the others from going on

    def do(self, wish: Request) -> Heard:
        if isinstance(wish, Ask):
            port = self._open()
            self._sent = self._now()
            port.write(wish.data)
            self._budget.asked()
            return self._heard(self._read(port, self._sent + wish.patience_s))
        if isinstance(wish, Listen):
            return self._heard(self._read(self._open(), wish.until))
        if isinstance(wish, Wait):
            self._sleep(max(wish.until - self._now(), 0.0))
            return self._heard(self._unasked())
        if isinstance(wish, Gather):  # with nobody: one session is all that there is
            return self._heard(self._unasked())
        self.close()
        self._port = self._open_port()
        return self._heard(b"")

    def _read(self, port: Port, until: float) -> bytes:
        """The next bytes, or none at `until`."""
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
        """What came during a wait. A link that broke meanwhile is told at the next question."""
        try:
            return b"" if self._port is None else self._port.read_now()
        except LinkError:
            return b""

    def _open(self) -> Port:
        if self._port is None:
            raise LinkError("the port is not open")
        return self._port

    def _heard(self, data: bytes) -> Heard:
        return Heard(self._now(), data, self._sent)
