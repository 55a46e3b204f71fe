"""Who holds a port: read from /proc, where there is one."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

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
