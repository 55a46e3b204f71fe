"""Every way to lose a cable, on every kind of port: one `LinkError` with the URL, and no other
error.
"""

from __future__ import annotations

import contextlib
import os
import socket
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import serial
from support.links.far_ends import (
    Terminal,
    are_closed_again,
    rfc2217_server,
    server,
    settled_descriptors,
    terminal,
)
from support.product import (
    CLOSE_S,
    PORT_BROKEN,
    DescriptorPort,
    LineFormat,
    LinkError,
    ObjectPort,
    Port,
    close_in_thread,
    open_port,
)

LINE = LineFormat()
QUESTION = b"\x020001RTT1\x03c"
# in pyserial
rfc2217_of_python_3_11 = pytest.mark.filterwarnings(
    "ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning"
)

WAYS: dict[str, Callable[[Port], object]] = {
    "write": lambda port: port.write(QUESTION),
    "read_now": lambda port: port.read_now(),
    "read": lambda port: port.read(1.0),
}


def _lost(port: Port, way: str) -> LinkError:
    """Return the error of `way`, which comes at once or after the remaining bytes."""
    until = time.monotonic() + 20
    while time.monotonic() < until:
        try:
            WAYS[way](port)
        except LinkError as error:
            return error
    raise AssertionError(f"{way} goes on as if nothing had happened")


@pytest.mark.parametrize("way", WAYS)
def test_an_idle_device_is_unplugged(way: str) -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        far.unplug()
        error = _lost(port, way)
        assert str(error).startswith(f"{far.url}: ")
        assert "unplugged" in str(error)
        port.close()


def test_a_device_is_unplugged_in_the_middle_of_an_answer() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        port.write(QUESTION)
        far.say(b"\x020100ATT10")
        assert port.read(1.0) == b"\x020100ATT10"
        far.unplug()
        began = time.monotonic()
        with pytest.raises(LinkError, match="unplugged"):
            port.read(60.0)
        assert time.monotonic() - began < 30
        port.close()


def test_a_device_is_unplugged_while_it_is_waited_for() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        threading.Timer(0.05, far.unplug).start()
        began = time.monotonic()
        with pytest.raises(LinkError):
            port.read(60.0)
        assert time.monotonic() - began < 30
        port.close()


def test_a_device_is_unplugged_in_the_middle_of_writing() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        far_end = threading.Thread(target=_listen_then_unplug, args=(far,))
        far_end.start()
        with pytest.raises(LinkError):
            _write_on(port)
        far_end.join()
        port.close()


def _listen_then_unplug(far: Terminal) -> None:
    far.heard()
    far.unplug()


def _write_on(port: Port, data: bytes = QUESTION) -> None:
    while True:
        port.write(data)


def _read_on(port: Port) -> None:
    while True:
        port.read(0.02)


def test_a_line_that_takes_nothing_more_is_lost_and_does_not_block() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        began = time.monotonic()
        with pytest.raises(LinkError, match="write buffer full"):
            _write_on(port)  # nobody reads at the far end
        assert time.monotonic() - began < 30
        port.close()


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("how", ["end", "reset"])
def test_a_server_goes(way: str, how: str) -> None:
    with server() as far:
        port = open_port(far.url, LINE)
        assert far.client
        getattr(far, how)()
        error = _lost(port, way)
        assert str(error).startswith(f"{far.url}: ")
        port.close()


def test_a_server_that_shuts_its_half_down_is_gone() -> None:
    with server() as far:
        port = open_port(far.url, LINE)
        far.client.sendall(b"\x02last")
        far.client.shutdown(socket.SHUT_WR)
        assert port.read(1.0) == b"\x02last"
        with pytest.raises(LinkError, match="connection lost"):
            port.read(1.0)
        port.close()


@rfc2217_of_python_3_11
@pytest.mark.parametrize("way", ["write", "read"])
def test_an_rfc2217_server_goes(way: str) -> None:
    with terminal() as far, rfc2217_server(far) as remote:
        port = open_port(remote.url, LINE)
        remote.end()
        error = _lost(port, way)
        assert str(error).startswith(f"{remote.url}: ")
        port.close()


@rfc2217_of_python_3_11
def test_closing_a_lost_rfc2217_port_is_quicker_than_pyserials_own() -> None:
    def took() -> float:
        with terminal() as far, rfc2217_server(far) as remote:
            port = open_port(remote.url, LINE)
            remote.end()
            _lost(port, "read")
            began = time.monotonic()
            port.close()
            return time.monotonic() - began

    # pyserial's sleeps 0.3 s; a busy machine runs the thread that closes late
    assert any(took() < 0.25 for _ in range(20))


