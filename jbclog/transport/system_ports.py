"""The serial ports of this computer: their names, and which programs hold them."""

from __future__ import annotations

import contextlib
import os
import stat
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from serial.tools import list_ports

# -- usb ----------------------------------------------------------------------------------------------------------------------
# USB serial ports of this computer: their names, the lasting ones first, and the timer that holds answers back.

BY_ID: Final = Path("/dev/serial/by-id")
TIMERS: Final = Path("/sys/bus/usb-serial/devices")


@dataclass(frozen=True, slots=True)
class UsbPort:
    """One adapter. `name` is what stays the same when cables are moved, where the system has such a name; else the device."""

    device: str
    name: str
    title: str


def usb_ports(by_id: Path = BY_ID) -> list[UsbPort]:
    """Every USB serial port, in the order of their devices; other ports of this computer are none."""
    found = sorted((port for port in list_ports.comports() if port.vid is not None), key=lambda port: port.device)
    return [UsbPort(port.device, lasting_name(port.device, by_id), port.description or "") for port in found]


def lasting_name(device: str, by_id: Path = BY_ID) -> str:
    """The name of `device` that goes by the adapter's own number; `device` where there is none."""
    return next((str(link) for link in _links(by_id) if _same(link, Path(device))), device)


def _links(folder: Path) -> Iterator[Path]:
    with contextlib.suppress(OSError):
        yield from sorted(folder.iterdir())


def _same(link: Path, device: Path) -> bool:
    try:
        return os.path.realpath(link) == os.path.realpath(device)
    except OSError:
        return False


def latency_timer(device: str, timers: Path = TIMERS) -> Path | None:
    """The file with the milliseconds for which the adapter of `device` holds an answer back; None where it has no such timer."""
    with contextlib.suppress(OSError):
        timer = timers / Path(os.path.realpath(device)).name / "latency_timer"
        return timer if timer.is_file() else None
    return None


# -- holder -------------------------------------------------------------------------------------------------------------------
# Who holds a port: read from /proc, where there is one.

PSEUDO_TERMINALS: Final = "/dev/pts"
MAJORS_OF_PSEUDO_TERMINALS: Final = range(136, 144)


def holder_of(device: str) -> int | None:
    """The number of the process that has `device` locked, or else open; None where the system does not tell."""
    try:
        wanted = Path(device).stat()
    except (OSError, ValueError):
        return None
    return _locker(wanted) or next(_openers(wanted), None)


def locker_of(device: str) -> int | None:
    """The number of the process that has `device` locked; None where none has, or the system does not tell."""
    try:
        return _locker(Path(device).stat())
    except (OSError, ValueError):
        return None


def sharers_of(device: str) -> list[int]:
    """The other processes that have `device` open: those of the same user, all for root. They read what was meant for us.

    The program behind a pseudo-terminal is none of them, even where it holds both ends.
    """
    try:
        wanted = Path(device).stat()
    except (OSError, ValueError):
        return []
    number = _number_of_terminal(device)
    return [process for process in _openers(wanted) if number is None or not _is_behind(process, number)]


def openers_of(devices: Iterable[str]) -> set[tuple[str, int]]:
    """Which of `devices` which other process has open, whatever it is: one walk through the system for all of them."""
    wanted: dict[tuple[int, int], str] = {}
    for device in devices:
        with contextlib.suppress(OSError, ValueError):
            found = Path(device).stat()
            wanted[found.st_rdev, found.st_ino] = device
    processes = [process for process in _processes() if process != os.getpid()] if wanted else []
    return {(wanted[number], process) for process in processes for number in _open_in(process) if number in wanted}


def is_behind(device: str, process: int) -> bool:
    """Whether `device` is a pseudo-terminal and this process the program behind it."""
    number = _number_of_terminal(device)
    return number is not None and _is_behind(process, number)


def _open_in(process: int) -> Iterator[tuple[int, int]]:
    """Device number and inode of all that a process has open."""
    with contextlib.suppress(OSError), os.scandir(f"/proc/{process}/fd") as descriptors:
        for descriptor in descriptors:
            with contextlib.suppress(OSError):
                found = descriptor.stat()
                yield found.st_rdev, found.st_ino


