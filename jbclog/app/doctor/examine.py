"""Everything that `doctor` looks at, in order: this machine first, then its ports or the stations of a line."""

from __future__ import annotations

import time
from pathlib import Path

from jbclog.app.discovery.scan_ports import Means, Told
from jbclog.app.doctor.clock import clock_is_kept, look_at_clock
from jbclog.app.doctor.disk import look_at_folder
from jbclog.app.doctor.ports import NONE_PLUGGED, look_at_usb_port
from jbclog.app.doctor.result import Fine, Looked
from jbclog.app.doctor.stations import look_at_stations
from jbclog.config.line import Line
from jbclog.transport.system_ports import usb_ports


def examine(line: Line | None, out: Path, told: Told = lambda _: None, means: Means | None = None) -> list[Looked]:
    """Look at this machine and, with a line, at each of its stations; without one at the USB ports, which are not opened."""
    looked = [*look_at_folder(out), look_at_clock(time.time(), clock_is_kept())]
    return looked + (_usb() if line is None else look_at_stations(line, told, means))


def _usb() -> list[Looked]:
    ports: list[Looked] = [look_at_usb_port(port) for port in usb_ports()]
    return ports or [Fine("port", "USB", NONE_PLUGGED)]
