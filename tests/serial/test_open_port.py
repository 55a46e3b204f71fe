"""Ports as users name them, opened on real pseudo-terminals and real servers."""

from __future__ import annotations

import errno
import fcntl
import shutil
import socket
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread
from threading import enumerate as enumerate_threads

import pytest

import serial
from serial import rfc2217
from support.command import until
from support.links.far_ends import (
    Server,
    StubbornServer,
    Terminal,
    open_descriptors,
    rfc2217_server,
    server,
    settled_descriptors,
    terminal,
)
from support.product import (
    HOLD_PORT,
    MOST_WAITING,
    LineFormat,
    LinkError,
    ObjectPort,
    Port,
    PortBusy,
    PortForbidden,
    PortMissing,
    bytes_waiting,
    greeting_text,
    holder_of,
    make_ready,
    open_port,
    patch,
    process_text,
)

LINE = LineFormat()
EVERY_BYTE = bytes(range(256))
TIOCGEXCL = 0x80045440  # asks whether TIOCEXCL holds; Python has no name for it
# in pyserial
rfc2217_of_python_3_11 = pytest.mark.filterwarnings(
    "ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning"
)


def test_every_byte_passes_a_device_both_ways() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        port.write(EVERY_BYTE)
        assert far.heard_all(256) == EVERY_BYTE
        far.say(EVERY_BYTE)
        assert _heard(port, 256) == EVERY_BYTE  # XON, XOFF, NUL and carriage returns too
        port.close()


def test_every_byte_passes_a_socket_both_ways() -> None:
    with server() as far:
        port = open_port(far.url, LINE)
        port.write(EVERY_BYTE)
        assert far.client.recv(1024) == EVERY_BYTE
        far.client.sendall(EVERY_BYTE)
        assert _heard(port, 256) == EVERY_BYTE
        port.close()


def test_nothing_is_there() -> None:
    with terminal() as far, server() as other:
        for url in (far.url, other.url, "loop://"):
            port = open_port(url, LINE)
            assert port.read_now() == b""
            began = time.monotonic()
            assert port.read(0.05) == b""
            assert 0.045 < time.monotonic() - began < 30
            assert port.read(0.0) == port.read(-1.0) == b""
            port.close()


def test_a_read_returns_with_the_first_bytes() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        far.say(b"\x02")
        began = time.monotonic()
        assert port.read(60.0) == b"\x02"
        assert time.monotonic() - began < 30
        port.close()


def test_rate_and_format_are_set() -> None:
    with terminal() as far:
        port = open_port(far.url, LineFormat(57600, "8N2"))
        descriptor = port.fileno()
        assert descriptor is not None
        iflag, _, cflag, lflag, ispeed, ospeed, cc = termios.tcgetattr(descriptor)
        assert ispeed == ospeed == termios.B57600
        assert cflag & termios.CSTOPB
        assert not cflag & termios.CRTSCTS
        assert not iflag & (termios.IXON | termios.IXOFF)
        assert not lflag & (termios.ICANON | termios.ECHO | termios.ISIG)
        assert cc[termios.VMIN] == 1
        port.close()


# the ends of manual 000's list that are no termios constant or slow
@pytest.mark.parametrize("baudrate", [1200, 250000])
def test_the_printed_rates_open(baudrate: int) -> None:
    with terminal() as far:
        open_port(far.url, LineFormat(baudrate)).close()


@pytest.mark.parametrize("form", ["8E1", "8O1", "8N1"])
def test_a_terminal_opens_with_any_parity_again_and_again(form: str) -> None:
    """It keeps no parity, which the C library reports as an error if nothing else changes."""
    with terminal() as far:
        for _ in range(3):
            port = open_port(far.url, LineFormat(19200, form))
            assert bool(termios.tcgetattr(far.far)[2] & termios.PARODD) is (form == "8O1")
            port.close()


def test_a_loop_has_no_descriptor_and_works() -> None:
    port = open_port("loop://", LINE)
    assert port.fileno() is None
    port.write(EVERY_BYTE)
    assert _heard(port, 256) == EVERY_BYTE
    port.close()


