"""Tell one device from another behind the same name: an adapter that was plugged out and in again
is not known to be the one from before, nor to lead to the same station.
"""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from jbclog.core.serial_line import NETWORK, port_address, scheme_of

SYSTEM_DEVICES: Final = Path("/sys/dev/char")


@dataclass(frozen=True, slots=True)
class PortDevice:
    """The device, or the server, that a port leads to; None where the system has no such fact.

    `server`: host and TCP port. `number`: the device number. `changed_ns`: st_ctime of the node,
    which is made anew at each plugging. `usb`: bus and `devnum`, which the kernel counts up at each
    plugging. `serial`: the adapter's serial number.
    """

    server: str | None = None
    number: int | None = None
    changed_ns: int | None = None
    usb: str | None = None
    serial: str | None = None


def device_of(url: str, descriptor: int | None, system: Path = SYSTEM_DEVICES) -> PortDevice | None:
    """Return what the open port at `url` leads to; None if that cannot be known."""
    if scheme_of(url) in NETWORK:
        address = port_address(url)
        return PortDevice(server=f"{address.name}:{address.number}") if address.number else None
    if descriptor is None:
        return None
    try:
        node = os.fstat(descriptor)
    except OSError:
        return None
    if not stat.S_ISCHR(node.st_mode):
        return None
    usb, serial = _usb(system / f"{os.major(node.st_rdev)}:{os.minor(node.st_rdev)}")
    return PortDevice(None, node.st_rdev, node.st_ctime_ns, usb, serial)


def _usb(link: Path) -> tuple[str | None, str | None]:
    """Return bus and number of the USB device above a device in sysfs, and its serial number."""
    if not link.exists():
        return None, None
    device = Path(os.path.realpath(link))
    for folder in device.parents:
        number = _text(folder / "devnum")
        if number is not None:
            return f"{_text(folder / 'busnum')}-{number}", _text(folder / "serial")
    return None, None


def _text(path: Path) -> str | None:
    with suppress(OSError, ValueError):
        return path.read_text().strip()
    return None
