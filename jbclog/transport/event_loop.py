"""The reactor's event loop: one epoll for all ports, a heap of alarms, and a queue of calls.

epoll counts whole milliseconds and rounds up, so a wait would end half a millisecond late on
average. Here select(), which counts microseconds, waits for the remaining fraction and watches one
descriptor: that of epoll.

A system without epoll records nothing (`core.operating_system.expect_epoll`).
"""

from __future__ import annotations

import os
import select
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from heapq import heappop, heappush
from itertools import count
from typing import Final

from jbclog.core import clock

WATCHED_BY_SELECT = 1024  # select() cannot watch descriptors from here on
LONGEST_S = 3600.0  # of a wait
WAKE_UPS = 4096  # most wake-up bytes read at once

Ring = Callable[[float], object]
"""Alarm handler; called with the moment it was set for."""


class Handle:
    """A scheduled call."""

    __slots__ = ("_arguments", "_call")

    def __init__(self, call: Callable[..., object], arguments: tuple[object, ...]) -> None:
        self._call: Callable[..., object] | None = call
        self._arguments = arguments

    def __call__(self, _moment: float = 0.0) -> None:
        if self._call is not None:
            self._call(*self._arguments)

    def cancel(self) -> None:
        """Drop the call if it has not been made."""
        self._call = None
        self._arguments = ()


class EventLoop:
    """The loop. Its methods are named as asyncio's; `wake_at` is its own. Moments are those of
    `clock.elapsed`, in seconds.

    Call every method but `call_soon_threadsafe` in the loop's thread only.
    """

    def __init__(self) -> None:
        self._epoll = select.epoll()
        self._readers: dict[int, Callable[[], object]] = {}
        self._alarms: list[tuple[float, int, Ring]] = []  # a heap; equal moments in their order
        self._number = count()
        self._soon: deque[Handle] = deque()
        self._is_stopped = False
        out, into = os.pipe()
        self._wake_out = os.fdopen(out, "rb", buffering=0)
        self._wake_in = os.fdopen(into, "wb", buffering=0)
        os.set_blocking(out, False)
        os.set_blocking(into, False)
        self.add_reader(out, lambda: self._wake_out.read(WAKE_UPS))

    def call_soon(self, call: Callable[..., object], *arguments: object) -> Handle:
        """Schedule a call for the next turn."""
        handle = Handle(call, arguments)
        self._soon.append(handle)
        return handle

    def call_at(self, when: float, call: Callable[..., object], *arguments: object) -> Handle:
        """Schedule a call at a moment."""
        handle = Handle(call, arguments)
        self.wake_at(when, handle)
        return handle

    def call_later(self, delay: float, call: Callable[..., object], *arguments: object) -> Handle:
        """Schedule a call after `delay` seconds."""
        return self.call_at(clock.elapsed() + delay, call, *arguments)

    def wake_at(self, moment: float, ring: Ring) -> None:
        """Schedule ``ring(moment)``: cheaper than `call_at`, and cannot be cancelled."""
        heappush(self._alarms, (moment, next(self._number), ring))

    def call_soon_threadsafe(self, call: Callable[..., object], *arguments: object) -> None:
        """Schedule a call from any thread or signal handler. Raises `RuntimeError` once the loop is
        closed.
        """
        if self._wake_in.closed:
            raise RuntimeError("the event loop is closed")
        self._soon.append(Handle(call, arguments))
        with suppress(OSError, ValueError):  # closed meanwhile
            self._wake_in.write(b"\0")  # a full pipe wakes the loop as well

    def add_reader(self, fd: int, call: Callable[[], object]) -> None:
        """Call `call` whenever the descriptor is readable or broken."""
        self._epoll.register(fd, select.EPOLLIN)
        self._readers[fd] = call

    def remove_reader(self, fd: int) -> None:
        """Stop watching a descriptor; call it before closing the descriptor."""
        del self._readers[fd]
        self._epoll.unregister(fd)

    def run_forever(self) -> None:
        """Run until `stop`. Raises whatever a call raised; run again to continue with the other
        calls.
        """
        readers = self._readers
        alarms = self._alarms
        soon = self._soon
        elapsed = clock.elapsed
        now = elapsed()
        try:
            while not self._is_stopped:
                left_s = LONGEST_S
                if soon:
                    left_s = 0.0
                elif alarms:
                    left_s = alarms[0][0] - now
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
        """Make `run_forever` return at the end of this turn; if it is not running, at its next
        call.
        """
        self._is_stopped = True

    def close(self) -> None:
        """Release the loop's descriptors."""
        self._epoll.close()
        self._wake_out.close()
        self._wake_in.close()

    def _call_due(self, now: float) -> None:
        while self._alarms and self._alarms[0][0] <= now:
            moment, _, ring = heappop(self._alarms)
            ring(moment)
        for _ in range(len(self._soon)):
            self._soon.popleft()()

    def _wait(self, left_s: float) -> list[tuple[int, int]]:
        """Return the readable descriptors, after `left_s` at the latest.

        Waits for whole milliseconds only; the next call waits for the rest.
        """
        if left_s >= 0.001:
            whole_ms = int(min(left_s, LONGEST_S) * 1000)
            return self._epoll.poll((whole_ms - 0.5) / 1000)  # rounded up by epoll
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
