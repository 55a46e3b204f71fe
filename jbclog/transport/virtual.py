"""Run sessions on a virtual clock: an hour of faults in seconds, reproducibly. For tests.

Each session talks to a `Peer`, which returns its answers and their times. The clock jumps to the
next event.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from itertools import accumulate, count
from typing import Protocol

from jbclog.core.clock import VirtualClock
from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Ask, Gather, IoResult, Listen, Request, RunEnded, Steps, Wait
from jbclog.transport.port import MOST_KEPT
from jbclog.transport.start_barrier import Barrier


class Peer(Protocol):
    """The other end of a link."""

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """Return the answer to `data` written at `now`: pieces of bytes, each with its time of
        arrival.
        """

    def is_unplugged(self, now: float) -> bool:
        """Return True if the link is interrupted."""


class VirtualDriver:
    """Runs sessions on `clock` and advances it. `allow_missing`: sessions that are ready start
    without the others.
    """

    def __init__(self, clock: VirtualClock, *, allow_missing: bool = False) -> None:
        self.clock = clock
        self._order = count()
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._links: list[_VirtualLink] = []
        self.late_s = 0.0  # total lateness of the host: time that passed during calls
        self.barrier = Barrier(clock.monotonic, self.at, allow_missing=allow_missing)

    def add(self, session: Steps[object], peer: Peer, name: str = "") -> None:
        link = _VirtualLink(self, session, peer, name)
        self._links.append(link)
        self.at(self.clock.monotonic(), link.start)

    def at(self, moment: float, call: Callable[[], None]) -> None:
        """Schedule `call` at `moment` (monotonic seconds)."""
        heapq.heappush(self._events, (moment, next(self._order), call))

    def say(self, name: str, data: bytes) -> None:
        """Send unsolicited `data` now to the session of that name."""
        for link in self._links:
            if link.name == name:
                link.come(data)

    def end(self, why: str) -> None:
        """End every session; each makes its tools safe before it returns."""
        self.barrier.disband()
        for link in self._links:
            link.end(why)

    def run(self) -> None:
        while self._events and not all(link.is_ended for link in self._links):
            moment, _, call = heapq.heappop(self._events)
            self.clock.advance_to(moment)
            began = self.clock.monotonic()
            call()
            self.late_s += self.clock.monotonic() - began


def _moment(coming: tuple[float, bytes]) -> float:
    return coming[0]  # not by the bytes: pieces of the same moment keep their order


def _kept(pieces: Sequence[bytes]) -> Sequence[bytes]:
    """Return the pieces that a real driver buffers while no session listens; the rest stays in the
    system.
    """
    so_far = accumulate(map(len, pieces))
    return pieces[: 1 + sum(size < MOST_KEPT for size in so_far)]


class _VirtualLink:
    """One session, its peer, and the bytes on their way to it."""

    def __init__(
        self, driver: VirtualDriver, session: Steps[object], peer: Peer, name: str
    ) -> None:
        self.name = name
        self._driver = driver
        self._session = session
        self._peer = peer
        self._coming: list[tuple[float, bytes]] = []
        self._is_open = False
        self._listening = False
        self._sent = 0.0
        self._turn = 0  # alarms of earlier requests are ignored
        self._ending: RunEnded | None = None
        self._heard = 0.0  # when bytes last arrived
        self._late_s = 0.0  # the driver's total lateness at the last result
        self._is_gathered = False
        self._member = driver.barrier.join(name, self)
        self.is_ended = False

    def start(self) -> None:
        self._pull(lambda: self._session.send(None))

    def end(self, why: str) -> None:
        if self._ending is None and not self.is_ended:
            self._ending = RunEnded(why)
            self._pull(lambda: self._session.throw(RunEnded(why)))

    def come(self, data: bytes) -> None:
        """Receive unsolicited bytes; they are lost if the port is not open."""
        if self._is_open and not self.is_ended:
            now, turn = self._driver.clock.monotonic(), self._turn
            self._coming = sorted([*self._coming, (now, data)], key=_moment)
            if self._listening:
                self._driver.at(now, lambda: self._wake(turn))

    def heard_at(self) -> float:
        return self._heard

    def resume(self) -> None:
        if self._is_gathered:
            self._wake(self._turn)

    def throw(self, error: RunEnded) -> None:
        if self._ending is None and not self.is_ended:
            self._pull(lambda: self._session.throw(error))

    def _pull(self, step: Callable[[], Request]) -> None:
        self._turn += 1
        self._is_gathered = False
        try:
            request = step()
        except StopIteration:
            self.is_ended = True
            self._driver.barrier.ended(self._member)
            return
        try:
            self._do(request)
        except LinkError as error:
            failure = error
            self._is_open = False
            self._pull(lambda: self._session.throw(failure))

    def _do(self, request: Request) -> None:
        now = self._driver.clock.monotonic()
        if isinstance(request, Ask):
            self._check_link(now)
            self._sent = now
            self._coming = sorted(
                [*self._coming, *self._peer.receive(request.data, now)], key=_moment
            )
            self._await(now + request.patience_s, listening=True)
        elif isinstance(request, Listen):
            self._check_link(now)
            self._await(request.until, listening=True)
        elif isinstance(request, Wait):
            self._await(request.until, listening=False)
        elif isinstance(request, Gather):
            self._listening = False
            self._is_gathered = True
            self._driver.barrier.gather(self._member, request)
        else:
            self._is_open = True
            self._coming = []
            self._check_link(now)
            self._await(now, listening=False)

    def _check_link(self, now: float) -> None:
        if self._peer.is_unplugged(now) or not self._is_open:
            raise LinkError("the cable is out")

    def _await(self, until: float, *, listening: bool) -> None:
        self._listening = listening
        turn = self._turn
        moment = until
        if listening and self._coming:
            moment = min(self._coming[0][0], until)
        self._driver.at(moment, lambda: self._wake(turn))

    def _wake(self, turn: int) -> None:
        if turn != self._turn or self.is_ended:
            return
        now = self._driver.clock.monotonic()
        if self._listening and self._peer.is_unplugged(now):
            self._is_open = False
            self._pull(lambda: self._session.throw(LinkError("the cable was pulled out")))
            return
        due = [data for at, data in self._coming if at <= now]
        if self._listening:
            taken: Sequence[bytes] = due[:1]  # a listener gets each piece on arrival
        else:
            taken = _kept(due)
        self._coming = self._coming[len(taken) :]
        if taken:
            self._heard = now
        late_s = self._driver.late_s - self._late_s
        self._late_s = self._driver.late_s
        result = IoResult(now, b"".join(taken), self._sent, late_s)
        self._pull(lambda: self._session.send(result))
