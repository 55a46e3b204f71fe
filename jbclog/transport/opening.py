"""Open ports: any pyserial URL, exclusively, as many as the system allows.

pyserial finds, opens and configures the port. For a device the descriptor is then duplicated and
pyserial's object closed, with the four pipe ends that it opens for each device: lock and settings
belong to the open file and stay. So a port costs one descriptor instead of five.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import resource
import select
import socket
import termios
from typing import Final

import serial
from jbclog.core.errors import LinkError, PortBusy, PortForbidden, PortMissing, UsageError
from jbclog.core.serial_line import SCHEMES, LineFormat, scheme_of
from jbclog.transport.port import (
    BROKEN,
    LONGEST_GREETING,
    SLICE_S,
    DescriptorPort,
    ObjectPort,
    Port,
    SocketPort,
    close_in_thread,
    link_lost,
)
from jbclog.transport.rfc2217 import ServerAnswers, limit_queue, silence_reader
from jbclog.transport.system_ports import holder_of, process_text

PYSERIAL: Final = serial.__version__
EACH_PORT = 1  # descriptors; an rfc2217 port has a second one, of its thread, from those beside
# the record, the loop, the interpreter, and eight ports being opened with five descriptors each
BESIDE = 160


def allow_ports(ports: int) -> None:
    """Raise this process's soft limit of open files for `ports` ports. Raises `UsageError` if the
    hard limit is too low.
    """
    wanted = ports * EACH_PORT + BESIDE
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return
    try:
        if hard == resource.RLIM_INFINITY or hard >= wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            return
    except (OSError, ValueError):  # macOS has a ceiling below the hard limit
        pass
    raise UsageError(
        f"{ports} ports need {wanted} open files and this process may have only {hard}; raise that"
        f" with `ulimit -Hn {wanted}` as root or LimitNOFILE={wanted} in the systemd unit, or"
        " record the line in two runs"
    )


# bytes of a connection's receive buffer; beyond it the server has to wait
HELD_BY_SYSTEM = 1 << 16
GREETING_S = 0.05  # a server that refuses says so at once
WRITE_S = 1.0  # write time-out of ports that pyserial writes to
PSEUDO_TERMINALS = "/dev/pts/"
LOCKED = (errno.EBUSY, errno.EAGAIN)
TOO_MANY = (errno.EMFILE, errno.ENFILE)


def open_port(url: str, line: LineFormat) -> Port:
    """Open `url` exclusively, at the rate and format of `line`. For a socket, its server decides
    both.

    Raises `PortBusy`, naming the holder if known, and `LinkError` for everything else.
    """
    opened: serial.SerialBase | None = None
    answers: ServerAnswers | None = None
    _expect_port(url)
    try:
        opened = serial.serial_for_url(url, do_not_open=True)
        _set_up(opened, url, line)
        answers = ServerAnswers(opened)
        _open(opened, line.parity)
    except BROKEN as error:
        problem = None if answers is None else answers.problem(url, line, error)
        if problem is not None:
            raise LinkError(problem) from error
        raise _refused(url, _device(opened, url), error) from error
    try:
        return _port(url, opened)
    except BaseException as error:  # a port left open would stay locked
        close_in_thread(opened.close)
        if isinstance(error, OSError):
            raise link_lost(url, "lost while it was opened", error) from error
        raise


def make_ready(url: str) -> None:
    """Load the modules needed to open such a port, because the disk may be gone later."""
    with contextlib.suppress(*BROKEN, LinkError):
        _expect_port(url)
        serial.serial_for_url(url, do_not_open=True)
        "host".encode("idna")


def _expect_port(url: str) -> None:
    """Raise `LinkError` for a forbidden URL scheme: pyserial acts on some while parsing."""
    if "://" in url and scheme_of(url) not in SCHEMES:
        kinds = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise LinkError(
            f"{url}: not a port that may be opened; give a device such as /dev/ttyUSB0, or one of"
            f" {kinds}"
        )


def _set_up(opened: serial.SerialBase, url: str, line: LineFormat) -> None:
    opened.baudrate = line.baudrate
    opened.stopbits = line.stop_bits
    # check bytes can be XON and XOFF (docs/reference/protocol.md, Check byte)
    opened.xonxoff = opened.rtscts = False
    opened.timeout = SLICE_S
    if not url.startswith("rfc2217:"):  # it has no write time-out
        opened.write_timeout = WRITE_S
    opened.inter_byte_timeout = 0  # VMIN 1 distinguishes "no bytes" from "connection lost"
    opened.exclusive = True


def _open(opened: serial.SerialBase, parity: str) -> None:
    """Open the port. A pseudo-terminal has no parity, and the C library reports an error if nothing
    else changes, so its parity is set afterwards.
    """
    silence_reader(opened)
    is_terminal = is_pseudo_terminal(str(opened.port))
    opened.parity = serial.PARITY_NONE if is_terminal else parity
    opened.open()  # type: ignore[attr-defined]  # every port has it, the stubs' base has not
    if is_terminal:
        with contextlib.suppress(*BROKEN):
            opened.parity = parity  # a virtual station sees odd parity (`sim`)


def is_pseudo_terminal(device: str) -> bool:
    """Return True if `device` leads to a program, as virtual stations do, not to a cable."""
    return os.path.realpath(device).startswith(PSEUDO_TERMINALS)


def _device(opened: serial.SerialBase | None, url: str) -> str:
    """Return the device path of a URL; hwgrep:// searches for it."""
    return str(getattr(opened, "port", None) or url)