def in_words_all(processes: Iterable[int]) -> str:
    """Who they are: ``process 4711 (minicom), process 4712 (cat)``."""
    return ", ".join(map(in_words, processes))


def in_words(process: int | None) -> str:
    """Who that is: ``process 4711 (minicom)``."""
    if process is None:
        return "another program"
    if process == os.getpid():
        return "this program itself"
    with contextlib.suppress(OSError):
        return f"process {process} ({Path(f'/proc/{process}/comm').read_text().strip()})"
    return f"process {process}"


def _locker(wanted: os.stat_result) -> int | None:
    """The process with a lock: a line of /proc/locks ends in ``PID MAJOR:MINOR:INODE FIRST LAST``."""
    place = f"{os.major(wanted.st_dev):02x}:{os.minor(wanted.st_dev):02x}:{wanted.st_ino}"
    with contextlib.suppress(OSError, ValueError):
        for line in Path("/proc/locks").read_text().splitlines():
            words = line.split()
            if place in words and (process := int(words[words.index(place) - 1])) > 0:
                return process
    return None


def _openers(wanted: os.stat_result) -> Iterator[int]:
    """Other processes that have it open: those of the same user, all for root."""
    return (process for process in _processes() if process != os.getpid() and _has_open(process, wanted))


def _number_of_terminal(device: str) -> int | None:
    """The number of a pseudo-terminal; None of anything else."""
    folder, name = os.path.split(os.path.realpath(device))
    return int(name) if folder == PSEUDO_TERMINALS and name.isdigit() else None


def _is_behind(process: int, number: int) -> bool:
    """Whether it holds the other end of that pseudo-terminal."""
    with contextlib.suppress(OSError):
        for told in Path(f"/proc/{process}/fdinfo").iterdir():
            with contextlib.suppress(OSError):
                if f"tty-index:\t{number}\n" in told.read_text():
                    return True
    return False


def _processes() -> list[int]:
    with contextlib.suppress(OSError):
        return [int(place.name) for place in Path("/proc").iterdir() if place.name.isdigit()]
    return []


def _has_open(process: int, wanted: os.stat_result) -> bool:
    with contextlib.suppress(OSError), os.scandir(f"/proc/{process}/fd") as descriptors:
        for descriptor in descriptors:
            with contextlib.suppress(OSError):
                if _is_same(descriptor.stat(), wanted):
                    return True
    return False


def _is_same(opened: os.stat_result, wanted: os.stat_result) -> bool:
    """One file, or two nodes of one device; the numbers of pseudo-terminals are given anew on each mount of theirs."""
    if os.path.samestat(opened, wanted):
        return True
    are_devices = stat.S_ISCHR(opened.st_mode) and stat.S_ISCHR(wanted.st_mode)
    return are_devices and opened.st_rdev == wanted.st_rdev and os.major(wanted.st_rdev) not in MAJORS_OF_PSEUDO_TERMINALS


# -- sharers ------------------------------------------------------------------------------------------------------------------
# Other programs that have a run's ports open: they read what was meant for it, and no lock keeps them out (a lock only asks).
#
# Looking through all that is open on a machine takes tens of milliseconds, so that it is done in a thread.


class Sharers:
    """Looks who shares the devices `urls` with this program; each is told once."""

    def __init__(self, urls: Iterable[str]) -> None:
        self._devices = [url for url in urls if Path(url).is_absolute()]
        self._known: set[tuple[str, int]] = set()
        self._found: list[tuple[str, str]] = []
        self._thread: threading.Thread | None = None

    def look(self) -> None:
        """Begin to look, unless a look is still going on."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = threading.Thread(target=self._look, name="sharers", daemon=True)
            self._thread.start()

    def news(self) -> Iterator[tuple[str, str]]:
        """Devices and the programs that share them, that have not been told yet."""
        while self._found:
            yield self._found.pop(0)

    def _look(self) -> None:
        for device, process in sorted(openers_of(self._devices) - self._known):
            self._known.add((device, process))
            if not is_behind(device, process):
                self._found.append((device, in_words(process)))
