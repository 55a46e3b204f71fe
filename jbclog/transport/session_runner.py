"""Runs one session on its port, in the reactor's loop.

1. The loop calls `_on_readable` when bytes are there and `_on_time` at the request's deadline.
2. Either resumes the session with the result (`_answer`) and performs its next request (`_pull`)
   before it returns. There is no other way from bytes to the next request.
3. Bytes that arrive while the session does not listen are kept, about `MOST_KEPT` of them.
4. Opening and closing a port can block, so both happen in a thread. The end of the run waits until
   the port is open.
5. A request that fails at once throws its error in the next turn of the loop, so that a session
   cannot keep the others waiting.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass

from jbclog.core import clock
from jbclog.core.errors import LinkError, cause
from jbclog.core.io_requests import (
    Ask,
    Gather,
    IoResult,
    Listen,
    Reopen,
    Request,
    RunEnded,
    Steps,
    Wait,
)
from jbclog.transport.blocking import NOT_OPEN, OpenPort
from jbclog.transport.event_loop import EventLoop, Handle, LoopLag
from jbclog.transport.port import CLOSED, MOST_KEPT, REST_S, Budget, Port
from jbclog.transport.port_thread import with_descriptor
from jbclog.transport.start_barrier import Barrier

NEVER = float("inf")

Session = Steps[object]


@dataclass(frozen=True, slots=True)
class Shared:
    """What the runners of a reactor share. `ended` is called once for each, with the exception of a
    session that raised one.
    """

    loop: EventLoop
    lag: LoopLag
    openers: Executor
    barrier: Barrier
    ended: Callable[[SessionRunner, Exception | None], None]


class SessionRunner:
    """One session and its port."""

    def __init__(self, shared: Shared, session: Session, open_port: OpenPort, name: str) -> None:
        self._shared = shared
        self._loop = shared.loop
        self._lag = shared.lag
        self._now = clock.elapsed
        self._session = session
        self._send = session.send
        self._throw = session.throw
        self._open_port = open_port
        self._member = shared.barrier.join(name, self)
        # the session
        self._is_started = False
        self._is_ending = False  # the run's end was thrown
        self._is_ended = False
        self._ending: RunEnded | None = None  # the run's end, kept while the port is being opened
        # its request
        self._sent = 0.0
        self._is_listening = False
        self._is_gathered = False  # waits for the other sessions
        self._is_opening = False
        self._failure: LinkError | None = None  # of a request that failed at once
        self._deadline = NEVER
        self._armed = NEVER  # moment of the next valid alarm
        self._late_s = 0.0  # total lateness of the loop at the last result
        # its port
        self._port: Port | None = None
        self._descriptor = CLOSED
        self._broken: LinkError | None = None  # found between requests; raised at the next one
        self._is_watched = False  # the port is read as soon as bytes arrive
        self._pause: Handle | None = None  # the end of a pause in reading
        self._budget = Budget()
        self._unasked = b""
        self._heard_at = 0.0

    # -- the session -------------------------------------------------------------------------------

    def start(self) -> None:
        if not self._is_started:
            self._is_started = True
            self._pull(self._send, None)

    def end(self, why: str) -> None:
        """Throw the run's end into the session, once."""
        self.start()  # a coroutine that has not started cannot catch an exception
        if self._is_ending or self._is_ended:
            return
        self._is_ending = True
        self._throw_end(RunEnded(why))

    def throw(self, error: RunEnded) -> None:
        """Throw `error`: the run does not start, or starts without this session."""
        if not (self._is_ended or self._is_ending):
            self._throw_end(error)

    def resume(self) -> None:
        """Resume after `Gather`: the other sessions are ready."""
        if self._is_gathered:
            self._answer(self._now(), self._take_unasked())

    def heard_at(self) -> float:
        """Return when bytes last arrived."""
        return self._heard_at

    def let_go(self) -> None:
        """Release the port, whatever the session is doing."""
        if not self._is_started:
            self._session.close()  # a coroutine that is dropped before it has begun would warn
        port = self._port
        try:
            self._drop_port()
        except Exception:  # no thread, or no memory for one
            if port is not None:
                port.close()

    def _throw_end(self, error: RunEnded) -> None:
        if self._is_opening:
            self._ending = error
        else:
            self._pull(self._throw, error)

    def _answer(self, now: float, data: bytes) -> None:
        """Resume the session with the result of its request."""
        late_s = self._lag.late_s(now)
        heard = IoResult(now, data, self._sent, late_s - self._late_s)
        self._late_s = late_s
        self._pull(self._send, heard)

    def _pull(self, advance: Callable[..., Request], argument: object) -> None:
        """Resume the session, by its `send` or its `throw`, and perform its next request."""
        self._is_listening = False
        self._is_gathered = False
        self._failure = None
        self._deadline = NEVER
        try:
            request = advance(argument)
        except StopIteration:
            self._finish(None)
            return
        except Exception as error:
            self._finish(error)
            return
        if isinstance(request, Ask):
            self._ask(request)
        elif isinstance(request, Listen):
            self._listen(request)
        elif isinstance(request, Wait):
            self._watch()
            self._arm(request.until)
        elif isinstance(request, Gather):
            self._is_gathered = True
            self._shared.barrier.gather(self._member, request)
        elif isinstance(request, Reopen):
            self._reopen()

    def _finish(self, error: Exception | None) -> None:
        self._is_ended = True
        self._armed = NEVER
        self._drop_port()
        self._shared.barrier.ended(self._member)
        self._shared.ended(self, error)

    # -- its requests ------------------------------------------------------------------------------

    def _ask(self, request: Ask) -> None:
        port = self._port
        if port is None:
            self._fail_soon(self._broken or LinkError(NOT_OPEN))
            return
        data, patience_s = request
        # before writing: afterwards this thread may have to wait for the GIL
        sent = self._now()
        self._sent = sent
        try:
            port.write(data)
        except LinkError as error:
            self._drop_port()
            self._fail_soon(error)
            return
        self._is_listening = True
        self._budget.reads = 0
        if not self._is_watched:
            self._watch()
        self._arm(sent + patience_s)

    def _listen(self, request: Listen) -> None:
        if self._port is None:
            self._fail_soon(self._broken or LinkError(NOT_OPEN))
            return
        self._is_listening = True
        if self._unasked:
            self._arm(0.0)
            return
        self._watch()
        self._arm(request.until)

    def _fail_soon(self, error: LinkError) -> None:
        self._failure = error
        self._arm(self._now())

    def _arm(self, deadline: float) -> None:
        """Wake at `deadline`. An earlier alarm stays, and sets the next one when it fires."""
        self._deadline = deadline
        if deadline < self._armed:
            self._armed = deadline
            self._loop.wake_at(deadline, self._on_time)

    def _on_time(self, armed: float) -> None:
        """Handle the alarm set for `armed`. Alarms are never cancelled."""
        if armed != self._armed:
            return  # superseded by an earlier one
        self._armed = NEVER
        now = self._now()
        if self._failure is not None:
            self._pull(self._throw, self._failure)
        elif now < self._deadline:
            self._arm(self._deadline)
        else:
            self._answer(now, self._take_unasked())

    # -- bytes -------------------------------------------------------------------------------------

    def _on_readable(self) -> None:
        assert self._port is not None  # the loop watches no other
        try:
            data = self._port.read_now()
        except LinkError as error:
            self._drop_port()
            self._broken = error
            if self._is_listening:
                self._pull(self._throw, error)
            return
        if not data:
            return
        now = self._now()
        self._heard_at = now
        if self._budget.is_spent(len(data)):
            self._pause_reading()
        if self._is_listening:
            self._answer(now, data)
            return
        self._unasked += data
        if len(self._unasked) >= MOST_KEPT:
            self._unwatch()

    def _take_unasked(self) -> bytes:
        unasked = self._unasked
        self._unasked = b""
        return unasked

    def _pause_reading(self) -> None:
        """Pause reading: too many bytes arrive to be answers."""
        self._unwatch()
        if self._pause is None:
            self._pause = self._loop.call_later(REST_S, self._end_pause)

    def _end_pause(self) -> None:
        self._pause = None
        if self._is_listening or len(self._unasked) < MOST_KEPT:
            self._watch()

    def _watch(self) -> None:
        """Read the port as soon as bytes arrive, unless reading is paused."""
        if self._is_watched or self._pause is not None or self._port is None:
            return
        self._is_watched = True
        self._loop.add_reader(self._descriptor, self._on_readable)

    def _unwatch(self) -> None:
        if self._is_watched:
            self._is_watched = False
            self._loop.remove_reader(self._descriptor)

    # -- opening and closing -----------------------------------------------------------------------

    def _reopen(self) -> None:
        closing = self._drop_port()
        self._is_opening = True
        future = self._shared.openers.submit(self._open, closing)
        future.add_done_callback(
            lambda done: self._loop.call_soon_threadsafe(self._on_opened, done)
        )

    def _open(self, closing: Future[None] | None) -> Port:
        """Open the port once the old one is closed, which locks it. Runs in a thread."""
        if closing is not None:
            closing.result()
        return with_descriptor(self._open_port())

    def _on_opened(self, done: Future[Port]) -> None:
        self._is_opening = False
        error = done.exception()
        if error is None:
            self._use(done.result())
        elif not isinstance(error, LinkError):
            error = LinkError(f"opening the port failed: {cause(error)}")
        thrown = self._ending or error
        self._ending = None
        if thrown is None:
            self._answer(self._now(), b"")
        else:
            self._pull(self._throw, thrown)

    def _use(self, port: Port) -> None:
        descriptor = port.fileno()
        assert descriptor is not None  # `with_descriptor`
        self._port = port
        self._descriptor = descriptor
        self._broken = None
        self._unasked = b""
        self._watch()

    def _drop_port(self) -> Future[None] | None:
        """Release the port and close it in a thread, because a driver may take long."""
        self._unwatch()
        if self._pause is not None:
            self._pause.cancel()
            self._pause = None
        port = self._port
        self._port = None
        if port is None:
            return None
        return self._shared.openers.submit(port.close)
