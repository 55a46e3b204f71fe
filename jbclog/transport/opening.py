"""Opening: any URL that pyserial knows, for this program alone where the system can keep others out."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

import serial

from jbclog.errors import LinkError, PortBusy
from jbclog.transport.port import BROKEN, DescriptorPort, ObjectPort, Port
from jbclog.wire import LineFormat

try:
    import fcntl
    import termios
except ImportError:  # Windows, which opens every port for one program alone
    fcntl = termios = None  # type: ignore[assignment]  # told apart below

BUSY = (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES)


def open_port(url: str, line: LineFormat, *, exclusive: bool = True) -> Port:
    """Open `url` at the rate and format of `line`.

    Raises `PortBusy` naming who holds the port where that can be found out, `LinkError` for everything else.
    """
    try:
        opened = serial.serial_for_url(url, do_not_open=True)
        opened.baudrate = line.baudrate
        opened.parity = line.parity
        opened.stopbits = line.stop_bits
        opened.timeout = opened.write_timeout = 0 if "://" not in url else 1
        opened.xonxoff = opened.rtscts = False  # check bytes can be XON and XOFF (digest A.2)
        if exclusive and "://" not in url:
            opened.exclusive = True
        opened.open()
    except BROKEN as error:
        raise _refused(url, error) from error
    descriptor = _descriptor(opened)
    if descriptor is None:
        return ObjectPort(url, opened)
    if exclusive and "://" not in url:
        _keep_others_out(descriptor)
    return DescriptorPort(url, opened, descriptor)


def _descriptor(opened: serial.SerialBase) -> int | None:
    """The descriptor to watch, where there is one."""
    if fcntl is None:
        return None
    try:
        found = opened.fileno()
    except (OSError, AttributeError):  # io.UnsupportedOperation is an OSError
        return None
    return found if isinstance(found, int) and found >= 0 else None


def _keep_others_out(descriptor: int) -> None:
    """Beside pyserial's advisory lock: let the kernel refuse others (not root).

    Not on a pseudo-terminal: the mark outlives a killed recorder as long as the other end keeps the terminal open.
    """
    with contextlib.suppress(OSError):
        if not os.ttyname(descriptor).startswith("/dev/pts/"):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)


def _refused(url: str, error: BaseException) -> LinkError:
    number = getattr(error, "errno", None)
    if "lock" in str(error) or (number in BUSY and number != errno.EACCES):
        holder = holder_of(url)
        who = f"by {holder}" if holder else "by another program"
        return PortBusy(f"{url} is in use {who}; end that first")
    if number == errno.EACCES:
        return LinkError(f"{url}: no permission to open it; add the user to the group that owns the device (often dialout)")
    if number == errno.ENOENT or isinstance(error, FileNotFoundError):
        return LinkError(f"{url}: there is no such port; is it plugged in?")
    return LinkError(f"{url}: it cannot be opened: {error}")


def holder_of(url: str) -> str | None:
    """Who holds the lock on a device, or has it open: ``process 4711 (minicom)``; None where /proc does not tell."""
    try:
        device = Path(url).stat()
    except OSError:
        return None
    pid = _locker(device) or _opener(device)
    if pid is None:
        return None
    with contextlib.suppress(OSError):
        return f"process {pid} ({Path(f'/proc/{pid}/comm').read_text().strip()})"
    return f"process {pid}"


def _locker(device: os.stat_result) -> int | None:
    """The process with a lock on the device: a line of /proc/locks ends in ``PID MAJOR:MINOR:INODE 0 EOF``."""
    place = f"{os.major(device.st_dev):02x}:{os.minor(device.st_dev):02x}:{device.st_ino}"
    with contextlib.suppress(OSError):
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()
            if place in words:
                return int(words[words.index(place) - 1])
    return None


def _opener(device: os.stat_result) -> int | None:
    """Another process that has the device open (Linux; one's own processes, or all as root)."""
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        with contextlib.suppress(OSError):
            found, pid = link.stat(), int(link.parts[2])
            if (found.st_dev, found.st_ino) == (device.st_dev, device.st_ino) and pid != os.getpid():
                return pid
    return None
