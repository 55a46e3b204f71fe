"""Who holds a port: read from /proc, where there is one."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def holder_of(device: str) -> int | None:
    """The number of the process that has `device` locked, or else open; None where the system does not tell."""
    try:
        wanted = Path(device).stat()
    except (OSError, ValueError):
        return None
    return _locker(wanted) or _opener(wanted)


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


def _opener(wanted: os.stat_result) -> int | None:
    """Another process that has it open: those of the same user, all for root."""
    for process in _processes():
        if process != os.getpid() and _has_open(process, wanted):
            return process
    return None


def _processes() -> list[int]:
    with contextlib.suppress(OSError):
        return [int(place.name) for place in Path("/proc").iterdir() if place.name.isdigit()]
    return []


def _has_open(process: int, wanted: os.stat_result) -> bool:
    with contextlib.suppress(OSError), os.scandir(f"/proc/{process}/fd") as descriptors:
        for descriptor in descriptors:
            with contextlib.suppress(OSError):
                if os.path.samestat(descriptor.stat(), wanted):
                    return True
    return False