@pytest.mark.parametrize(
    "url",
    [
        "spy://{far}?file={file}",
        "SPY://{far}?file={file}",
        "spy:///dev/null?file={file}",
        "alt://{far}",
    ],
)
def test_a_kind_of_port_that_writes_files_or_loads_code_is_not_even_parsed(
    tmp_path: Path, url: str
) -> None:
    """When pyserial parses a spy:// URL, it opens the file in it for writing."""
    file = tmp_path / "precious"
    file.write_text("precious")
    with terminal() as far, pytest.raises(LinkError, match="not a port that may be opened"):
        open_port(url.format(far=far.url, file=file), LINE)
    make_ready(url.format(far="/dev/null", file=file))
    assert file.read_text() == "precious"


@rfc2217_of_python_3_11
def test_rfc2217_both_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal() as far, rfc2217_server(far) as remote:
        port = open_port(remote.url, LineFormat(38400))
        assert port.fileno() is None
        assert remote.device.baudrate == 38400
        port.write(EVERY_BYTE)
        assert far.heard_all(256) == EVERY_BYTE  # 255 is doubled on the way
        far.say(b"\x02ASMN DDE\x03\x00")
        assert _heard(port, 11) == b"\x02ASMN DDE\x03\x00"
        with monkeypatch.context() as patch:
            # which setting its time-out anew calls: 0.05 s each time
            patch.delattr(rfc2217.Serial, "_reconfigure_port")
            assert [port.read(0.0) for _ in range(3)] == 3 * [b""]
        port.close()


@pytest.mark.skipif(shutil.which("ser2net") is None, reason="ser2net is not installed")
@rfc2217_of_python_3_11
def test_ser2net(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    with terminal() as far:
        configuration = tmp_path / "ser2net.yaml"
        configuration.write_text(SER2NET.format(number=number, device=far.url))
        with subprocess.Popen(
            ["ser2net", "-d", "-u", "-c", configuration], stderr=subprocess.DEVNULL
        ) as running:
            try:
                _talk_through(
                    _opened_within(60.0, f"rfc2217://127.0.0.1:{number}?ign_set_control"), far
                )
            finally:
                running.kill()


SER2NET = """%YAML 1.1
---
connection: &station
  accepter: telnet(rfc2217),tcp,127.0.0.1,{number}
  connector: serialdev,{device},19200n81,local
"""


def _talk_through(port: Port, far: Terminal) -> None:
    port.write(b"\x02RSMN\x03\x03")
    assert far.heard_all(7) == b"\x02RSMN\x03\x03"
    far.say(b"\x02ASMN DDE\x03\x00")
    assert _heard(port, 11) == b"\x02ASMN DDE\x03\x00"
    port.close()


def _heard(port: Port, length: int) -> bytes:
    heard = b""
    while len(heard) < length and (more := port.read(20.0)):
        heard += more
    return heard


def _opened_within(seconds: float, url: str) -> Port:
    until = time.monotonic() + seconds
    while True:
        try:
            return open_port(url, LINE)
        except LinkError:
            if time.monotonic() > until:
                raise
            time.sleep(0.05)


def test_a_port_costs_one_descriptor() -> None:
    with terminal() as far, server() as other:
        before = settled_descriptors()
        device = open_port(far.url, LINE)
        assert open_descriptors() == before + 1
        device.close()
        assert open_descriptors() == before
        remote = open_port(other.url, LINE)
        assert open_descriptors() == before + 1
        remote.close()
        assert open_descriptors() == before


# -- who holds it ----------------------------------------------------------------------------------


def test_a_second_opening_is_refused_and_says_that_it_is_us() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        with pytest.raises(PortBusy, match="in use by this program itself"):
            open_port(far.url, LINE)
        port.close()
        open_port(far.url, LINE).close()


def test_a_terminal_bears_no_mark_that_would_outlive_a_killed_recorder() -> None:
    with terminal() as far:
        port = open_port(far.url, LINE)
        descriptor = port.fileno()
        assert descriptor is not None
        assert struct.unpack("i", fcntl.ioctl(descriptor, TIOCGEXCL, bytes(4))) == (0,)
        port.close()


def test_another_program_is_named_and_its_death_frees_the_port() -> None:
    with terminal() as far, _holding(far) as holder:
        with pytest.raises(PortBusy) as refused:
            open_port(far.url, LINE)
        assert f"in use by process {holder.pid} (a Python program)" in str(refused.value)
        assert f"end that (`kill {holder.pid}`)" in str(refused.value)
        assert far.url in str(refused.value)
        assert "end that" in str(refused.value)
        holder.kill()
        holder.wait()
        open_port(far.url, LINE).close()


def test_a_link_to_a_held_device_is_busy_too(tmp_path: Path) -> None:
    with terminal() as far, _holding(far) as holder:
        link = tmp_path / "usb-FTDI"
        link.symlink_to(far.url)
        with pytest.raises(PortBusy, match=f"process {holder.pid}"):
            open_port(str(link), LINE)


def test_a_program_that_took_no_lock_is_found_by_its_open_files() -> None:
    script = (
        "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('open', flush=True);"
        " sys.stdin.read()"
    )
    with (
        terminal() as far,
        subprocess.Popen(
            [sys.executable, "-c", script, far.url], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        ) as other,
    ):
        assert other.stdout is not None
        assert other.stdout.readline() == b"open\n"
        assert holder_of(far.url) == other.pid
        assert process_text(other.pid).startswith(f"process {other.pid} (")
        other.kill()
        other.wait()
        assert holder_of(far.url) is None
        assert holder_of("/dev/ttyNOWHERE") is None


def _holding(far: Terminal) -> subprocess.Popen[str]:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD_PORT, far.url],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "held\n"
    return holder


