"""asyncio's event loop as the reactor needs it: exact waits, its lag, the system's signals.

Waits that end when they should: epoll counts whole milliseconds and rounds up, which is late by half of one each time.

Where the selector is epoll, the rest of a wait has select(), which counts microseconds and can watch one descriptor:
epoll's own.
"""

from __future__ import annotations

import asyncio
import select
import selectors
import signal
import sys
from collections.abc import Callable, Collection
from types import FrameType, TracebackType
from typing import Final, Self

# -- event loop ---------------------------------------------------------------------------------------------------------------

WATCHED_BY_SELECT = 1024  # descriptors from here on select() cannot watch

if sys.platform == "linux":

    class _ExactEpoll(selectors.EpollSelector):
        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """What is ready, or nothing at the end of `timeout` seconds, or nothing before: asyncio asks again for the rest."""
            if timeout is None or timeout <= 0 or self.fileno() >= WATCHED_BY_SELECT:
                return super().select(timeout)
            whole_ms = int(timeout * 1000)
            if whole_ms:
                return super().select((whole_ms - 0.5) / 1000)  # which it rounds up
            return super().select(0) if select.select([self], [], [], timeout)[0] else []


def exact_selector() -> selectors.BaseSelector | None:
    """A selector for asyncio's loop; None for the loop's own where that is exact enough."""
    return _ExactEpoll() if sys.platform == "linux" else None


class Readers:
    """Calls back for every descriptor that has something to read.

    Where there is epoll, asyncio watches one descriptor only: an epoll of ours with all the others in it. A handle, a
    context and a list entry for each answer would cost as much as reading it.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._ready: dict[int, Callable[[], None]] = {}
        self._epoll = select.epoll() if sys.platform == "linux" else None
        if self._epoll is not None:
            loop.add_reader(self._epoll.fileno(), self._call_ready)

    def add(self, descriptor: int, ready: Callable[[], None]) -> None:
        """Call `ready` in the loop's thread whenever `descriptor` can be read, or is broken."""
        if self._epoll is None:
            self._loop.add_reader(descriptor, ready)
            return
        self._epoll.register(descriptor, select.EPOLLIN)
        self._ready[descriptor] = ready

    def remove(self, descriptor: int) -> None:
        """Before it is closed."""
        if self._epoll is None:
            self._loop.remove_reader(descriptor)
            return
        del self._ready[descriptor]
        self._epoll.unregister(descriptor)

    def close(self) -> None:
        """Before the loop is closed."""
        if self._epoll is not None:
            self._loop.remove_reader(self._epoll.fileno())
            self._epoll.close()

    def _call_ready(self) -> None:
        if self._epoll is None:
            return
        for descriptor, _ in self._epoll.poll(0):
            ready = self._ready.get(descriptor)  # one of those called before may have taken it out
            if ready is not None:
                ready()


# -- loop lag -----------------------------------------------------------------------------------------------------------------
# Whether the loop comes round: a beat that is due at known moments, and by how much it came late.
#
# What a session hears late may be the station's or the computer's. Only the loop knows: a beat waits for no station.

BEAT_S: Final = 0.05
NOTED_S: Final = 0.005  # timers of a machine with time to spare are not later than this


class Beat:
    """Beats on `loop` each `BEAT_S`. Sessions may live on a clock that goes `speed` times as fast, and are late on that."""

    def __init__(self, loop: asyncio.AbstractEventLoop, speed: float = 1.0) -> None:
        self._loop = loop
        self._speed = speed
        self._late_s = 0.0
        self._due_s = float("inf")  # in the loop's time

    def start(self) -> None:
        """Begin; to be called once, before the loop runs."""
        self._due_s = self._loop.time() + BEAT_S
        self._loop.call_at(self._due_s, self._beat)

    def late_s(self) -> float:
        """For how long the loop has not come round so far, all times together, in the sessions' seconds."""
        late = self._loop.time() - self._due_s
        return self._late_s + late * self._speed if late > NOTED_S else self._late_s

    def _beat(self) -> None:
        self._late_s = self.late_s()
        self._due_s = self._loop.time() + BEAT_S
        self._loop.call_at(self._due_s, self._beat)


# -- signals ------------------------------------------------------------------------------------------------------------------
# The system's signals, heard from the first moment on: one that comes before there is anybody to tell is told later.

Tell = Callable[[signal.Signals], None]


class Signals:
    """Hears the signals `heard` and lets nothing come of those `ignored`, while a ``with`` lasts. In the main thread only.

    With `for_good` nothing comes of any of them afterwards either: what is left of the program is its last words.
    """

    def __init__(
        self, heard: Collection[signal.Signals], ignored: Collection[signal.Signals] = (), *, for_good: bool = False
    ) -> None:
        self._for_good = for_good
        self._heard = heard
        self._ignored = ignored
        self._before: dict[signal.Signals, object] = {}
        self._early: list[signal.Signals] = []
        self._tell: Tell | None = None

    def __enter__(self) -> Self:
        for number in self._heard:
            self._before[number] = signal.signal(number, self._on_signal)
        for number in self._ignored:
            self._before[number] = signal.signal(number, signal.SIG_IGN)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._for_good else before)  # type: ignore[arg-type]  # it was there before

    def tell(self, tell: Tell) -> None:
        """Call `tell` for each that came so far and each that comes, between two instructions of the main thread."""
        self._tell = tell
        while self._early:
            tell(self._early.pop(0))

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if self._tell is None:
            self._early.append(signal.Signals(number))
        else:
            self._tell(signal.Signals(number))
