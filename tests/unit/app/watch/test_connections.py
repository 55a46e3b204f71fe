"""Connections to the live view's page that do not do what browsers do: none keeps its place, and
the page answers others meanwhile.
"""

from __future__ import annotations

import http.client
import select
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.app.watch import connections
from jbclog.app.watch.server import PIECE, Broadcast
from jbclog.core.rows import EventRow, Severity
from jbclog.live import NumberedEvent
from support.command import until
from support.records import live_states
from support.records.live_rows import Recording
from support.virtual.watched_page import Served, page

LONG_S = 60.0
ESTABLISHED = "01"  # in /proc/net/tcp
LARGE = 40 << 20


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "WAITS_S", 0.5)
    monkeypatch.setattr(connections, "LOOK_S", 0.1)


@pytest.fixture
def served(impatient: None) -> Iterator[Served]:
    with page(live_states.run()) as made:
        yield made


def connected(served: Served, sent: bytes = b"", buffer: int | None = None) -> socket.socket:
    made = socket.socket()
    if buffer is not None:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
    made.settimeout(LONG_S)
    made.connect(("127.0.0.1", served.port))
    with suppress(ConnectionError):
        made.sendall(sent)
    return made


def asking(served: Served, path: str, more: str = "") -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n{more}\r\n".encode()


def is_over(client: socket.socket) -> bool:
    """Whether the server has ended the connection, whatever it answered before."""
    try:
        while client.recv(1 << 20):
            pass
    except ConnectionError:
        pass
    except TimeoutError:
        return False
    return True


def answers(served: Served) -> bool:
    """Whether somebody else gets the page. Who is kept from asking for longer than the impatient
    server waits was rightly sent away, and asks again.
    """

    def is_page() -> bool:
        with closing(
            http.client.HTTPConnection("127.0.0.1", served.port, timeout=LONG_S)
        ) as connection:
            try:
                connection.request("GET", "/")
                answer = connection.getresponse()
            except ConnectionError:
                return False
            return answer.status == 200 and b"<html" in answer.read().lower()

    return until(is_page)


def answered(served: Served, request: bytes, buffer: int | None = None) -> socket.socket:
    """A connection whose answer has begun, nothing of it taken; asked again as in `answers`."""
    end = time.monotonic() + LONG_S
    while True:
        client = connected(served, request, buffer)
        with suppress(ConnectionError):
            if client.recv(1, socket.MSG_PEEK):
                return client
        client.close()
        assert time.monotonic() < end


def is_held(served: Served, client: socket.socket) -> bool:
    """Whether the server has its end of the connection still open."""
    ends = [served.port, client.getsockname()[1]]
    for line in Path("/proc/net/tcp").read_text(encoding="ascii").splitlines()[1:]:
        local, remote, state = line.split()[1:4]
        if [int(one.partition(":")[2], 16) for one in (local, remote)] == ends:
            return state == ESTABLISHED
    return False


@pytest.mark.parametrize(
    "sent", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"], ids=str
)
def test_a_request_that_does_not_come_to_its_end_is_not_waited_for(
    served: Served, sent: bytes
) -> None:
    with connected(served, sent) as client:
        assert is_over(client)
    assert answers(served)


@pytest.mark.parametrize("first", [b"GET / HTTP/1.1\r\nX: ", None], ids=["header", "body"])
def test_nor_is_one_that_comes_a_byte_at_a_time(served: Served, first: bytes | None) -> None:
    """Each byte cancels the library's own limit of time."""
    more = "Content-Length: 1000000\r\n"
    with connected(served, asking(served, "/", more) if first is None else first) as client:
        end = time.monotonic() + LONG_S
        with suppress(ConnectionError):
            while time.monotonic() < end:
                client.sendall(b"x")
                if select.select([client], [], [], 0.05)[0] and not client.recv(1 << 20):
                    break
        assert time.monotonic() < end
    assert answers(served)


