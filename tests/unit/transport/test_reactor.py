"""The reactor: bytes and moments into sessions, broken links where they are met, and the run's end
exactly once.
"""

from __future__ import annotations

import contextlib
import inspect
import socket
import threading
import time
from collections.abc import Callable

import pytest

from jbclog.core.errors import LinkError
from jbclog.core.io_requests import (
    Ask,
    Listen,
    Reopen,
    RunEnded,
    Steps,
    ask,
    do,
    listen,
    reopen,
    wait,
)
from jbclog.transport.event_loop import Ring
from jbclog.transport.port import unread
from jbclog.transport.reactor import Reactor
from support.links.near_ends import PairPort, ThreadedPort

KINDS = pytest.mark.parametrize("kind", [PairPort, ThreadedPort], ids=["descriptor", "thread"])
LONG_S = 30.0  # nobody waits that long


def soon(seconds: float) -> float:
    return time.monotonic() + seconds


class ReadInPieces(PairPort):
    """A port of which each read takes so many bytes."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self.most = most

    def read_now(self) -> bytes:
        return self.near.recv(self.most)


def once(true: Callable[[], object], call: Callable[[], None]) -> Callable[[Reactor], None]:
    """A call that is made as soon as that is so; looked at again and again."""

    def look(reactor: Reactor) -> None:
        if true():
            call()
        else:
            reactor.loop.call_later(0.01, look, reactor)

    return look


def pull(
    session: Steps[None], port: PairPort, *calls: tuple[float, Callable[[Reactor], None]]
) -> None:
    """Pull one session on `port`, with calls some seconds after the beginning."""
    reactor = Reactor()
    reactor.add(session, lambda: port)
    for seconds, call in calls:
        reactor.loop.call_later(seconds, call, reactor)
    began = time.monotonic()
    reactor.run()
    assert time.monotonic() - began < LONG_S / 2, "it waited for something that cannot come"


# -- questions and answers -------------------------------------------------------------------------


@KINDS
def test_a_question_is_answered(kind: type[PairPort]) -> None:
    heard = []

    async def session() -> None:
        await reopen()
        for question in (b"abc", b"def"):
            heard.append(await ask(question, LONG_S))

    port = kind()
    pull(session(), port)
    assert [one.data for one in heard] == [b"cba", b"fed"]
    assert all(one.sent <= one.now for one in heard)
    assert port.written == [b"abc", b"def"]
    assert port.is_closed


@KINDS
def test_an_answer_that_does_not_come_is_none_at_the_end_of_patience(kind: type[PairPort]) -> None:
    heard = []

    async def session() -> None:
        await reopen()
        heard.append(await ask(b"abc", 0.05))

    pull(session(), kind(lambda question: b""))
    assert heard[0].data == b""
    assert 0.05 <= heard[0].now - heard[0].sent < LONG_S / 2


@KINDS
def test_what_came_unasked_is_given_at_the_end_of_a_wait(kind: type[PairPort]) -> None:
    heard, port = [], kind()

    async def session() -> None:
        await reopen()
        port.far.send(b"late")
        for _ in range(100):  # a thread that reads may be late
            unasked = await wait(until := soon(0.3))
            assert unasked.now >= until
            if unasked.data:
                heard.append(unasked)
                break
        heard.append(await ask(b"abc", LONG_S))

    pull(session(), port)
    assert [one.data for one in heard] == [b"late", b"cba"]


def test_pieces_are_given_as_they_come() -> None:
    heard, port = [], PairPort(lambda question: b"")

    async def session() -> None:
        await reopen()
        heard.append((await ask(b"abc", LONG_S)).data)
        heard.append((await listen(soon(LONG_S))).data)
        heard.append((await listen(soon(0.05))).data)

    pull(
        session(),
        port,
        (0.05, once(lambda: port.written, lambda: port.far.send(b"first"))),  # type: ignore[func-returns-value]
        (0.1, once(lambda: heard, lambda: port.far.send(b"second"))),  # type: ignore[func-returns-value]
    )
    assert heard == [b"first", b"second", b""]


def test_what_came_before_a_question_is_not_kept_from_who_listens_for_the_rest() -> None:
    heard, port = [], PairPort(lambda question: b"first")

    async def session() -> None:
        await reopen()
        with contextlib.suppress(RunEnded):
            await wait(soon(LONG_S))
        heard.append((await ask(b"abc", LONG_S)).data)
        heard.append((await listen(soon(LONG_S))).data)

    def end_when_read(reactor: Reactor) -> None:
        if unread(port.near.fileno()):
            reactor.loop.call_later(0.01, end_when_read, reactor)
        else:
            reactor.end("enough")

    pull(
        session(),
        port,
        (0.05, lambda _: port.far.send(b"early")),
        (0.06, end_when_read),
    )
    assert sorted(heard) == [b"early", b"first"]


def test_the_rest_of_an_answer_arms_nothing() -> None:
    """As many alarms for answers in single bytes as for whole ones."""

    def alarms(piece: int) -> int:
        port, rung = ReadInPieces(piece), list[float]()
        reactor = Reactor()
        wake_at = reactor.loop.wake_at

        def noted(moment: float, ring: Ring) -> None:
            rung.append(moment)
            wake_at(moment, ring)

        async def session() -> None:
            now = (await reopen()).now
            reactor.loop.wake_at = noted  # type: ignore[method-assign]
            for _ in range(20):
                heard, came = await ask(b"0123456789", LONG_S), b""
                while heard.data:
                    came += heard.data
                    if len(came) == 10:
                        break
                    heard = await listen(heard.sent + LONG_S)
                assert came == b"9876543210", now

        reactor.add(session(), lambda: port)
        begun = soon(0.0)
        reactor.run()
        return sum(moment > begun + LONG_S / 2 for moment in rung)

    assert alarms(1) == alarms(10) == 1


# -- broken links ----------------------------------------------------------------------------------


@KINDS
def test_a_link_that_breaks_while_it_is_asked(kind: type[PairPort]) -> None:
    met, port = [], kind(lambda question: b"")

    async def session() -> None:
        await reopen()
        try:
            await ask(b"abc", LONG_S)
        except LinkError as error:
            met.append(str(error))

    pull(session(), port, (0.1, once(lambda: port.written, port.unplug)))
    assert met == ["hung up"]


@KINDS
@pytest.mark.parametrize("io_request", [Ask(b"abc", LONG_S), Listen(1e12)], ids=["ask", "listen"])
def test_a_link_that_breaks_while_it_is_idle_is_told_at_the_next_wish(
    kind: type[PairPort], io_request: Ask | Listen
) -> None:
    met, port = [], kind(lambda question: b"")

    async def session() -> None:
        await reopen()
        # it can still be written to: a thread that reads may find it only after the next wish
        port.far.shutdown(socket.SHUT_WR)
        met.append((await wait(soon(0.3))).data)
        try:
            await do(io_request)
        except LinkError as error:
            met.append(str(error).encode())

    pull(session(), port)
    assert met == [b"", b"hung up"]


def test_a_session_that_asks_a_broken_link_without_pause_keeps_nobody_waiting() -> None:
    asked: list[bytes] = []
    is_through = threading.Event()

    async def stubborn() -> None:
        while not is_through.is_set() and len(asked) < 1_000_000:
            asked.append(b"abc")
            with contextlib.suppress(LinkError):
                await ask(b"abc", LONG_S)

    async def brief() -> None:
        await wait(soon(0.05))
        is_through.set()

    reactor = Reactor()
    reactor.add(stubborn(), PairPort)
    reactor.add(brief(), PairPort)
    reactor.run()
    assert 1 < len(asked) < 1_000_000


@pytest.mark.parametrize("error", [LinkError("no such port"), ValueError("a fault of the driver")])
def test_a_port_that_cannot_be_opened(error: Exception) -> None:
    met = []

    def cannot() -> PairPort:
        raise error

    async def session() -> None:
        for io_request in (Reopen(), Ask(b"abc", LONG_S)):
            try:
                await do(io_request)
            except LinkError as failure:
                met.append(str(failure))

    reactor = Reactor()
    reactor.add(session(), cannot)
    reactor.run()
    assert str(error) in met[0]
    assert met[1] == "the port is not open"


@KINDS
def test_a_port_opened_again_is_another(kind: type[PairPort]) -> None:
    ports, heard = [kind(), kind()], []
    opened = iter(ports)

    async def session() -> None:
        await reopen()
        ports[0].unplug()
        try:
            await ask(b"abc", LONG_S)
        except LinkError:
            await reopen()
        heard.append((await ask(b"abc", LONG_S)).data)

    reactor = Reactor()
    reactor.add(session(), lambda: next(opened))
    reactor.run()
    assert heard == [b"cba"]
    assert [port.is_closed for port in ports] == [True, True]


def test_a_port_is_closed_before_it_is_opened_again() -> None:
    """It is locked as long as it is open."""
    first, closed_when_opened = PairPort(close_s=0.2), []

    def opened() -> PairPort:
        closed_when_opened.append(first.is_closed)
        return first if len(closed_when_opened) == 1 else PairPort()

    async def session() -> None:
        await reopen()
        await reopen()

    reactor = Reactor()
    reactor.add(session(), opened)
    reactor.run()
    assert closed_when_opened == [False, True]


# -- the run's end ---------------------------------------------------------------------------------


PHASES: dict[str, Callable[[], Steps[None]]] = {}


def phase(session: Callable[[], Steps[None]]) -> Callable[[], Steps[None]]:
    PHASES[session.__name__] = session
    return session


@phase
async def waiting() -> None:
    await wait(soon(LONG_S))


@phase
async def asking() -> None:
    await reopen()
    await ask(b"", LONG_S)


@phase
async def listening() -> None:
    await reopen()
    await listen(soon(LONG_S))


@phase
async def asking_a_broken_link() -> None:
    while True:
        try:
            await ask(b"abc", LONG_S)
        except LinkError:
            await wait(soon(0.001))


@pytest.mark.parametrize("name", PHASES)
@pytest.mark.parametrize("at_s", [None, 0.0, 0.1, 0.101, 0.102])
def test_the_end_is_thrown_once_where_the_session_stands(name: str, at_s: float | None) -> None:
    """Before it began, too; and what it does then (open the port, ask, wait) is done, whatever ends
    come after.
    """
    story: list[object] = []

    async def session() -> None:
        try:
            await PHASES[name]()
        except RunEnded as end:
            story.append(str(end))
        await wait(0.0)
        await reopen()
        story.append((await ask(b"stand", LONG_S)).data)
        await wait(soon(0.05))
        await reopen()
        story.append((await ask(b"sure", LONG_S)).data)

    reactor = Reactor()
    reactor.add(session(), PairPort)
    if at_s is None:
        reactor.end("SIGTERM")
    else:
        reactor.loop.call_later(at_s, reactor.end, "SIGTERM")
        reactor.loop.call_later(at_s + 0.001, reactor.end, "SIGINT")
        reactor.loop.call_later(at_s + 0.03, reactor.end, "SIGINT")
    reactor.run()
    assert story == ["SIGTERM", b"dnats", b"erus"]


def test_the_end_while_a_port_is_being_opened_comes_when_it_is_open() -> None:
    story, go = [], threading.Event()

    def slowly() -> PairPort:
        go.wait(LONG_S)
        return PairPort()

    async def session() -> None:
        try:
            await reopen()
        except RunEnded as end:
            story.append(str(end))
        story.append((await ask(b"stand", LONG_S)).data.decode())
        await reopen()
        story.append("opened again")

    reactor = Reactor()
    reactor.add(session(), slowly)
    reactor.loop.call_later(0.05, reactor.end, "SIGTERM")
    reactor.loop.call_later(0.1, go.set)
    reactor.run()
    assert story == ["SIGTERM", "dnats", "opened again"]


# -- many of them ----------------------------------------------------------------------------------


def test_a_port_that_takes_its_time_to_close_delays_nobody() -> None:
    """It is closed only when the other session is through, which would never be if that waited for
    the closing.
    """
    closing, through = threading.Event(), threading.Event()

    class Slow(PairPort):
        def close(self) -> None:
            closing.set()
            assert through.wait(LONG_S)
            super().close()

    async def steady() -> None:
        rings = 0
        while rings < 10:
            await wait(soon(0.02))
            rings += closing.is_set()
        through.set()

    async def brief() -> None:
        await reopen()
        await wait(soon(0.05))

    reactor, slow = Reactor(), Slow()
    reactor.add(steady(), PairPort)
    reactor.add(brief(), lambda: slow)
    reactor.run()
    assert slow.is_closed


async def until_ended(story: list[str]) -> None:
    """Wait until the run ends, and then for one more answer; both are noted in `story`."""
    try:
        await wait(soon(LONG_S))
    except RunEnded as end:
        story.append(str(end))
    await reopen()
    story.append((await ask(b"stand", LONG_S)).data.decode())


def test_a_session_that_breaks_ends_the_others_in_good_order() -> None:
    story = list[str]()

    async def broken() -> None:
        await wait(soon(0.05))
        raise ZeroDivisionError("injected")

    reactor = Reactor()
    reactor.add(broken(), PairPort)
    reactor.add(until_ended(story), PairPort)
    with pytest.raises(ZeroDivisionError, match="injected"):
        reactor.run()
    assert story == ["a session broke: injected", "dnats"]


def test_what_breaks_beside_the_sessions_ends_them_in_good_order() -> None:
    """An alarm that was lost, say, because there was no memory for it: somebody may wait for it for
    ever.
    """
    story = list[str]()

    def fail() -> None:
        raise MemoryError

    reactor = Reactor()
    reactor.add(until_ended(story), PairPort)
    reactor.loop.call_later(0.05, fail)
    with pytest.raises(MemoryError):
        reactor.run(lambda: story.append("all well"))
    assert story == ["the program failed", "dnats"]


def test_sessions_that_do_not_end_then_are_left_with_their_ports_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Their tools are the guard's, which could not open what is open here."""
    monkeypatch.setattr("jbclog.transport.reactor.ENDING_S", 0.2)
    port, waits = PairPort(), threading.Event()

    async def deaf() -> None:
        await reopen()
        waits.set()
        while True:
            with contextlib.suppress(RunEnded):
                await wait(soon(LONG_S))

    def fail() -> None:
        raise MemoryError

    reactor = Reactor()
    reactor.add(deaf(), lambda: port)
    reactor.loop.call_later(0.1, once(waits.is_set, fail), reactor)
    with pytest.raises(MemoryError):
        reactor.run()
    assert port.is_closed


