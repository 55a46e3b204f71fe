"""Serial ports of this computer: their names, and the processes that hold them."""

from __future__ import annotations

import contextlib
import os
import stat
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.operating_system import processes

BY_ID: Final = Path("/dev/serial/by-id")
TIMERS: Final = Path("/sys/bus/usb-serial/devices")


@dataclass(frozen=True, slots=True)
class UsbPort:
    """A USB adapter. `name` is a persistent name that survives replugging, if the system has one;
    else the device.
    """

    device: str
    name: str
    title: str


def usb_ports(by_id: Path = BY_ID) -> list[UsbPort]:
    """List the USB serial ports by device."""
    from serial.tools import list_ports  # a run and its guard do not load this

    ports = [port for port in list_ports.comports() if port.vid is not None]
    ports.sort(key=lambda port: port.device)
    return [
        UsbPort(port.device, lasting_name(port.device, by_id), port.description or "")
        for port in ports
    ]


def lasting_name(device: str, by_id: Path = BY_ID) -> str:
    """Return the persistent name of `device`, by the adapter's serial number; `device` if there is
    none.
    """
    with contextlib.suppress(OSError):
        for link in sorted(by_id.iterdir()):
            if os.path.realpath(link) == os.path.realpath(device):
                return str(link)
    return device


def latency_timer(device: str, timers: Path = TIMERS) -> Path | None:
    """Return the file of the adapter's latency timer in milliseconds; None if there is none."""
    timer = timers / Path(os.path.realpath(device)).name / "latency_timer"
    if timer.is_file():
        return timer
    return None


TAKE_A_WORD: Final = ("-W", "-X")
"""Options of Python whose value is the next word."""
PSEUDO_TERMINALS: Final = "/dev/pts"
MAJORS_OF_PSEUDO_TERMINALS: Final = range(136, 144)


def holder_of(device: str) -> int | None:
    """Return the id of the process that has locked `device`, or else opened it; None if unknown."""
    process = locker_of(device)
    if process is not None:
        return process
    return next(_openers(device), None)


def locker_of(device: str) -> int | None:
    """Return the id of the process that has locked `device`; None if there is none or it is
    unknown.

    A line of /proc/locks ends in ``PID MAJOR:MINOR:INODE FIRST LAST``.
    """
    with contextlib.suppress(OSError, ValueError):
        node = Path(device).stat()
        name = f"{os.major(node.st_dev):02x}:{os.minor(node.st_dev):02x}:{node.st_ino}"
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()
            if name in words:
                process = int(words[words.index(name) - 1])
                if process > 0:
                    return process
    return None


def sharers_of(device: str) -> list[int]:
    """Return the other processes that have `device` open (the same user's, or all for root): they
    take bytes meant for us.

    Excludes the program behind a pseudo-terminal, even if it holds both ends.
    """
    return [process for process in _openers(device) if not is_behind(device, process)]


def openers_of(devices: Iterable[str]) -> set[tuple[str, int]]:
    """Return the (device, process) pairs of other processes that have one of `devices` open, in one
    pass over /proc.
    """
    nodes: dict[tuple[int, int], str] = {}
    for device in devices:
        with contextlib.suppress(OSError, ValueError):
            node = Path(device).stat()
            nodes[node.st_rdev, node.st_ino] = device
    openers = set[tuple[str, int]]()
    if not nodes:
        return openers
    for process in _other_processes():
        for opened in _open_files(process):
            shared = nodes.get((opened.st_rdev, opened.st_ino))
            if shared is not None:
                openers.add((shared, process))
    return openers


def is_behind(device: str, process: int) -> bool:
    """Return True if `device` is a pseudo-terminal and `process` holds its other end."""
    folder, number = os.path.split(os.path.realpath(device))
    if folder != PSEUDO_TERMINALS or not number.isdigit():
        return False
    with contextlib.suppress(OSError):
        for description in Path(f"/proc/{process}/fdinfo").iterdir():
            with contextlib.suppress(OSError):
                if f"tty-index:\t{number}\n" in description.read_text():
                    return True
    return False