def _port(url: str, opened: serial.SerialBase) -> Port:
    connection = getattr(opened, "_socket", None)  # in every pyserial release so far
    descriptor = _descriptor(opened)
    if isinstance(connection, socket.socket):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, HELD_BY_SYSTEM)
        return _connected(url, opened, connection, descriptor)
    if descriptor is None:
        return ObjectPort(url, opened)
    return _device_port(url, opened, descriptor)


def _connected(
    url: str, opened: serial.SerialBase, connection: socket.socket, descriptor: int | None
) -> Port:
    """Wrap a connection. pyserial's own close sleeps 0.3 s, and leaves the connection open if the
    server closed first.
    """

    remove_limit = limit_queue(opened)

    def hang_up() -> None:
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)
        connection.close()
        remove_limit()

    if descriptor is None:
        return ObjectPort(url, opened, hang_up)
    opened.is_open = False  # pyserial must not close the connection again
    return SocketPort(url, descriptor, hang_up, _greeting(connection))


def _greeting(connection: socket.socket) -> bytes:
    """Return what a server says at once, without taking it."""
    watched = select.poll()  # `select` cannot watch a descriptor above 1023
    watched.register(connection, select.POLLIN)
    with contextlib.suppress(OSError):
        if watched.poll(1000 * GREETING_S):
            return connection.recv(LONGEST_GREETING, socket.MSG_PEEK)
    return b""


def _device_port(url: str, opened: serial.SerialBase, descriptor: int) -> Port:
    _keep_others_out(descriptor)
    with contextlib.suppress(*BROKEN):  # by default FTDI adapters delay an answer by 16 ms
        opened.set_low_latency_mode(True)  # type: ignore[attr-defined]  # Linux only
    own = os.dup(descriptor)
    try:
        opened.close()
        return DescriptorPort(url, own, lambda: _close_device(own))
    except BaseException:
        os.close(own)
        raise


def _descriptor(opened: serial.SerialBase) -> int | None:
    """Return the descriptor to watch; None if there is none."""
    try:
        descriptor: int = opened.fileno()
    except (OSError, AttributeError):  # io.UnsupportedOperation is an OSError
        return None
    return descriptor


def _keep_others_out(descriptor: int) -> None:
    """Let the kernel refuse other processes (not root): pyserial's lock is only advisory.

    Not on a pseudo-terminal, where the flag outlives a killed recorder as long as the other end is
    open.
    """
    with contextlib.suppress(OSError):
        if not os.ttyname(descriptor).startswith(PSEUDO_TERMINALS):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def _close_device(descriptor: int) -> None:
    with contextlib.suppress(OSError):
        # the flag would stay while another process has it open
        fcntl.ioctl(descriptor, termios.TIOCNXCL)
    os.close(descriptor)


def _refused(url: str, device: str, error: BaseException) -> LinkError:
    number = _number(error) or _number(error.__context__)
    if number in LOCKED or "lock" in str(error):
        process = holder_of(device)
        how = ""
        if process not in (None, os.getpid()):
            how = f" (`kill {process}`)"
        return PortBusy(
            f"{url} is in use by {process_text(process)}; end that{how}, or take another port",
            process,
        )
    if number in TOO_MANY:
        return LinkError(
            f"{url}: this process may not open more files; raise the limit with `ulimit -n`"
        )
    if number == errno.EACCES:
        return PortForbidden(
            f"{url}: no permission to open it; add the user to the group that owns the device"
            " (often dialout)"
        )
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return PortMissing(f"{url}: no such port; check that it is plugged in")
    if number == errno.ENOTTY:
        return LinkError(f"{url}: not a serial port; give a device such as /dev/ttyUSB0")
    if number == errno.ECONNREFUSED:
        return LinkError(f"{url}: connection refused; check that the server runs")
    if isinstance(error, ValueError | TypeError):  # pyserial cannot parse it
        return LinkError(
            f"{url}: not a port; give a device such as /dev/ttyUSB0, or socket://HOST:PORT"
        )
    return LinkError(f"{url}: cannot be opened: {error}")


def _number(error: BaseException | None) -> int | None:
    """Return the errno; termios has it only as its first argument."""
    for number in (getattr(error, "errno", None), *getattr(error, "args", ())):
        if isinstance(number, int):
            return number
    return None