@pytest.mark.parametrize("wants_traceback", ["", "1"])
def test_what_is_called_every_so_often_is_called_whatever_it_raised(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch, wants_traceback: str
) -> None:
    """It is told in one line, once; of a traceback, whoever asks for it."""
    monkeypatch.setenv("JBCLOG_TRACEBACK", wants_traceback)
    calls: list[float] = []
    told: list[str] = []

    def report(text: str) -> None:
        told.append(text)
        raise OSError("nobody listens")

    def call() -> None:
        calls.append(time.monotonic())
        raise ZeroDivisionError("injected")

    async def session() -> None:
        while len(calls) < 4:
            await wait(soon(0.01))

    reactor = Reactor(report=report)
    reactor.add(session(), PairPort)
    reactor.every(0.05, call, "Look at nothing")
    reactor.run()
    # the third and the fourth follow each other quickly where the second was late
    assert calls[3] - calls[0] >= 2 * 0.05
    assert told == ["Look at nothing: internal error, ZeroDivisionError: injected"]
    assert caplog.text.count("Traceback") == len(wants_traceback)


def test_a_session_that_never_began_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise MemoryError

    async def session() -> None:
        await wait(0.0)

    reactor, never_begun = Reactor(), session()
    reactor.add(never_begun, PairPort)
    monkeypatch.setattr(type(reactor.loop), "call_soon", full)
    with pytest.raises(MemoryError):
        reactor.run()
    assert inspect.getcoroutinestate(never_begun) == inspect.CORO_CLOSED