def sharers_text(url: str) -> str:
    """Say which other programs have the port open; empty if none is known."""
    sharers = sharers_of(url)
    if not sharers:
        return ""
    return (
        f"{url} is open in {processes_text(sharers)}, too, which takes answers that are meant for"
        " this program: end that program"
    )


def processes_named(name: str) -> list[int]:
    """Return the processes with this command name (at most 15 characters, /proc/PID/comm)."""
    named = []
    for process in processes():
        with contextlib.suppress(OSError):
            if Path(f"/proc/{process}/comm").read_text().strip() == name:
                named.append(process)
    return named


def processes_text(processes: Iterable[int]) -> str:
    """Format processes: ``process 4711 (minicom), process 4712 (cat)``."""
    return ", ".join(map(process_text, processes))


def process_text(process: int | None) -> str:
    """Format a process: ``process 4711 (minicom)``."""
    if process is None:
        return "another program"
    if process == os.getpid():
        return "this program itself"
    with contextlib.suppress(OSError):
        return f"process {process} ({_program(process)})"
    return f"process {process}"


def _program(process: int) -> str:
    """Name a process's program; one in Python by its file or module. Raises OSError."""
    name = Path(f"/proc/{process}/comm").read_text().strip()
    if not name.startswith("python"):
        return name
    command = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
    words = [word.decode("utf-8", "replace") for word in command[1:] if word]
    return script_name(words) or "a Python program"


def script_name(words: Sequence[str]) -> str | None:
    """Return the file or module that Python runs with these arguments; None if it is neither."""
    rest = iter(words)
    for word in rest:
        if word in TAKE_A_WORD:
            next(rest, None)
        elif word.startswith("-") and word.endswith("m"):
            return next(rest, None)
        elif word.startswith("-c"):
            return None
        elif not word.startswith("-"):
            return Path(word).name
    return None


def _other_processes() -> Iterator[int]:
    return (process for process in processes() if process != os.getpid())


def _openers(device: str) -> Iterator[int]:
    """Yield other processes that have it open: the same user's, or all for root."""
    try:
        node = Path(device).stat()
    except (OSError, ValueError):
        return
    for process in _other_processes():
        if any(_is_same(opened, node) for opened in _open_files(process)):
            yield process


def _open_files(process: int) -> Iterator[os.stat_result]:
    """Yield the status of everything that a process has open."""
    with contextlib.suppress(OSError), os.scandir(f"/proc/{process}/fd") as descriptors:
        for descriptor in descriptors:
            with contextlib.suppress(OSError):
                yield descriptor.stat()


def _is_same(opened: os.stat_result, wanted: os.stat_result) -> bool:
    """Return True if both are one file or two nodes of one device. Each mount numbers its
    pseudo-terminals separately.
    """
    if os.path.samestat(opened, wanted):
        return True
    are_devices = stat.S_ISCHR(opened.st_mode) and stat.S_ISCHR(wanted.st_mode)
    return (
        are_devices
        and opened.st_rdev == wanted.st_rdev
        and os.major(wanted.st_rdev) not in MAJORS_OF_PSEUDO_TERMINALS
    )


class SharedPortWatch:
    """Finds processes that share the devices `urls`; reports each once.

    They take bytes meant for the run, and advisory locks do not stop them. A search takes tens of
    milliseconds, so it runs in a thread.
    """

    def __init__(self, urls: Iterable[str]) -> None:
        self._devices = [url for url in urls if Path(url).is_absolute()]
        self._known: set[tuple[str, int]] = set()
        self._found: list[tuple[str, str]] = []
        self._thread: threading.Thread | None = None

    def look(self) -> None:
        """Start a search unless one is running."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._look, name="sharers", daemon=True)
            self._thread.start()

    def news(self) -> Iterator[tuple[str, str]]:
        """Yield devices and the processes that share them, each pair once."""
        while self._found:
            yield self._found.pop(0)

    def _look(self) -> None:
        for device, process in sorted(openers_of(self._devices) - self._known):
            self._known.add((device, process))
            if not is_behind(device, process):
                self._found.append((device, process_text(process)))
