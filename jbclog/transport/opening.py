"""Opens ports: any URL that pyserial knows, for this program alone, as many as the system allows.

pyserial finds, opens and sets up the port. From a device its descriptor is then taken over by a duplicate and
pyserial's object closed, with the four pipe ends that it opens beside each device: lock and settings belong to what is
open, not to the number, and stay. So each port costs one descriptor, not five.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import sys
from collections.abc import Callable
from queue import Queue

import serial
from jbclog.core.errors import LinkError, PortBusy, PortForbidden, PortMissing, UsageError
from jbclog.core.wire import SCHEMES, LineFormat, scheme_of
from jbclog.transport.port import BROKEN, SLICE_S, DescriptorPort, ObjectPort, Port, give_back, lost
from jbclog.transport.system_ports import holder_of, in_words

# -- descriptors --------------------------------------------------------------------------------------------------------------
# Descriptors: how many ports one process may hold open.

EACH_PORT = 1  # `opening.py` frees the pipes that pyserial opens beside each device
BESIDE = 160  # the record, the loop, the interpreter, and eight ports being opened with five each


def allow_ports(ports: int) -> None:
    """Raise this process's soft limit so that `ports` ports fit. Raises `UsageError` where the hard limit forbids it."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
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
        f"{ports} ports need {wanted} open files and this process may have only {hard}; raise that with "
        f"`ulimit -Hn {wanted}` as root or LimitNOFILE={wanted} in the systemd unit, or record the line in two runs"
    )


# -- opening ------------------------------------------------------------------------------------------------------------------

try:
    import fcntl
    import termios
except ImportError:  # Windows, which opens every port for one program alone
    fcntl = termios = None  # type: ignore[assignment]  # told apart below

HELD_BY_SYSTEM = 1 << 16  # bytes of a connection that wait to be read; a server that sends more has to wait
MOST_WAITING = 4096  # bytes of an rfc2217 port
WRITE_S = 1.0  # only for ports that pyserial writes to itself
PSEUDO_TERMINALS = "/dev/pts/"
LOCKED = (errno.EBUSY, errno.EAGAIN)
TOO_MANY = (errno.EMFILE, errno.ENFILE)


def open_port(url: str, line: LineFormat, *, exclusive: bool = True) -> Port:
    """Open `url` at the rate and format of `line`, for this program alone (a device; a socket's server decides itself).

    Raises `PortBusy`, which names who holds the port where that can be found out, and `LinkError` for all else.
    """
    opened = None
    _expect_port(url)
    try:
        opened = serial.serial_for_url(url, do_not_open=True)
        _set_up(opened, url, line, exclusive)
        _open(opened, line.parity)
    except BROKEN as error:
        raise _refused(url, _device(opened, url), error) from error
    try:
        return _port(url, opened, exclusive)
    except BaseException as error:  # whatever it is: a port that nobody holds would be locked all the same
        give_back(opened.close)
        if isinstance(error, OSError):
            raise lost(url, "it went while it was opened", error) from error
        raise


def make_ready(url: str) -> None:
    """Load what it takes to open such a port, and open nothing: when it must be opened the disk may be gone."""
    with contextlib.suppress(*BROKEN, LinkError):
        _expect_port(url)
        serial.serial_for_url(url, do_not_open=True)
        "host".encode("idna")


def _expect_port(url: str) -> None:
    """Raise `LinkError` where the url is of a kind that is never opened: pyserial acts on some while it only parses them."""
    if "://" in url and scheme_of(url) not in SCHEMES:
        kinds = ", ".join(f"{scheme}://" for scheme in SCHEMES)
        raise LinkError(f"{url}: it is no port that may be opened; give a device such as /dev/ttyUSB0, or one of {kinds}")


def _set_up(opened: serial.SerialBase, url: str, line: LineFormat, exclusive: bool) -> None:
    opened.baudrate = line.baudrate
    opened.stopbits = line.stop_bits
    opened.xonxoff = opened.rtscts = False  # check bytes can be XON and XOFF (docs/reference/protocol.md, Check byte)
    opened.timeout = SLICE_S
    if not url.startswith("rfc2217:"):  # which knows no time-out of writing
        opened.write_timeout = WRITE_S
    if termios is not None:
        opened.inter_byte_timeout = 0  # VMIN 1: "nothing there" and "hung up" become two different answers
    if exclusive:
        opened.exclusive = True


def _open(opened: serial.SerialBase, parity: str) -> None:
    """A pseudo-terminal has no parity; where nothing else changes, the C library makes an error of that."""
    _let_reader_end(opened)
    is_terminal = is_pseudo_terminal(str(opened.port))
    opened.parity = serial.PARITY_NONE if is_terminal else parity
    opened.open()  # type: ignore[attr-defined]  # every port has it, the stubs' base has not
    if is_terminal:
        with contextlib.suppress(*BROKEN):
            opened.parity = parity  # odd leaves its mark there (`sim`)


