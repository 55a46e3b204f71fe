"""The reactor's event loop: one epoll for all ports, a heap of alarms, and a queue of calls.

epoll counts whole milliseconds and rounds up, so a wait would end half a millisecond late on
average. Here select(), which counts microseconds, waits for the remaining fraction and watches one
descriptor: that of epoll.

Without epoll, asyncio's loop does the same work (`asyncio_loop.py`).
"""

from __future__ import annotations

import os
import select
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from heapq import heappop, heappush
from itertools import count
from typing import Final, Protocol

from jbclog.core import clock

WATCHED_BY_SELECT = 1024  # select() cannot watch descriptors from here on
LONGEST_S = 3600.0  # of a wait
WAKE_UPS = 4096  # most wake-up bytes read at once

Ring = Callable[[float], object]
"""Alarm handler; called with the moment it was set for."""


class Handle(Protocol):
    """A scheduled call."""

    def cancel(self) -> None:
        """Drop the call if it has not been made."""


class EventLoop(Protocol):
    """A subset of asyncio's interface, plus `wake_at`. Moments are those of `clock.elapsed`, in
    seconds.

    Call every method but `call_soon_threadsafe` in the loop's thread only.
    """

    def call_soon(self, call: Callable[..., object], *arguments: object) -> Handle:
        """Schedule a call for the next turn."""

    def call_at(self, when: float, call: Callable[..., object], *arguments: object) -> Handle:
        """Schedule a call at a moment."""

    def call_later(self, delay: float, call: Callable[..., object], *arguments: object) -> Handle:
        """Schedule a call after `delay` seconds."""

    def wake_at(self, moment: float, ring: Ring) -> None:
        """Schedule ``ring(moment)``: cheaper than `call_at`, and cannot be cancelled."""

    def call_soon_threadsafe(self, call: Callable[..., object], *arguments: object) -> object:
        """Schedule a call from any thread or signal handler. Raises `RuntimeError` once the loop is
        closed.
        """

    def add_reader(self, fd: int, call: Callable[[], object]) -> object:
        """Call `call` whenever the descriptor is readable or broken."""

    def remove_reader(self, fd: int) -> object:
        """Stop watching a descriptor; call it before closing the descriptor."""

    def run_forever(self) -> None:
        """Run until `stop`. Raises whatever a call raised; run again to continue with the other
        calls.
        """

    def stop(self) -> None:
        """Make `run_forever` return at the end of this turn; if it is not running, at its next
        call.
        """

    def close(self) -> None:
        """Release the loop's descriptors."""


class _Call:
    """A call that can be cancelled."""

    __slots__ = ("_arguments", "_call")

    def __init__(self, call: Callable[..., object], arguments: tuple[object, ...]) -> None:
        self._call: Callable[..., object] | None = call
        self._arguments = arguments

    def __call__(self, _moment: float = 0.0) -> None:
        if self._call is not None:
            self._call(*self._arguments)

    def cancel(self) -> None:
        self._call, self._arguments = None, ()


