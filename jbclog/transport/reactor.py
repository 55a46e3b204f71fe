"""Hundreds of sessions in one thread: asyncio's event loop as a reactor, without a task or future per question.

The loop watches descriptors and timers; a session is resumed straight from the callback that heard its bytes, and its
next wish is carried out before the callback returns (`session_runner.py`). Opening a port can block, so that happens in a thread.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from heapq import heappop, heappush
from itertools import count

from jbclog.core import clock
from jbclog.core.errors import cause
from jbclog.transport.blocking import OpenPort
from jbclog.transport.event_loop import Beat, Readers, exact_selector
from jbclog.transport.session_runner import NEVER, Session, SessionRunner
from jbclog.transport.start_barrier import Barrier

OPENERS = 8  # ports opened at the same time
ENDING_S = 5.0  # that sessions have for making their tools safe once something broke beside them; then it is the guard's
_now = clock.elapsed  # which the loop is made to run on


class _Loop(asyncio.SelectorEventLoop):
    """Counts the time in which the machine was suspended."""

    def time(self) -> float:
        return _now()


def _as_it_is(moment: float) -> float:
    return moment


class Reactor:
    """Pulls sessions until all have ended."""

    def __init__(self, fast: clock.FastClock | None = None, *, goes_on: bool = False) -> None:
        """The sessions' moments are the host's, or a `fast` clock's. `goes_on`: those that start do so without the others."""
        self.now = fast.monotonic if fast else _now
        self._elapsed_at = fast.elapsed_at if fast else _as_it_is
        self.loop = _Loop(exact_selector())
        self.readers = Readers(self.loop)
        self.openers = ThreadPoolExecutor(OPENERS, thread_name_prefix="open-port")
        self._wires: set[SessionRunner] = set()
        self._alarms: list[tuple[float, int, SessionRunner]] = []  # a heap
        self._order = count()
        self._timer: asyncio.TimerHandle | None = None  # for the first of them
        self.beat = Beat(self.loop, fast.speed if fast else 1.0)
        self._failure: Exception | None = None
        self.loop.set_exception_handler(self._broke)
        self.barrier = Barrier(self.now, self._at, goes_on=goes_on)

    def add(self, session: Session, open_port: OpenPort, name: str = "") -> None:
        """Have `session` pulled; `open_port` is called, in a thread, for each of its wishes to open the port."""
        self._wires.add(SessionRunner(self, session, open_port, name))

    def _at(self, moment: float, call: Callable[[], None]) -> None:
        self.loop.call_at(self._elapsed_at(moment), call)

    def every(self, seconds: float, call: Callable[[], None]) -> None:
        """Call `call` again and again while sessions go on, whatever it raises. It must return at once."""

        def again() -> None:
            self.loop.call_later(seconds, again)
            try:
                call()
            except Exception as error:  # no session waits for it
                self.loop.default_exception_handler({"message": f"{call} failed", "exception": error})

        self.loop.call_later(seconds, again)

    def end(self, why: str) -> None:
        """End every session, once: each makes its tools safe before it returns. From the loop's thread only."""
        self.barrier.disband()
        for wire in list(self._wires):
            wire.end(why)

    def run(self, at_end: Callable[[], None] = lambda: None) -> None:
        """Pull until the last session has ended. Raises what first was raised, in a session or beside it, and should not have been.

        `at_end` is called when all have ended as they should, before ports are waited for whose opening or closing hangs. Whatever
        happened, no port is open afterwards: another process may have to make its tools safe.
        """
        try:
            for wire in list(self._wires):
                self.loop.call_soon(wire.start)
            if self._wires:
                self.beat.start()
                self._turn()
            if self._failure is None:
                at_end()
        finally:
            for wire in self._wires:  # of sessions that have not come to their ends
                wire.let_go()
            self.openers.shutdown()  # which waits until the ports are closed, about a second at the most
            self.readers.close()
            self.loop.close()
        if self._failure is not None:
            raise self._failure

    def _turn(self) -> None:
        """Turn the loop until the last session has ended.

        What breaks beside the sessions (memory is refused, say) may have lost what one of them waits for. All are ended in good
        order then, and those that do not come to their ends within `ENDING_S` are left where they stand.
        """
        end = float("inf")
        while self._wires and _now() < end:
            try:
                if self._failure is not None and end > _now() + ENDING_S:
                    end = _now() + ENDING_S
                    self.loop.call_at(end, self.loop.stop)
                    self.end("the program failed")
                self.loop.run_forever()
            except Exception as error:
                self._failure = self._failure or error

    def _broke(self, loop: asyncio.AbstractEventLoop, context: dict[str, object]) -> None:
        """Something was raised in a callback of the loop."""
        error = context.get("exception")
        self._failure = self._failure or (error if isinstance(error, Exception) else RuntimeError(str(context.get("message"))))
        loop.stop()

    def failed(self, wire: SessionRunner, error: Exception) -> None:
        """The session of `wire` broke, which no session may; the others are ended in good order."""
        self._failure = self._failure or error
        self.ended(wire)
        self.loop.call_soon(self.end, f"a session broke: {cause(error)}")

    def ended(self, wire: SessionRunner) -> None:
        """`wire` has nothing more to pull."""
        self._wires.discard(wire)
        if not self._wires:
            self.loop.stop()

    # One timer of the loop for all wires: on a common grid they wake together, and comparing asyncio's timers is dear.

    def wake_at(self, moment: float, wire: SessionRunner) -> None:
        """Call `wire.on_time(moment)` at `moment`. Nothing is ever taken back: a wire knows which of its alarms counts."""
        heappush(self._alarms, (moment, next(self._order), wire))
        self._set_timer()

    def _set_timer(self) -> None:
        first = self._alarms[0][0] if self._alarms else NEVER
        ring_at = self._elapsed_at(first)
        if self._timer is not None:
            if self._timer.when() <= ring_at:
                return
            self._timer.cancel()
        self._timer = self.loop.call_at(ring_at, self._ring) if self._alarms else None

    def _ring(self) -> None:
        now, alarms = self.now(), self._alarms
        try:
            while alarms and alarms[0][0] <= now:
                moment, _, wire = heappop(alarms)
                wire.on_time(moment)
        finally:
            self._timer = None
            self._set_timer()