# -- what cannot be opened -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("/dev/ttyNOWHERE", "no such port; check that it is plugged in"),
        ("/dev/null", "not a serial port; give a device such as /dev/ttyUSB0"),
        ("/", "cannot be opened"),
        ("rfc4711://host:1", "not a port that may be opened; give a device"),
        ("socket://nowhere", "cannot be opened"),
        ("hwgrep://no-such-adapter", "cannot be opened"),
        ("", "no such port; check that it is plugged in"),
    ],
)
def test_what_is_no_port_is_a_link_error_with_the_url(url: str, sentence: str) -> None:
    with pytest.raises(LinkError, match=sentence.replace("?", "\\?")) as refused:
        open_port(url, LINE)
    assert str(refused.value).startswith(url)
    assert not isinstance(refused.value, PortBusy)


@pytest.mark.parametrize(
    ("number", "kind", "sentence"),
    [
        (
            errno.EACCES,
            PortForbidden,
            "no permission to open it; add the user to the group that owns the device",
        ),
        (errno.ENODEV, PortMissing, "no such port; check that it is plugged in"),
        (errno.EMFILE, LinkError, "may not open more files; raise the limit"),
    ],
)
def test_what_the_system_refuses_has_its_own_error(
    monkeypatch: pytest.MonkeyPatch, number: int, kind: type[LinkError], sentence: str
) -> None:
    def refuse(self: serial.Serial) -> None:
        raise serial.SerialException(number, "could not open port")

    monkeypatch.setattr(serial.Serial, "open", refuse)
    with pytest.raises(LinkError, match=sentence) as refused:
        open_port("/dev/ttyUSB0", LINE)
    assert type(refused.value) is kind


def test_a_server_that_is_not_there() -> None:
    with socket.socket() as mute:  # its number stays its own, and nobody listens there
        mute.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="connection refused"):
            open_port(f"socket://127.0.0.1:{mute.getsockname()[1]}", LINE)


@rfc2217_of_python_3_11
def test_a_server_that_does_not_speak_rfc2217() -> None:
    with server() as far:
        began = time.monotonic()
        with pytest.raises(LinkError, match="RFC2217"):
            open_port(far.url.replace("socket:", "rfc2217:") + "?timeout=0.2", LINE)
        assert time.monotonic() - began < 30


def test_a_failed_opening_leaves_nothing_open() -> None:
    before = settled_descriptors()
    with terminal() as far:
        port = open_port(far.url, LINE)
        for _ in range(20):
            with pytest.raises(LinkError):
                open_port(far.url, LINE)
            with pytest.raises(LinkError):
                open_port("/dev/null", LINE)
        port.close()
    assert open_descriptors() == before