if sys.platform == "linux":

    class EpollLoop:
        """The loop on Linux."""

        def __init__(self) -> None:
            self._epoll = select.epoll()
            self._readers: dict[int, Callable[[], object]] = {}
            self._alarms: list[tuple[float, int, Ring]] = []  # a heap; equal moments in their order
            self._number = count()
            self._soon: deque[_Call] = deque()
            self._is_stopped = False
            out, into = os.pipe()
            self._wake_out, self._wake_in = (
                os.fdopen(out, "rb", buffering=0),
                os.fdopen(into, "wb", buffering=0),
            )
            for end in (self._wake_out, self._wake_in):
                os.set_blocking(end.fileno(), False)
            self.add_reader(out, lambda: self._wake_out.read(WAKE_UPS))

        def call_soon(self, call: Callable[..., object], *arguments: object) -> Handle:
            self._soon.append(one := _Call(call, arguments))
            return one

        def call_at(self, when: float, call: Callable[..., object], *arguments: object) -> Handle:
            self.wake_at(when, one := _Call(call, arguments))
            return one

        def call_later(
            self, delay: float, call: Callable[..., object], *arguments: object
        ) -> Handle:
            return self.call_at(clock.elapsed() + delay, call, *arguments)

        def wake_at(self, moment: float, ring: Ring) -> None:
            heappush(self._alarms, (moment, next(self._number), ring))

        def call_soon_threadsafe(self, call: Callable[..., object], *arguments: object) -> None:
            if self._wake_in.closed:
                raise RuntimeError("the event loop is closed")
            self._soon.append(_Call(call, arguments))
            with suppress(OSError, ValueError):  # closed meanwhile
                self._wake_in.write(b"\0")  # a full pipe wakes the loop as well

        def add_reader(self, fd: int, call: Callable[[], object]) -> None:
            self._epoll.register(fd, select.EPOLLIN)
            self._readers[fd] = call

        def remove_reader(self, fd: int) -> None:
            del self._readers[fd]
            self._epoll.unregister(fd)

        def run_forever(self) -> None:
            readers, alarms, soon, elapsed = self._readers, self._alarms, self._soon, clock.elapsed
            now = elapsed()
            try:
                while not self._is_stopped:
                    left_s = 0.0 if soon else alarms[0][0] - now if alarms else LONGEST_S
                    for descriptor, _ in self._wait(left_s):
                        ready = readers.get(descriptor)  # an earlier call may have removed it
                        if ready is not None:
                            ready()
                    now = elapsed()
                    if soon or (alarms and alarms[0][0] <= now):
                        self._call_due(now)
                        now = elapsed()
            finally:
                self._is_stopped = False

        def stop(self) -> None:
            self._is_stopped = True

        def close(self) -> None:
            self._epoll.close()
            self._wake_out.close()
            self._wake_in.close()

        def _call_due(self, now: float) -> None:
            alarms, soon = self._alarms, self._soon
            while alarms and alarms[0][0] <= now:
                moment, _, ring = heappop(alarms)
                ring(moment)
            for _ in range(len(soon)):
                soon.popleft()()

        def _wait(self, left_s: float) -> list[tuple[int, int]]:
            """Return the readable descriptors, after `left_s` at the latest.

            Waits for whole milliseconds only; the next call waits for the rest.
            """
            if left_s > LONGEST_S:
                left_s = LONGEST_S
            if left_s >= 0.001:
                return self._epoll.poll((int(left_s * 1000) - 0.5) / 1000)  # rounded up by epoll
            descriptor = self._epoll.fileno()
            if (
                left_s > 0
                and descriptor < WATCHED_BY_SELECT
                and not select.select((descriptor,), (), (), left_s)[0]
            ):
                return []
            return self._epoll.poll(0)


BEAT_S: Final = 0.05
NOTED_S: Final = 0.005  # on an idle machine timers are less late


class LoopLag:
    """Measures how late the loop is, with a timer every `BEAT_S`.

    A session that receives bytes late cannot know whether the station or the computer was late; a
    timer depends on no station.
    """

    __slots__ = ("_due_s", "_loop", "noted_after_s", "noted_s")

    def __init__(self, loop: EventLoop) -> None:
        self._loop = loop
        self.noted_s = 0.0  # what `late_s` returns until `noted_after_s`
        self._due_s = self.noted_after_s = float("inf")

    def start(self) -> None:
        """Start the timer, once, before the loop runs."""
        self._next(clock.elapsed())

    def late_s(self, now: float) -> float:
        """Return the loop's total lateness until `now`, in seconds."""
        return self.noted_s if now <= self.noted_after_s else self.noted_s + now - self._due_s

    def _beat(self, _moment: float) -> None:
        now = clock.elapsed()
        self.noted_s = self.late_s(now)
        self._next(now)

    def _next(self, now: float) -> None:
        self._due_s = now + BEAT_S
        self.noted_after_s = self._due_s + NOTED_S
        self._loop.wake_at(self._due_s, self._beat)