class Stumbling:
    """Replaces pyserial's object; fails as pyserial does if the cable is lost at a bad moment."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def read(self, size: int = 1) -> bytes:
        raise self.error

    def write(self, data: bytes) -> int:
        raise self.error

    @property
    def in_waiting(self) -> int:
        raise self.error

    def close(self) -> None:
        raise self.error


EVERY_KIND = [
    serial.SerialException("device reports readiness to read but returned no data"),
    serial.PortNotOpenError(),
    serial.SerialTimeoutException("Write timeout"),
    OSError(5, "Input/output error"),
    termios.error(5, "Input/output error"),
    TypeError("an integer is required (got type NoneType)"),
    ValueError("I/O operation on closed file"),
    AttributeError("'NoneType' object has no attribute 'sendall'"),
    BrokenPipeError(32, "Broken pipe"),
    ConnectionResetError(104, "Connection reset by peer"),
    TimeoutError(110, "Connection timed out"),
]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("error", EVERY_KIND, ids=lambda error: type(error).__name__)
def test_every_kind_of_exception_becomes_one(error: Exception, way: str) -> None:
    port = ObjectPort("rfc2217://far:1", Stumbling(error))  # type: ignore[arg-type]  # all that a port asks of it
    with pytest.raises(LinkError, match=r"^rfc2217://far:1: ") as lost:
        WAYS[way](port)
    assert lost.value.__cause__ is error
    port.close()
    assert isinstance(error, PORT_BROKEN)


# -- closing ---------------------------------------------------------------------------------------


@contextlib.contextmanager
def _every_port() -> Iterator[list[Port]]:
    with terminal() as far, server() as other:
        ports = [open_port(url, LINE) for url in (far.url, other.url, "loop://")]
        yield ports
        for port in ports:
            port.close()


@pytest.mark.parametrize("way", WAYS)
def test_a_closed_port_is_a_link_error(way: str) -> None:
    with _every_port() as ports:
        for port in ports:
            port.close()
            port.close()
            assert port.fileno() is None
            with pytest.raises(LinkError, match="the port is closed"):
                WAYS[way](port)


def test_a_port_is_closed_by_another_thread_while_it_is_read() -> None:
    with _every_port() as ports:
        for port in ports:
            threading.Timer(0.05, port.close).start()
            with pytest.raises(LinkError, match=port.url):
                _read_on(port)


@rfc2217_of_python_3_11
def test_an_rfc2217_port_is_closed_by_another_thread_while_it_is_read() -> None:
    with terminal() as far, rfc2217_server(far) as remote:
        port = open_port(remote.url, LINE)
        threading.Timer(0.05, port.close).start()
        with pytest.raises(LinkError, match="closed"):
            port.read(60.0)


def test_closing_never_waits_for_a_driver_that_hangs() -> None:
    release = threading.Event()
    began = time.monotonic()
    close_in_thread(lambda: release.wait(60))
    assert time.monotonic() - began < CLOSE_S + 10
    release.set()


def test_closing_does_not_wait_for_a_connection_that_lingers() -> None:
    with server() as far:
        port = open_port(far.url, LINE)
        descriptor = port.fileno()
        assert descriptor is not None
        with socket.socket(fileno=os.dup(descriptor)) as same:
            # close() blocks for up to 20 s
            same.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\x14\0\0\0")
        assert far.client
        with pytest.raises(LinkError, match="write buffer full"):
            _write_on(port, bytes(4096))
        began = time.monotonic()
        port.close()
        assert time.monotonic() - began < CLOSE_S + 10


def test_bytes_that_the_far_end_never_took_do_not_hold_up_closing() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        with pytest.raises(LinkError, match="write buffer full"):
            _write_on(port)
        began = time.monotonic()
        port.close()
        assert time.monotonic() - began < CLOSE_S + 10


def test_nothing_stays_open_over_200_openings() -> None:
    with terminal() as far, server() as other:
        before = settled_descriptors()
        for round_ in range(200):
            port = open_port(far.url, LINE)
            if round_ % 2:
                far.say(b"left unread")
            port.close()
        assert are_closed_again(before)
        open_port(other.url, LINE).close()
        assert are_closed_again(before)


def test_nothing_stays_open_over_50_pulled_cables() -> None:
    before = settled_descriptors()
    for _ in range(50):
        with terminal() as far:
            port = open_port(far.url, LINE)
            far.unplug()
            with pytest.raises(LinkError):
                port.read(1.0)
            port.close()
    assert are_closed_again(before)


def test_a_port_opens_again_after_its_cable_was_pulled(tmp_path: Path) -> None:
    by_id = tmp_path / "usb-FTDI-if00"
    with terminal() as first, terminal() as second:
        by_id.symlink_to(first.url)
        port = open_port(str(by_id), LINE)
        first.unplug()
        with pytest.raises(LinkError):
            port.read(1.0)
        port.close()
        by_id.unlink()
        with pytest.raises(LinkError, match="no such port"):
            open_port(str(by_id), LINE)
        by_id.symlink_to(second.url)
        port = open_port(str(by_id), LINE)
        second.say(b"here again")
        assert port.read(1.0) == b"here again"
        port.close()


def test_a_descriptor_port_never_closes_a_number_twice() -> None:
    """A second close would close whatever got the same number meanwhile."""
    calls: list[int] = []
    port = DescriptorPort("/dev/x", 99, lambda: calls.append(99))
    port.close()
    port.close()
    assert calls == [99]
