"""Run one session on its port for the reactor: perform its requests, return the results, recover
from a lost port.

Opening and closing a port can block, so both happen in the reactor's threads.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import TYPE_CHECKING

from jbclog.core.errors import LinkError, cause
from jbclog.core.io_requests import Ask, Gather, IoResult, Listen, Request, RunEnded, Steps, Wait
from jbclog.transport.blocking import OpenPort
from jbclog.transport.event_loop import Handle
from jbclog.transport.port import MOST_AT_ONCE, MOST_KEPT, MOST_READS, REST_S, Budget, Port
from jbclog.transport.port_thread import Pump

if TYPE_CHECKING:
    from jbclog.transport.reactor import Reactor

NEVER = float("inf")
_new = tuple.__new__

Session = Steps[object]


def _read_nothing() -> bytes:
    """Replaces the read of a port that is not open."""
    return b""


def _write_nothing(_data: bytes) -> None:
    """Replaces the write of a port that is not open; never called."""


class SessionRunner:
    """One session and its port."""

    __slots__ = (
        "_armed",
        "_broken",
        "_budget",
        "_deadline",
        "_ending",
        "_failing",
        "_fileno",
        "_heard",
        "_is_ended",
        "_is_ending",
        "_is_gathered",
        "_is_started",
        "_is_watched",
        "_lag",
        "_late_s",
        "_listening",
        "_loop",
        "_member",
        "_now",
        "_open_port",
        "_opening",
        "_port",
        "_pump",
        "_reactor",
        "_read",
        "_rest",
        "_ring",
        "_send",
        "_sent",
        "_session",
        "_throw",
        "_unasked",
        "_write",
    )

    def __init__(self, reactor: Reactor, session: Session, open_port: OpenPort, name: str) -> None:
        self._reactor = reactor
        self._loop = reactor.loop
        self._lag = reactor.loop_lag
        self._now = reactor.now
        self._session = session
        self._send, self._throw = session.send, session.throw
        self._open_port = open_port
        self._port: Port | None = None
        self._read: Callable[[], bytes] = _read_nothing  # the port's methods, bound once
        self._write: Callable[[bytes], None] = _write_nothing
        self._fileno: int | None = None
        self._pump: Pump | None = None
        self._broken: LinkError | None = None  # found between requests; raised at the next one
        self._opening = False
        self._listening = False
        self._unasked = b""
        self._budget = Budget()
        self._is_watched = False  # the port is read as soon as bytes arrive
        self._rest: Handle | None = None  # the end of a pause in reading
        self._sent = 0.0
        self._deadline = NEVER
        self._armed = NEVER  # moment of the next valid alarm
        self._ring = self.on_time  # bound once
        self._failing: Handle | None = None  # a scheduled failure
        # the run's end, deferred while the port is being opened
        self._ending: RunEnded | None = None
        self._heard = 0.0  # when bytes last arrived
        self._late_s = 0.0  # total lateness of the loop at the last result
        self._is_gathered = False  # waits for the other sessions
        self._member = reactor.barrier.join(name, self)
        self._is_ending = False
        self._is_started = False
        self._is_ended = False

    def start(self) -> None:
        if not self._is_started:
            self._is_started = True
            self._resume(None)

    def end(self, why: str) -> None:
        """Throw the run's end into the session, once."""
        self.start()  # a generator that has not started cannot catch an exception
        if self._is_ending or self._is_ended:
            return
        self._is_ending = True
        self._end_with(RunEnded(why))

    def _end_with(self, error: RunEnded) -> None:
        if self._opening:
            self._ending = error
        else:
            self._fail(error)

    def heard_at(self) -> float:
        """Return when bytes last arrived."""
        return self._heard

    def resume(self) -> None:
        """Resume after `Gather`: the other sessions are ready."""
        if self._is_gathered:
            self._is_gathered = False
            self._send_result(self._now(), self._take_unasked())

    def throw(self, error: RunEnded) -> None:
        """Throw `error`: the run does not start, or starts without this session."""
        if not (self._is_ended or self._is_ending):
            self._end_with(error)

    def _send_result(self, now: float, data: bytes) -> None:
        before, self._late_s = self._late_s, self._lag.late_s(now)
        self._resume(IoResult(now, data, self._sent, self._late_s - before))

    def _resume(self, heard: IoResult | None) -> None:
        try:
            request = self._send(heard)  # type: ignore[arg-type]  # the first send of a generator is None
        except StopIteration:
            self._finish()
        except Exception as broken:
            self._finish(broken)
        else:
            self._do(request)

    def _fail(self, error: Exception) -> None:
        self._is_gathered = False
        if self._failing is not None:
            self._failing.cancel()
            self._failing = None
        try:
            request = self._throw(error)
        except StopIteration:
            self._finish()
        except Exception as broken:
            self._finish(broken)
        else:
            self._do(request)

    def _fail_soon(self, error: LinkError) -> None:
        """Throw `error` from the loop, because direct recursion could become too deep."""
        self._listening, self._deadline = False, NEVER
        self._failing = self._loop.call_soon(self._fail, error)

    def _do(self, request: Request) -> None:
        kind = type(request)
        if kind is Ask:
            self._ask(request)  # type: ignore[arg-type]  # narrowed by `kind`
        elif kind is Listen:
            self._await(request.until, listening=True)  # type: ignore[union-attr]
        elif kind is Wait:
            self._await(request.until, listening=False)  # type: ignore[union-attr]
        elif kind is Gather:
            self._listening, self._deadline, self._is_gathered = False, NEVER, True
            self._reactor.barrier.gather(self._member, request)  # type: ignore[arg-type]
        else:
            self._reopen()

    def _ask(self, request: Ask) -> None:
        try:
            if self._port is None:
                raise self._broken or LinkError("the port is not open")
            # before writing: afterwards this thread may have to wait for the GIL
            self._sent = sent = self._now()
            self._write(request.data)
        except LinkError as error:
            self._drop_port()
            self._fail_soon(error)
            return
        self._listening = True
        self._budget.asked()
        if not self._is_watched:
            self._watch()
        self._arm(sent + request.patience_s)

    def _await(self, until: float, *, listening: bool) -> None:
        if listening and self._port is None:
            self._fail_soon(self._broken or LinkError("the port is not open"))
            return
        self._listening = listening
        if listening and self._unasked:
            until = 0.0
        elif not self._is_watched:
            self._watch()
        self._arm(until)

    def _arm(self, deadline: float) -> None:
        """Wake at `deadline`. An earlier alarm stays, and sets the next one when it fires."""
        self._deadline = deadline
        if deadline < self._armed:
            self._armed = deadline
            self._loop.wake_at(deadline, self._ring)

    def on_time(self, armed: float) -> None:
        """Handle the alarm set for `armed`. Alarms are never cancelled."""
        if armed != self._armed:
            return  # superseded by an earlier one
        self._armed = NEVER
        now, deadline = self._now(), self._deadline
        if now < deadline:
            self._arm(deadline)
            return
        self._deadline = NEVER
        self._listening = False
        self._send_result(now, self._take_unasked())

    def _on_readable(self) -> None:
        """Read; if the session listens, resume it and send its next request, or keep listening if
        it waits for the rest of an answer.

        The usual exchange happens entirely in this one function, because it is what a recorder does
        most; other methods handle anything else. Counts reads as `Budget.is_spent` does.
        """
        try:
            data = self._read()
        except LinkError as error:
            self._on_broken(error)
            return
        budget = self._budget
        if not self._listening or budget.reads >= MOST_READS or not 0 < len(data) < MOST_AT_ONCE:
            self.on_bytes(data)
            return
        budget.reads += 1
        self._heard = now = self._now()
        self._listening, self._deadline = False, NEVER
        lag, before = self._lag, self._late_s
        self._late_s = late_s = lag.noted_s if now <= lag.noted_after_s else lag.late_s(now)
        try:
            # the same as `IoResult(...)`, at half its cost
            request = self._send(_new(IoResult, (now, data, self._sent, late_s - before)))
        except StopIteration:
            self._finish()
            return
        except Exception as broken:
            self._finish(broken)
            return
        if type(request) is Ask and self._is_watched:
            asked, patience_s = request
            self._sent = sent = self._now()  # as in `_ask`
            try:
                self._write(asked)
            except LinkError as error:
                self._drop_port()
                self._fail_soon(error)
                return
            budget.reads = 0
            deadline = sent + patience_s
        elif type(request) is Listen and self._is_watched and not self._unasked:
            deadline = request.until  # as in `_await`
        else:
            self._do(request)
            return
        self._listening = True
        self._deadline = deadline
        if deadline < self._armed:
            self._arm(deadline)

    def on_bytes(self, data: bytes) -> None:
        """Pass bytes to the session if it listens, else keep them until it does."""
        if not data:
            return
        self._heard = now = self._now()
        if self._budget.is_spent(len(data)):
            self._let_rest()
        if self._listening:
            self._listening = False
            self._deadline = NEVER
            self._send_result(now, data)
        else:
            self._unasked += data
            if len(self._unasked) >= MOST_KEPT:
                self._unwatch()

    def _take_unasked(self) -> bytes:
        unasked, self._unasked = self._unasked, b""
        return unasked

    def _let_rest(self) -> None:
        """Pause reading: too many bytes arrive to be answers."""
        self._unwatch()
        if self._rest is None:
            self._rest = self._loop.call_later(REST_S, self._rested)

    def _rested(self) -> None:
        self._rest = None
        if self._listening or len(self._unasked) < MOST_KEPT:
            self._watch()

    def _watch(self) -> None:
        """Read the port as soon as bytes arrive, unless reading is paused."""
        if self._is_watched or self._rest is not None or self._port is None:
            return
        self._is_watched = True
        if self._pump is not None:
            self._pump.resume()
        elif self._fileno is not None:
            self._loop.add_reader(self._fileno, self._on_readable)

    def _unwatch(self) -> None:
        if not self._is_watched:
            return
        self._is_watched = False
        if self._pump is not None:
            self._pump.rest()
        elif self._fileno is not None:
            self._loop.remove_reader(self._fileno)

    def _on_broken(self, error: LinkError) -> None:
        self._drop_port()
        self._broken = error
        if self._listening:
            self._listening = False
            self._deadline = NEVER
            self._fail(error)

    def _reopen(self) -> None:
        closing = self._drop_port()
        self._deadline, self._listening, self._opening = NEVER, False, True
        future = self._reactor.openers.submit(self._open_after, closing)
        future.add_done_callback(
            lambda done: self._loop.call_soon_threadsafe(self._on_opened, done)
        )

    def _open_after(self, closing: Future[None] | None) -> Port:
        """Open the port once the old one is closed, which locks it. Runs in a thread."""
        if closing is not None:
            closing.result()
        return self._open_port()

    def _on_opened(self, done: Future[Port]) -> None:
        self._opening = False
        error = done.exception()
        if error is None:
            self._take_port(done.result())
        ending, self._ending = self._ending, None
        if ending is not None:
            self._fail(ending)
        elif isinstance(error, LinkError):
            self._fail(error)
        elif error is not None:
            self._fail(LinkError(f"opening the port failed: {cause(error)}"))
        else:
            self._send_result(self._now(), b"")

    def _take_port(self, port: Port) -> None:
        self._port, self._broken, self._unasked = port, None, b""
        self._read, self._write = port.read_now, port.write
        self._fileno = port.fileno()
        if self._fileno is None:
            self._pump = Pump(self._loop, port, self.on_pumped)
        self._watch()

    def on_pumped(self, pump: Pump, data: bytes, error: LinkError | None) -> None:
        """Handle bytes or an error from a port's reading thread; ignore those of a port closed
        meanwhile.
        """
        if pump is not self._pump:
            return
        if error is not None:
            self._on_broken(error)
        else:
            self.on_bytes(data)

    def _drop_port(self) -> Future[None] | None:
        """Release the port and close it in a thread, because a driver may take long."""
        port, self._port = self._port, None
        self._unwatch()
        self._read, self._write = _read_nothing, _write_nothing
        if self._rest is not None:
            self._rest.cancel()
            self._rest = None
        self._fileno = None
        if self._pump is not None:
            self._pump.stop()
            self._pump = None
        return None if port is None else self._reactor.openers.submit(port.close)

    def let_go(self) -> None:
        """Release the port, whatever the session is doing."""
        port = self._port
        try:
            self._drop_port()
        except Exception:  # no thread, or no memory for one
            if port is not None:
                port.close()

    def _finish(self, broken: Exception | None = None) -> None:
        self._is_ended = True
        self._armed = NEVER
        self._drop_port()
        self._reactor.barrier.ended(self._member)
        if broken is None:
            self._reactor.ended(self)
        else:
            self._reactor.failed(self, broken)