@pytest.mark.parametrize(
    "sent",
    [
        b"GET /" + b"x" * (2 << 20),
        b"GET / HTTP/1.1\r\n" + b"X: " + b"x" * (2 << 20),
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 500_000,
        b"\0" * (2 << 20),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\xff" * 500,
        b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n",
    ],
    ids=["line", "header", "headers", "NULs", "HTTP/2", "TLS", "two hosts"],
)
def test_what_is_no_request_gets_no_page(served: Served, sent: bytes) -> None:
    with connected(served, sent) as client:
        heard = b""
        with suppress(ConnectionError):
            while piece := client.recv(1 << 16):
                heard += piece
    assert not heard or heard.split()[1].startswith(b"4")
    assert answers(served)


def test_a_websocket_is_a_plain_request(served: Served) -> None:
    more = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    with answered(served, asking(served, "/", more)) as client:
        assert client.recv(12) == b"HTTP/1.1 200"


def test_the_rest_of_a_report_is_not_kept_for_who_does_not_take_it(
    tmp_path: Path, impatient: None
) -> None:
    recording = Recording(tmp_path)
    recording.finalize()
    (recording.folder / "report.html").write_bytes(b"x" * LARGE)
    with page(None, path=tmp_path) as served:
        request = asking(served, f"/runs/{recording.folder.name}")
        with answered(served, request, buffer=4096) as client:
            assert until(lambda: not is_held(served, client))
            taken = 0
            with suppress(ConnectionError):
                while piece := client.recv(1 << 20):
                    taken += len(piece)
            assert 0 < taken < LARGE
        assert answers(served)


def test_nor_are_the_messages(impatient: None) -> None:
    """A browser that has fallen asleep. Three messages are more than sockets hold."""
    row = EventRow(live_states.T0_US, "run.start", Severity.INFO, "x" * 200_000)
    events = tuple(NumberedEvent(number, row) for number in range(20))
    with page(replace(live_states.run(), events=events)) as served:
        with answered(served, asking(served, "/events"), buffer=4096) as client:
            assert until(lambda: not is_held(served, client))
        assert answers(served)


def test_of_too_many_connections_those_are_ended_that_ask_for_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The oldest first, so that there is room for who asks."""
    monkeypatch.setattr(connections, "MOST_CONNECTIONS", 20)
    monkeypatch.setattr(connections, "WAITS_S", 600.0)
    with page(live_states.run()) as served, ExitStack() as opened:
        asks = opened.enter_context(connected(served, asking(served, "/events")))
        assert asks.recv(12) == b"HTTP/1.1 200"
        silent = [opened.enter_context(connected(served)) for _ in range(40)]

        def ended() -> list[socket.socket]:
            return select.select(silent, [], [], 0.1)[0]

        assert until(lambda: len(ended()) == 21)
        assert all(is_over(one) for one in ended())
        assert is_held(served, asks)
        assert answers(served)


def test_the_whole_state_is_made_once_for_all_who_join(monkeypatch: pytest.MonkeyPatch) -> None:
    """And sent in pieces."""
    made: list[int] = []

    def whole() -> str:
        made.append(1)
        return "x" * (3 * PIECE)

    broadcast = Broadcast(lambda: None)
    monkeypatch.setattr(broadcast.feed, "whole", whole)
    for expected in (1, 1, 2):
        queue = broadcast.join()
        assert queue is not None
        stream = broadcast.messages(queue)
        pieces = [_next(stream) for _ in range(4)]
        assert "".join(pieces) == f"data: {'x' * 3 * PIECE}\n\n"
        assert len(made) == expected
        if len(broadcast.browsers) == 2:
            broadcast._hand_out("a change")


def _next(stream: object) -> str:
    step = stream.__anext__()  # type: ignore[attr-defined]
    try:
        step.send(None)
    except StopIteration as done:
        return str(done.value)
    raise AssertionError("it waits")
