"""Runs hundreds of sessions in one thread: an event loop as a reactor, without a task or future per
request.

Each session has a `SessionRunner`, which carries out its requests (`session_runner.py`): the loop
calls it when bytes or an alarm are there; it resumes the session with them and carries out the next
request before it returns. Opening a port can block, so it happens in a thread.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from math import inf

from jbclog.core import clock
from jbclog.core.errors import cause, unexpected_error_text
from jbclog.transport.blocking import OpenPort
from jbclog.transport.event_loop import EventLoop, LoopLag
from jbclog.transport.session_runner import Session, SessionRunner, Shared
from jbclog.transport.start_barrier import Barrier

OPENERS = 8  # ports opened at the same time
# for sessions to make their tools safe after a failure of the program; then it is the guard's job
ENDING_S = 5.0
MOST_REPORTED = 10  # errors of periodic calls
_log = logging.getLogger(__name__)


class Reactor:
    """Runs sessions until all have ended."""

    def __init__(
        self, *, allow_missing: bool = False, report: Callable[[str], None] = _log.error
    ) -> None:
        """`allow_missing`: sessions that are ready start without the others. `report` gets the
        first of equal errors of periodic calls.
        """
        self._now = clock.elapsed
        self.loop = EventLoop()
        self._lag = LoopLag(self.loop)
        self._openers = ThreadPoolExecutor(OPENERS, thread_name_prefix="open-port")
        self._barrier = Barrier(self._now, self.loop.call_at, allow_missing=allow_missing)
        self._shared = Shared(self.loop, self._lag, self._openers, self._barrier, self._on_ended)
        self._runners: set[SessionRunner] = set()
        self._failure: Exception | None = None
        self._report = report
        self._reported: set[str] = set()

    def add(self, session: Session, open_port: OpenPort, name: str = "") -> None:
        """Add a session; `open_port` is called in a thread for each `Reopen`."""
        self._runners.add(SessionRunner(self._shared, session, open_port, name))

    def every(self, seconds: float, call: Callable[[], None], what: str) -> None:
        """Call `call` periodically while sessions run, whatever it raises. It must return quickly.
        `what` it does begins the report of an error.
        """

        def again() -> None:
            self.loop.call_later(seconds, again)
            try:
                call()
            except Exception as error:  # no session depends on it
                with suppress(Exception):
                    self._report_once(
                        f"{what}: internal error, {unexpected_error_text(error)}", error
                    )

        self.loop.call_later(seconds, again)

    def _report_once(self, text: str, error: Exception) -> None:
        if text in self._reported or len(self._reported) == MOST_REPORTED:
            return
        self._reported.add(text)
        wants_traceback = os.environ.get("JBCLOG_TRACEBACK")
        _log.log(logging.ERROR if wants_traceback else logging.DEBUG, text, exc_info=error)
        self._report(text)

    def end(self, why: str) -> None:
        """End every session, once: each makes its tools safe before it returns. Call it from the
        loop's thread.
        """
        self._barrier.disband()
        for runner in list(self._runners):
            runner.end(why)

    def run(self, at_end: Callable[[], None] = lambda: None) -> None:
        """Run until the last session has ended. Raises the first unexpected exception, of a session
        or the program.

        `at_end` is called when all sessions have ended normally, before waiting for ports whose
        opening or closing hangs. In any case every port is closed on return, because another
        process may have to make the tools safe.
        """
        try:
            for runner in list(self._runners):
                self.loop.call_soon(runner.start)
            if self._runners:
                self._lag.start()
                self._run_loop()
            if self._failure is None:
                at_end()
        finally:
            for runner in self._runners:  # sessions that have not ended
                runner.let_go()
            self._openers.shutdown()  # waits until the ports are closed, about a second at most
            self.loop.close()
        if self._failure is not None:
            raise self._failure

    def _run_loop(self) -> None:
        """Run the loop until the last session has ended.

        A failure outside the sessions (no memory, say) may have lost a callback that a session
        waits for. Then all are ended in order, and those that do not end within `ENDING_S` are
        abandoned.
        """
        abandon_at = inf
        while self._runners and self._now() < abandon_at:
            try:
                if self._failure is not None and abandon_at == inf:
                    abandon_at = self._now() + ENDING_S
                    self.loop.call_at(abandon_at, self.loop.stop)
                    self.end("the program failed")
                self.loop.run_forever()
            except Exception as error:
                self._failure = self._failure or error

    def _on_ended(self, runner: SessionRunner, error: Exception | None) -> None:
        """Remove a session that has ended; stop after the last. If it raised an exception, which
        none may, end the others in order.
        """
        self._runners.discard(runner)
        if error is not None:
            self._failure = self._failure or error
            self.loop.call_soon(self.end, f"a session broke: {cause(error)}")
        if not self._runners:
            self.loop.stop()