def test_ticks_of_many_sessions_ring_in_order() -> None:
    rung: list[tuple[float, float]] = []

    async def session(first: float) -> None:
        for step in range(20):
            due = first + 0.01 * step
            rung.append((due, (await wait(due)).now))

    reactor, begin = Reactor(), soon(0.05)
    for number in range(50):
        reactor.add(session(begin + 0.0001 * number), PairPort)
    reactor.run()
    assert len(rung) == 1000
    assert all(now >= due for due, now in rung)
    # how late they are, tests/bench measures
    assert [due for due, _ in rung] == sorted(due for due, _ in rung)


def test_a_reactor_without_sessions_ends_at_once() -> None:
    Reactor().run()


# -- who wants to know of the end ------------------------------------------------------------------


def test_the_end_is_told_before_ports_that_are_slow_to_close_are_waited_for() -> None:
    """A guard would take a recorder for hung that waits for them."""
    port, told = PairPort(close_s=0.5), []

    async def session() -> None:
        await reopen()

    reactor = Reactor()
    reactor.add(session(), lambda: port)
    reactor.run(lambda: told.append(port.is_closed))
    assert told == [False]
    assert port.is_closed


def test_the_end_is_not_told_where_a_session_broke() -> None:
    told = []

    async def session() -> None:
        await reopen()
        raise ValueError("a fault of the program")

    reactor = Reactor()
    reactor.add(session(), PairPort)
    with pytest.raises(ValueError, match="a fault"):
        reactor.run(lambda: told.append(True))
    assert told == []