@pytest.mark.parametrize("step", ["opening._keep_others_out", "opening.DescriptorPort"])
def test_an_opening_that_memory_is_refused_for_locks_nobody_out(
    step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A guard tries again, and must not find the port locked by itself."""

    def refuse(*_: object) -> None:
        raise MemoryError

    before = settled_descriptors()
    with terminal() as far:
        with monkeypatch.context() as meanwhile:
            patch(meanwhile, step, refuse)
            with pytest.raises(MemoryError):
                open_port(far.url, LINE)
        open_port(far.url, LINE).close()
    assert open_descriptors() == before


def test_the_far_end_sees_the_client_go_at_once() -> None:
    far = Server()
    port = open_port(far.url, LINE)
    assert far.client.fileno() >= 0
    port.close()
    assert far.client.recv(10) == b""
    far.end()


@rfc2217_of_python_3_11
def test_an_rfc2217_server_that_sends_without_end_has_to_wait(
    capfd: pytest.CaptureFixture[str],
) -> None:
    """pyserial would keep everything in memory."""
    is_over = Event()
    with terminal() as device, rfc2217_server(device) as server:
        port = open_port(server.url, LineFormat())
        before = {thread for thread in enumerate_threads() if "RFC 2217" in thread.name}

        def flood() -> None:
            assert server.client is not None
            with suppress(OSError):
                while not is_over.is_set():
                    server.client.send(b"x" * 4096)

        sender = Thread(target=flood, daemon=True)
        sender.start()
        assert isinstance(port, ObjectPort)
        assert until(lambda: bytes_waiting(port) >= MOST_WAITING)
        time.sleep(0.5)  # time for more
        assert bytes_waiting(port) <= MOST_WAITING
        assert port.read(20.0).startswith(b"x")
        port.close()
        is_over.set()
        assert until(lambda: not any(thread.is_alive() for thread in before))
    sender.join(5)
    assert before
    assert capfd.readouterr().err == ""


GREETED = 'the server closed the connection and said "Port already in use"'


def test_a_server_that_greets_and_closes_is_quoted() -> None:
    """As ser2net does where another client has the port."""
    with server() as far:
        port = open_port(far.url, LINE)
        far.client.sendall(b"Port already in use\r\n")
        far.client.shutdown(socket.SHUT_WR)
        with pytest.raises(LinkError, match=GREETED):
            until(lambda: port.read(0.05) == b"never")
        port.close()


def test_the_text_is_quoted_where_the_write_fails_first() -> None:
    with server() as far:
        port = open_port(far.url, LINE)
        far.client.sendall(b"Port already in use\r\n")
        far.client.close()
        with pytest.raises(LinkError, match=GREETED):
            until(lambda: port.write(b"x" * 64))
        port.close()


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        (b"\x1b[31mBusy\x1b[0m by host 10.0.0.7\r\n", "[31mBusy"),
        (b"word " * 60, "word " * 23 + "word"),
        (b"\x02" + b"0100ASMN  DDE\x03K", ""),
        (bytes(range(128, 200)), ""),
        (b"text " * 200, ""),
    ],
)
def test_only_a_text_is_a_greeting(said: bytes, shown: str) -> None:
    text = greeting_text(said)
    assert shown in text
    assert bool(text) == bool(shown)
    assert len(text) <= 120
    assert text.isprintable()


@rfc2217_of_python_3_11
@pytest.mark.parametrize(
    ("answers", "why"),
    [
        ({1: 9600}, "baud rate 19200 was asked, it answered 9600; set the server's port to 19200"),
        ({3: 3}, "parity none was asked, it answered even"),
        ({4: 2}, "stop bits 1 was asked, it answered 2"),
        ({2: 7}, "data bits 8 was asked, it answered 7"),
        ({5: 3}, "flow control none was asked, it answered RTS/CTS; add `?ign_set_control`"),
        ({5: None}, "flow control none was asked, it did not answer; add `?ign_set_control`"),
        ({1: None}, "baud rate 19200 was asked, it did not answer"),
    ],
)
def test_a_server_that_does_not_take_the_line_settings(
    answers: dict[int, int | None], why: str
) -> None:
    far = StubbornServer(answers)
    with pytest.raises(LinkError, match="does not take the line settings") as error:
        open_port(far.url, LINE)
    assert why in str(error.value)
    if 5 in answers:  # what the message proposes works
        open_port(f"{far.url}?ign_set_control", LINE).close()
    far.end()
