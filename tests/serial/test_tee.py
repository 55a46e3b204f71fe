"""The tee records every byte with its time and direction, and every change of the link; it does not
change the port.
"""

from __future__ import annotations

from collections import deque

import pytest

from jbclog.core.capture_rows import LinkRow
from jbclog.core.errors import LinkError
from jbclog.core.serial_line import LineFormat
from jbclog.transport.opening import open_port
from jbclog.transport.port import Port, unread
from jbclog.transport.session_history import Tee
from support.command import until
from support.links.far_ends import terminal


def test_every_byte_is_kept_in_order_with_its_moment() -> None:
    kept: list[LinkRow] = []
    moments = iter((1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    with terminal() as far:
        port: Port = Tee.opened(
            lambda: open_port(far.url, LineFormat()), kept.append, lambda: next(moments)
        )
        assert port.url == far.url
        assert port.fileno() is not None
        port.write(b"\x02RSMN\x03\x03")
        assert port.read(0.0) == b""  # nothing came: nothing to keep
        far.say(b"\x02ASMN")
        assert port.read(1.0) == b"\x02ASMN"
        far.say(b" DDE\x03\x00")
        while not (last := port.read_now()):
            pass
        port.close()
        port.close()
        with pytest.raises(LinkError):
            port.write(b"never sent")
    assert kept == [
        (1.0, "opened", b"", far.url),
        (2.0, "sent", b"\x02RSMN\x03\x03", ""),
        (3.0, "heard", b"\x02ASMN", ""),
        (4.0, "heard", last, ""),
        (5.0, "closed", b"", ""),
        # noted before it is handed over: an answer can never stand before its question
        (6.0, "sent", b"never sent", ""),
    ]


def test_what_had_come_and_was_not_read_is_counted_when_the_port_is_closed() -> None:
    kept: list[LinkRow] = []
    with terminal() as far:
        port = Tee.opened(lambda: open_port(far.url, LineFormat()), kept.append)
        far.say(b"x" * 3000)
        assert len(port.read(1.0)) == 1024
        assert until(lambda: unread(port.fileno()) == 3000 - 1024)
        port.close()
    assert kept[-1].text == "1976 bytes that had come were not read"
    assert sum(len(row.data) for row in kept) == 1024


def test_a_link_that_breaks_is_lost_once() -> None:
    kept: list[LinkRow] = []
    with terminal() as far:
        port = Tee.opened(lambda: open_port(far.url, LineFormat()), kept.append)
        far.unplug()
        for _ in range(2):
            with pytest.raises(LinkError):
                port.read(1.0)
        port.close()
    assert [row.what for row in kept] == ["opened", "lost"]
    assert "connection lost" in kept[1].text or "read" in kept[1].text


def test_a_port_that_cannot_be_opened_is_noted_with_the_reason() -> None:
    kept: list[LinkRow] = []
    with pytest.raises(LinkError) as told:
        Tee.opened(lambda: open_port("/nowhere/at-all", LineFormat()), kept.append)
    assert [(row.what, row.text) for row in kept] == [("failed", str(told.value))]


def test_a_bounded_sink_holds_the_newest() -> None:
    kept: deque[LinkRow] = deque(maxlen=2)
    with terminal() as far:
        port = Tee(open_port(far.url, LineFormat()), kept.append)
        for question in (b"one", b"two", b"three"):
            port.write(question)
    assert [row.data for row in kept] == [b"two", b"three"]
    assert kept[0].at_s <= kept[1].at_s