def _let_reader_end(opened: serial.SerialBase) -> None:
    """pyserial's rfc2217 reads in a thread of its own, which answers a server that has gone with a traceback on stderr."""
    loop = getattr(opened, "_telnet_read_loop", None)  # so named in every pyserial there has been
    if loop is None:
        return

    def read_on() -> None:
        with contextlib.suppress(*BROKEN):
            loop()

    opened._telnet_read_loop = read_on  # type: ignore[attr-defined]  # found on the object when it is opened


def is_pseudo_terminal(device: str) -> bool:
    """Whether a program and no wire stands behind `device`, as with virtual stations."""
    return os.path.realpath(device).startswith(PSEUDO_TERMINALS)


def _device(opened: serial.SerialBase | None, url: str) -> str:
    """The path behind the URL: hwgrep:// finds one."""
    return str(getattr(opened, "port", None) or url)


def _port(url: str, opened: serial.SerialBase, exclusive: bool) -> Port:
    connection = getattr(opened, "_socket", None)  # so named in every pyserial there has been
    descriptor = _descriptor(url, opened)
    if isinstance(connection, socket.socket):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, HELD_BY_SYSTEM)
        return _connected(url, opened, connection, descriptor)
    return ObjectPort(url, opened) if descriptor is None else _device_port(url, opened, descriptor, exclusive)


def _connected(url: str, opened: serial.SerialBase, connection: socket.socket, descriptor: int | None) -> Port:
    """pyserial's own closing sleeps 0.3 s, and leaves the connection open where the server went first."""

    let_all_in = _bound(opened)

    def hang_up() -> None:
        with contextlib.suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)
        connection.close()
        let_all_in()

    if descriptor is None:
        return ObjectPort(url, opened, hang_up)
    opened.is_open = False  # so that it does not close the connection a second time
    return DescriptorPort(url, descriptor, hang_up)


def _bound(opened: serial.SerialBase) -> Callable[[], None]:
    """pyserial's rfc2217 puts each byte into a queue without an end, in a thread of its own: let that wait where nobody reads.

    Gives what lets the thread go on, to its end, when the port is closed.
    """
    queue = getattr(opened, "_read_buffer", None)  # so named in every pyserial there has been
    if not isinstance(queue, Queue):
        return lambda: None
    queue.maxsize = MOST_WAITING

    def let_all_in() -> None:
        with queue.mutex:
            queue.maxsize = sys.maxsize
            queue.not_full.notify_all()

    return let_all_in


def _device_port(url: str, opened: serial.SerialBase, descriptor: int, exclusive: bool) -> Port:
    if exclusive:
        _keep_others_out(descriptor)
    with contextlib.suppress(*BROKEN):  # FTDI adapters hold an answer back for 16 ms unless told so
        opened.set_low_latency_mode(True)  # type: ignore[attr-defined]  # Linux only
    own = os.dup(descriptor)
    try:
        opened.close()
        return DescriptorPort(url, own, lambda: _close_device(own))
    except BaseException:
        os.close(own)
        raise


def _descriptor(url: str, opened: serial.SerialBase) -> int | None:
    """The descriptor to watch, where there is one and pyserial does not stand between it and the bytes."""
    if fcntl is None or url.startswith("spy:"):
        return None
    try:
        found = opened.fileno()
    except (OSError, AttributeError):  # io.UnsupportedOperation is an OSError
        return None
    return found if isinstance(found, int) and found >= 0 else None


def _keep_others_out(descriptor: int) -> None:
    """Beside pyserial's lock, which only asks: let the kernel refuse others (not root).

    Not on a pseudo-terminal: the mark outlives a killed recorder as long as the other end keeps the terminal open.
    """
    with contextlib.suppress(OSError):
        if not os.ttyname(descriptor).startswith(PSEUDO_TERMINALS):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def _close_device(descriptor: int) -> None:
    with contextlib.suppress(OSError):
        fcntl.ioctl(descriptor, termios.TIOCNXCL)  # another program may still have it open, and the mark would stay
    os.close(descriptor)


def _refused(url: str, device: str, error: BaseException) -> LinkError:
    number = _number(error) or _number(error.__context__)
    if number in LOCKED or "lock" in str(error):
        process = holder_of(device)
        return PortBusy(f"{url} is in use by {in_words(process)}; end that, or take another port", process)
    if number in TOO_MANY:
        return LinkError(f"{url}: this process may not open more files; raise the limit with `ulimit -n`")
    if number == errno.EACCES:
        return PortForbidden(f"{url}: no permission to open it; add the user to the group that owns the device (often dialout)")
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return PortMissing(f"{url}: there is no such port; see that it is plugged in")
    if number == errno.ENOTTY:
        return LinkError(f"{url}: it is no serial port; give a device such as /dev/ttyUSB0")
    if number == errno.ECONNREFUSED:
        return LinkError(f"{url}: nobody listens there; see that the server runs")
    if isinstance(error, ValueError | TypeError):  # pyserial could make nothing of it
        return LinkError(f"{url}: it is no port; give a device such as /dev/ttyUSB0, or socket://HOST:PORT")
    return LinkError(f"{url}: it cannot be opened: {error}")


def _number(error: BaseException | None) -> int | None:
    """The system's number of an error; termios has it as its first argument only."""
    told = (getattr(error, "errno", None), *getattr(error, "args", ()))
    return next((number for number in told if isinstance(number, int)), None)
