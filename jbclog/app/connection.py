"""Connects to one station of a line file outside of a run.

::

    load_line -> Target -> open_port (refused during a run, read-only unless allowed) ->
    blocking.run pulls the steps
"""

from __future__ import annotations

import difflib
import json
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Final, TypeVar

from jbclog import __version__
from jbclog.app.port_access import SYSTEM, PortAccess
from jbclog.config.line import Line, load_line
from jbclog.core.clock import utc_text
from jbclog.core.disk_space import write_failure
from jbclog.core.durable_files import write_new
from jbclog.core.errors import PortBusy, RecordError, StartRefused, UsageError
from jbclog.core.io_requests import Steps
from jbclog.protocol import frame, omega
from jbclog.protocol.commands.family import FAMILIES, OMEGA, Family
from jbclog.record.port_owner import run_of, run_that_holds
from jbclog.session.manual.contact import Target
from jbclog.session.manual.danger import Snapshot
from jbclog.transport.port import Port
from jbclog.transport.read_only import OnlyReads, ReadOnly
from jbclog.transport.system_ports import sharers_text

T = TypeVar("T")
# suffixes for further snapshots within the same second
NUMBERS: Final = ("", *(f"-{number}" for number in range(2, 100)))


def target_in(path: Path, name: str) -> Target:
    """Return the station of that name in the line file at `path`.

    Raises `Problems`, or `UsageError` with the names that exist.
    """
    return target_of(load_line(path), name)


def target_of(line: Line, name: str) -> Target:
    """Return the station of that name. Raises `UsageError` with the names that exist."""
    found = next((station for station in line.stations if station.name == name), None)
    if found is None:
        names = [station.name for station in line.stations]
        near = difflib.get_close_matches(name[:64], names, n=1)
        meant = f"did you mean {near[0]}? It has" if near else "it has"
        raise UsageError(f"{line.path} has no station {name!r}; {meant} {', '.join(names)}")
    family = FAMILIES.get(found.family)
    return Target(
        found.name, found.url, family, found.line_format, found.address, found.ports, found.model
    )


def ask(
    target: Target, steps: Steps[T], access: PortAccess = SYSTEM, *, may_write: bool = False
) -> T:
    """Run `steps` on the target's port and return their result. The port passes only reads, unless
    `may_write`.

    Raises `PortBusy` naming the run that holds the port, and whatever the steps raise.
    """
    try:
        _refuse_during_run(target)
    except BaseException:
        steps.close()  # a coroutine that is dropped before it has begun would warn
        raise
    only_reads = None if may_write else only_reads_for(target.family)
    try:
        return access.run(steps, lambda: _open(target, only_reads, access))
    except StartRefused as error:
        sharers = sharers_text(target.url)
        if not sharers:
            raise
        own = str(error).removeprefix(f"{target.name}: ")
        raise StartRefused(f"{target.name}: {sharers}; {own}") from error


def utc_of(moment: float, access: PortAccess = SYSTEM) -> str:
    """Convert a monotonic time of this process to UTC: ``2026-11-21T01:30:00.000000Z``."""
    return utc_text(access.utc_of(moment))


def keep_snapshot(
    snapshot: Snapshot, before: str, path: Path | None, access: PortAccess = SYSTEM
) -> Path:
    """Save a snapshot, synced, at `path`, or in the current folder under station and time; return
    its path.

    Never overwrites a file. Raises `RecordError`.
    """
    time = utc_of(access.clock.monotonic(), access)
    stamp = time.partition(".")[0].replace("-", "").replace(":", "")
    name = f"{snapshot.station}-settings-{stamp}Z"
    facts = {"time": time, "before": before, "jbclog": __version__, **asdict(snapshot)}
    kept = (json.dumps(facts, indent=1, ensure_ascii=False) + "\n").encode()
    try:
        return _put(
            kept,
            [path] if path is not None else [Path(f"{name}{number}.json") for number in NUMBERS],
        )
    except OSError as error:
        where = path or Path(f"{name}.json")
        raise RecordError(
            f"{where}: the snapshot cannot be saved: {write_failure(error, where)}; nothing was"
            " written"
        ) from error


def _put(kept: bytes, free: list[Path]) -> Path:
    """Write `kept` to the first of these paths that is free. Raises `OSError`."""
    *others, last = free
    for path in others:
        with suppress(FileExistsError):
            write_new(path, kept)
            return path
    write_new(last, kept)
    return last


def only_reads_for(family: Family | None) -> OnlyReads:
    """Return the filter for reads of the protocol of `family`; None is a family not known yet,
    addressed as JBC.
    """
    return omega.only_reads if family is not None and family.protocol == OMEGA else frame.only_reads


def _open(target: Target, only_reads: OnlyReads | None, access: PortAccess) -> Port:
    try:
        port = access.open_port(target.url, target.line)
    except PortBusy as busy:
        run = run_of(busy.process) if busy.process is not None else None
        if run is None:
            raise
        raise _held(target, run) from busy
    return port if only_reads is None else ReadOnly(port, only_reads)


def _refuse_during_run(target: Target) -> None:
    """Refuse during a run, which keeps its stations while a cable is out, and behind servers that
    accept a second client.
    """
    run = run_that_holds(target.url)
    if run is not None:
        raise _held(target, run)


def _held(target: Target, run: Path) -> PortBusy:
    folder = run.relative_to(Path.cwd()) if run.is_relative_to(Path.cwd()) else run
    return PortBusy(
        f"{target.name}: the run {folder} holds this station; nothing was sent. End that run, or"
        " wait for its end"
    )
