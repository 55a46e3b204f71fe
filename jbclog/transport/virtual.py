"""Sessions on a clock that jumps: an hour of faults in seconds, the same every time. For tests.

Each session talks to a `Peer`, which says what it answers and when those bytes have arrived. The clock goes straight to
the next moment at which anything happens.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from itertools import accumulate, count
from typing import Protocol

from jbclog.core.clock import VirtualClock
from jbclog.core.errors import LinkError
from jbclog.core.io_requests import Ask, Gather, Heard, Listen, Request, RunEnded, Steps, Wait
from jbclog.transport.port import MOST_KEPT
from jbclog.transport.start_barrier import Barrier

NEVER = float("inf")


class Peer(Protocol):
    """The other end of a wire."""

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        """What comes back to `data` written at `now`: bytes, each with the moment at which they are there."""

    def hung_up(self, now: float) -> bool:
        """Whether the cable is out."""


class VirtualDriver:
    """Pulls sessions on `clock`, which it moves on. `goes_on`: those that start do so without the others."""

    def __init__(self, clock: VirtualClock, *, goes_on: bool = False) -> None:
        self.clock = clock
        self._order = count()
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._wires: list[_Wire] = []
        self.late_s = 0.0  # for how long the host stood still so far: time that passed while something was done
        self.barrier = Barrier(clock.monotonic, self.at, goes_on=goes_on)

    def add(self, session: Steps[object], peer: Peer, name: str = "") -> None:
        wire = _Wire(self, session, peer, name)
        self._wires.append(wire)
        self.at(self.clock.monotonic(), wire.start)

    def at(self, moment: float, call: Callable[[], None]) -> None:
        """Do `call` at `moment` (monotonic seconds)."""
        heapq.heappush(self._events, (moment, next(self._order), call))

    def say(self, name: str, data: bytes) -> None:
        """Have `data` come now, unasked, to the session of that name."""
        for wire in self._wires:
            if wire.name == name:
                wire.come(data)

    def end(self, why: str) -> None:
        """End every session; each makes its tools safe before it returns."""
        self.barrier.disband()
        for wire in self._wires:
            wire.end(why)

    def run(self) -> None:
        """Go on until every session has ended."""
        while self._events and not all(wire.is_ended for wire in self._wires):
            moment, _, call = heapq.heappop(self._events)
            self.clock.advance_to(moment)
            began = self.clock.monotonic()
            call()
            self.late_s += self.clock.monotonic() - began


def _moment(coming: tuple[float, bytes]) -> float:
    return coming[0]  # and not the bytes: what is there at one moment keeps its order


def _kept(pieces: Sequence[bytes]) -> Sequence[bytes]:
    """As many as a driver of real ports keeps while nobody listens; the rest waits in the system."""
    so_far = accumulate(map(len, pieces))
    return pieces[: 1 + sum(size < MOST_KEPT for size in so_far)]


class _Wire:
    """One session, its peer, and the bytes under way to it."""

    def __init__(self, driver: VirtualDriver, session: Steps[object], peer: Peer, name: str) -> None:
        self.name = name
        self._driver = driver
        self._session = session
        self._peer = peer
        self._coming: list[tuple[float, bytes]] = []
        self._is_open = False
        self._listening = False
        self._sent = 0.0
        self._turn = 0  # an alarm of an earlier wish is ignored
        self._ending: RunEnded | None = None
        self._heard = 0.0  # when bytes last came
        self._late_s = 0.0  # by which the driver had been late when the session was last told something
        self._is_gathered = False
        self._member = driver.barrier.join(name, self)
        self.is_ended = False

    def start(self) -> None:
        self._pull(lambda: next(self._session))

    def end(self, why: str) -> None:
        if self._ending is None and not self.is_ended:
            self._ending = RunEnded(why)
            self._pull(lambda: self._session.throw(RunEnded(why)))

    def come(self, data: bytes) -> None:
        """Bytes that nobody asked for; lost where the port is not open."""
        if self._is_open and not self.is_ended:
            now, turn = self._driver.clock.monotonic(), self._turn
            self._coming = sorted([*self._coming, (now, data)], key=_moment)
            if self._listening:
                self._driver.at(now, lambda: self._wake(turn))

    def heard_at(self) -> float:
        return self._heard

    def go_on(self) -> None:
        if self._is_gathered:
            self._wake(self._turn)

    def throw(self, error: RunEnded) -> None:
        if self._ending is None and not self.is_ended:
            self._pull(lambda: self._session.throw(error))

    def _pull(self, step: Callable[[], Request]) -> None:
        self._turn += 1
        self._is_gathered = False
        try:
            wish = step()
        except StopIteration:
            self.is_ended = True
            self._driver.barrier.ended(self._member)
            return
        try:
            self._do(wish)
        except LinkError as error:
            failure = error
            self._is_open = False
            self._pull(lambda: self._session.throw(failure))

    def _do(self, wish: Request) -> None:
        now = self._driver.clock.monotonic()
        if isinstance(wish, Ask):
            self._check_link(now)
            self._sent = now
            self._coming = sorted([*self._coming, *self._peer.receive(wish.data, now)], key=_moment)
            self._await(now + wish.patience_s, listening=True)
        elif isinstance(wish, Listen):
            self._check_link(now)
            self._await(wish.until, listening=True)
        elif isinstance(wish, Wait):
            self._await(wish.until, listening=False)
        elif isinstance(wish, Gather):
            self._listening, self._is_gathered = False, True
            self._driver.barrier.gather(self._member, wish)
        else:
            self._is_open, self._coming = True, []
            self._check_link(now)
            self._await(now, listening=False)

    def _check_link(self, now: float) -> None:
        if self._peer.hung_up(now) or not self._is_open:
            raise LinkError("the cable is out")

    def _await(self, until: float, *, listening: bool) -> None:
        self._listening = listening
        first = self._coming[0][0] if listening and self._coming else NEVER
        turn = self._turn
        self._driver.at(min(first, until), lambda: self._wake(turn))

    def _wake(self, turn: int) -> None:
        if turn != self._turn or self.is_ended:
            return
        now = self._driver.clock.monotonic()
        if self._listening and self._peer.hung_up(now):
            self._is_open = False
            self._pull(lambda: self._session.throw(LinkError("the cable was pulled out")))
            return
        due = [data for at, data in self._coming if at <= now]
        taken = due[:1] if self._listening else _kept(due)  # a listener gets each piece as it comes
        self._coming = self._coming[len(taken) :]
        self._heard = now if taken else self._heard
        late_s, self._late_s = self._driver.late_s - self._late_s, self._driver.late_s
        heard = Heard(now, b"".join(taken), self._sent, late_s)
        self._pull(lambda: self._session.send(heard))
