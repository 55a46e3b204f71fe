"""USB serial ports of this computer: their names, the lasting ones first, and the timer that holds answers back."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from serial.tools import list_ports

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
