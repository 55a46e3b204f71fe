"""Set up virtual stations from a line file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from time import monotonic

from jbclog.config.line import Line, StationSpec, line_text
from jbclog.config.sim_spec import SimSpec
from jbclog.core.errors import UsageError
from jbclog.protocol.commands.family import FAMILIES, OMEGA
from jbclog.sim.links import Link, PtyLink, TcpLink, Waiter
from jbclog.sim.serve import ByteLog, Servable, Served, Server
from jbclog.sim.virtual import VirtualOmega, VirtualStation


def virtual_station(spec: StationSpec, *, now: float) -> VirtualStation | VirtualOmega:
    """Return the virtual station that a line file describes, switched on at `now`.

    Raises `UsageError` for a station that cannot be virtual.
    """
    family = FAMILIES.get(spec.family)
    if family is not None and family.protocol == OMEGA:
        return VirtualOmega(spec, now=now)
    return VirtualStation(spec, now=now)


def without_joints(line: Line) -> Line:
    """Return the line with stations whose tips rest, for example to try `verify`."""
    resting = [
        (one.sim or SimSpec()).model_copy(update={"joints_per_minute": 0.0})
        for one in line.stations
    ]
    stations = tuple(
        one.model_copy(update={"sim": sim}) for one, sim in zip(line.stations, resting, strict=True)
    )
    return line.model_copy(update={"stations": stations})


SERVED_LINE = "line.toml"
MOST_PORT = 65535
DESCRIPTORS_EACH = 4
DESCRIPTORS_BESIDE = 64

Tcp = tuple[str, int]
"""Host and first port."""


def set_up(
    line: Line,
    folder: Path,
    tcp: Tcp | None = None,
    wire_file: ByteLog | None = None,
    stations: Sequence[Servable] | None = None,
) -> Server:
    """Create the line's ports in `folder` (or on TCP) and write `folder/line.toml`; `run` then
    serves them.

    `stations` are served, in the line's order; by default the virtual ones that the line describes.
    Raises `UsageError` if a station cannot be virtual or a link cannot be created.
    """
    allow_descriptors(DESCRIPTORS_EACH * len(line.stations) + DESCRIPTORS_BESIDE)
    served_line = folder / SERVED_LINE
    _expect_place(served_line, line)
    now, waiter = monotonic(), Waiter()
    stations = stations or [virtual_station(station, now=now) for station in line.stations]
    links = _tcp_links(line, tcp, waiter) if tcp else _pty_links(line, folder.absolute(), waiter)
    server = Server(
        [Served(*pair) for pair in zip(stations, links, strict=True)], waiter, wire_file
    )
    _make(folder)
    try:
        server.open()
        served_line.write_text(_served_text(line, links), encoding="utf-8")
    except BaseException as error:
        server.close()
        if isinstance(error, OSError):
            raise UsageError(f"the stations of {line.path} cannot be served: {error}") from error
        raise
    return server


def _expect_place(served_line: Path, line: Line) -> None:
    """Raise `UsageError` if the line file for the run must not be written."""
    if os.path.realpath(served_line) == os.path.realpath(line.path):
        raise UsageError(
            f"{line.path} would be overwritten with the line file for the run; choose another"
            " folder"
        )
    if served_line.exists() and not served_line.is_file():
        raise UsageError(
            f"{served_line}: not a regular file (folder, pipe or device); the line file must be"
            " written there"
        )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError) as error:
        raise UsageError(
            f"--dir {folder}: a file is in its way; give the name of a folder"
        ) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"--dir {folder}: no folder can be made there ({reason})") from error


def tcp_of(text: str) -> Tcp:
    """Parse ``HOST:PORT``: stations take this port and the next ones; 0: any free ones."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or int(port) > MOST_PORT:
        raise UsageError(f"{text} is not HOST:PORT")
    return host.strip("[]") or "127.0.0.1", int(port)


def _served_text(line: Line, links: Sequence[Link]) -> str:
    """Format a line file like `line` with the URLs of these links."""
    stations = [
        (station.model_copy(update={"url": link.url}), "")
        for station, link in zip(line.stations, links, strict=True)
    ]
    return line_text(line.name, stations, f"Virtual stations, made by jbclog sim from {line.path}")


def _tcp_links(line: Line, tcp: Tcp, waiter: Waiter) -> list[Link]:
    host, first = tcp
    return [
        TcpLink(host, first + place if first else 0, waiter) for place in range(len(line.stations))
    ]


def _pty_links(line: Line, folder: Path, waiter: Waiter) -> list[Link]:
    """Link a station at its relative URL below the folder, one with another URL at its name."""
    paths = [
        folder / (station.written_url if station.is_relative else station.name)
        for station in line.stations
    ]
    for path, station in zip(paths, line.stations, strict=True):
        if paths.count(path) > 1 or path == folder / SERVED_LINE:
            raise UsageError(
                f"{line.path}: {station.name} would be linked at {path}, which has another use;"
                " give it another name or url"
            )
    return [
        PtyLink(path, waiter, station.line_format)
        for path, station in zip(paths, line.stations, strict=True)
    ]


def allow_descriptors(wanted: int) -> None:
    """Raise this process's soft limit of open descriptors to `wanted`, up to the hard limit."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < wanted:
        most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
