"""The tee keeps every byte with its moment and direction, and changes nothing of the port."""

from __future__ import annotations

from collections import deque

import pytest
from far_ends import terminal

from jbclog.errors import LinkError
from jbclog.transport import Moved, Port, Tee, open_port
from jbclog.wire import LineFormat


def test_every_byte_is_kept_in_order_with_its_moment() -> None:
    kept: list[Moved] = []
    moments = iter((1.0, 2.0, 3.0))
    with terminal() as far:
        plain = open_port(far.url, LineFormat())
        port: Port = Tee(plain, kept.append, now=lambda: next(moments))
        assert (port.url, port.fileno()) == (plain.url, plain.fileno())
        port.write(b"\x02RSMN\x03\x03")
        assert port.read(0.0) == b""  # nothing came: nothing to keep
        far.say(b"\x02ASMN")
        assert port.read(1.0) == b"\x02ASMN"
        far.say(b" DDE\x03\x00")
        while not (last := port.read_now()):
            pass
        port.close()
        with pytest.raises(LinkError):
            port.write(b"never sent")
    assert kept == [(1.0, "sent", b"\x02RSMN\x03\x03"), (2.0, "heard", b"\x02ASMN"), (3.0, "heard", last)]


def test_a_bounded_sink_holds_the_newest() -> None:
    kept: deque[Moved] = deque(maxlen=2)
    with terminal() as far:
        port = Tee(open_port(far.url, LineFormat()), kept.append)
        for question in (b"one", b"two", b"three"):
            port.write(question)
        port.close()
    assert [moved.data for moved in kept] == [b"two", b"three"]
    assert kept[0].at_s <= kept[1].at_s
