"""A port without a descriptor gets one, and a thread that ends with it."""

from __future__ import annotations

import os
import select
import threading

import pytest

from jbclog.core.errors import LinkError
from jbclog.transport.port_thread import ThreadPort, with_descriptor
from support.command import until
from support.links.near_ends import PairPort, ThreadedPort


def is_readable(port: ThreadPort, patience_s: float) -> bool:
    return bool(select.select([port.fileno()], [], [], patience_s)[0])


def readers() -> int:
    return sum(thread.name == "read-port" for thread in threading.enumerate())


def test_a_port_with_a_descriptor_is_taken_as_it_is() -> None:
    port = PairPort()
    assert with_descriptor(port) is port
    port.close()


def test_one_piece_is_read_at_a_time_and_the_next_when_it_is_taken() -> None:
    inner = ThreadedPort()
    port = ThreadPort(inner)
    assert port.read_now() == b""
    inner.far.send(b"first")
    assert is_readable(port, 10.0)
    inner.far.send(b"second")
    assert port.read_now() == b"first"
    assert port.read(10.0) == b"second"
    assert not is_readable(port, 0.0)
    port.close()


def test_a_lost_link_is_raised_at_each_read() -> None:
    inner = ThreadedPort()
    port = ThreadPort(inner)
    inner.unplug()
    assert is_readable(port, 10.0)
    for _ in range(2):
        with pytest.raises(LinkError, match="hung up"):
            port.read_now()
    port.close()


@pytest.mark.parametrize("data", [b"", b"not taken"])
def test_the_thread_and_the_descriptor_end_with_the_port(data: bytes) -> None:
    before = readers()
    inner = ThreadedPort()
    port = ThreadPort(inner)
    descriptor = port.fileno()
    assert descriptor is not None
    inner.far.send(data)
    assert is_readable(port, 10.0 if data else 0.0) is bool(data)
    port.close()
    port.close()
    assert inner.is_closed
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)
    assert until(lambda: readers() == before)
