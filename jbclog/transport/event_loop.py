"""What the reactor adds to asyncio: exact waits, the loop's lag, signals.

epoll counts whole milliseconds and rounds up, so each wait ends half a millisecond late on average. Here the rest of a wait
is left to select(), which counts microseconds and watches one descriptor: that of epoll.
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

WATCHED_BY_SELECT = 1024  # select() cannot watch descriptors from here on

if sys.platform == "linux":

    class _ExactEpoll(selectors.EpollSelector):
        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """Return what is ready; nothing after `timeout` seconds or earlier, after which asyncio waits for the rest."""
            if timeout is None or timeout <= 0 or self.fileno() >= WATCHED_BY_SELECT:
                return super().select(timeout)
            whole_ms = int(timeout * 1000)
            if whole_ms:
                return super().select((whole_ms - 0.5) / 1000)  # rounded up by epoll
            return super().select(0) if select.select([self], [], [], timeout)[0] else []


def exact_selector() -> selectors.BaseSelector | None:
    """Return a selector for asyncio's loop; None where the loop's own is exact enough."""
    return _ExactEpoll() if sys.platform == "linux" else None


class Readers:
    """Calls back for every descriptor that is readable.

    On Linux asyncio watches one descriptor only: an epoll of our own with all the others in it. asyncio's handle, context and list
    entry for each answer would cost as much as reading it.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._ready: dict[int, Callable[[], None]] = {}
        self._epoll = select.epoll() if sys.platform == "linux" else None
        if self._epoll is not None:
            loop.add_reader(self._epoll.fileno(), self._call_ready)

    def add(self, descriptor: int, ready: Callable[[], None]) -> None:
        """Call `ready` in the loop's thread whenever `descriptor` is readable or broken."""
        if self._epoll is None:
            self._loop.add_reader(descriptor, ready)
            return
        self._epoll.register(descriptor, select.EPOLLIN)
        self._ready[descriptor] = ready

    def remove(self, descriptor: int) -> None:
        """Stop watching `descriptor`; call it before closing the descriptor."""
        if self._epoll is None:
            self._loop.remove_reader(descriptor)
            return
        del self._ready[descriptor]
        self._epoll.unregister(descriptor)

    def close(self) -> None:
        """Release the epoll; call it before closing the loop."""
        if self._epoll is not None:
            self._loop.remove_reader(self._epoll.fileno())
            self._epoll.close()

    def _call_ready(self) -> None:
        if self._epoll is None:
            return
        for descriptor, _ in self._epoll.poll(0):
            ready = self._ready.get(descriptor)  # an earlier callback may have removed it
            if ready is not None:
                ready()


BEAT_S: Final = 0.05
NOTED_S: Final = 0.005  # on a machine with time to spare timers are less late


class LoopLag:
    """Measures by how much the loop is late, with a timer each `BEAT_S`.

    A session that receives bytes late cannot know whether the station or the computer was late; a timer waits for no station.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._late_s = 0.0
        self._due_s = float("inf")  # in the loop's time

    def start(self) -> None:
        """Start the timer; call it once, before the loop runs."""
        self._due_s = self._loop.time() + BEAT_S
        self._loop.call_at(self._due_s, self._beat)

    def late_s(self) -> float:
        """Total time by which the loop was late so far."""
        late = self._loop.time() - self._due_s
        return self._late_s + late if late > NOTED_S else self._late_s

    def _beat(self) -> None:
        self._late_s = self.late_s()
        self._due_s = self._loop.time() + BEAT_S
        self._loop.call_at(self._due_s, self._beat)


OnSignal = Callable[[signal.Signals], None]


class Signals:
    """Handles the signals `heard` and ignores those in `ignored` during a ``with``, in the main thread only.

    Signals that arrive before `notify` are kept. With `stay_ignored` all of them stay ignored afterwards, while the program prints
    its result.
    """

    def __init__(
        self, heard: Collection[signal.Signals], ignored: Collection[signal.Signals] = (), *, stay_ignored: bool = False
    ) -> None:
        self._stay_ignored = stay_ignored
        self._heard = heard
        self._ignored = ignored
        self._before: dict[signal.Signals, object] = {}
        self._early: list[signal.Signals] = []
        self._on_notify: OnSignal | None = None

    def __enter__(self) -> Self:
        for number in self._heard:
            self._before[number] = signal.signal(number, self._on_signal)
        for number in self._ignored:
            self._before[number] = signal.signal(number, signal.SIG_IGN)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, before in self._before.items():
            signal.signal(number, signal.SIG_IGN if self._stay_ignored else before)  # type: ignore[arg-type]  # the previous handler

    def notify(self, notify: OnSignal) -> None:
        """Call `notify` for each signal so far and from now on, between two instructions of the main thread."""
        self._on_notify = notify
        while self._early:
            notify(self._early.pop(0))

    def _on_signal(self, number: int, _frame: FrameType | None) -> None:
        if self._on_notify is None:
            self._early.append(signal.Signals(number))
        else:
            self._on_notify(signal.Signals(number))
