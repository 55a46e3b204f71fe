"""Find the run in progress that holds a station's port.

A run holds a port until that station's session ends, even while the link is down and the port
closed. Its manifest lists the ports, its journal the ended sessions, and the lock of its folder
the recorder. This needs /proc; without it only the lock of the port itself protects it. The code
that reads a record is imported only if there is one.
"""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

from jbclog.core.errors import RecordError
from jbclog.core.locks import NAME as LOCK
from jbclog.core.locks import holder_pid, is_held
from jbclog.core.operating_system import open_files, processes
from jbclog.core.serial_line import PortAddress, port_address
from jbclog.core.states import StationOutcome


def run_that_holds(url: str) -> Path | None:
    """Return the folder of the run in progress on this machine that holds the port at `url`, or
    None.
    """
    return next(iter(runs_that_hold([url])), None)


def runs_in_progress() -> Iterator[Path]:
    """Yield the folders that recorders of this user (for root: of all users) are writing to."""
    seen: set[Path] = set()
    for process in processes():
        for folder in _folders_of(process):
            if folder not in seen and is_held(folder):
                seen.add(folder)
                yield folder


def runs_that_hold(urls: Collection[str]) -> list[Path]:
    """Return the folders of the runs in progress here that hold any of the ports at `urls`."""
    wanted = [port_address(url) for url in urls]
    return [folder for folder in runs_in_progress() if _holds(folder, wanted)]


def holds(folder: Path, urls: Collection[str]) -> bool:
    """Return True if the run in `folder` is in progress and holds any of the ports at `urls`."""
    return is_held(folder) and _holds(folder, [port_address(url) for url in urls])


def why_held(urls: Mapping[str, str]) -> dict[str, str]:
    """Return the reason for each station (name to URL) whose port a run holds.

    The port's own lock is not enough: a serial server accepts a second client, and a run holds its
    ports while a link is down.
    """
    found = {}
    for run in runs_that_hold([*urls.values()]):
        process = recorder_of(run)
        who = f"the run {run} (process {process}) holds" if process else f"the run {run} holds"
        for name in (name for name, url in urls.items() if holds(run, [url])):
            found[name] = (
                f"{name}: {who} this port; nothing was sent. End that run or wait for its end"
            )
    return found


def recorder_of(folder: Path) -> int | None:
    """Return the process that records into `folder`: the one in its lock, if it has that open."""
    process = holder_pid(folder)
    return process if process and folder in _folders_of(process) else None


def run_of(process: int) -> Path | None:
    """Return the folder of the run that this process records."""
    return next(_folders_of(process), None)


def _folders_of(process: int) -> Iterator[Path]:
    """Yield the run folders whose locks a process has open. A start looks at all that processes
    have open, so only locks become paths.
    """
    for opened in open_files(process):
        if opened.endswith(f"/{LOCK}"):
            with contextlib.suppress(OSError):
                if Path(opened).exists():
                    yield Path(opened).parent


def _holds(folder: Path, wanted: Collection[PortAddress]) -> bool:
    from jbclog.record.manifest import RunState, read_manifest

    # before the manifest, which says "sealed" if the journal is removed meanwhile
    ended = _ended(folder)
    try:
        manifest = read_manifest(folder)
    except RecordError:
        return False  # it has not sent anything yet
    if manifest.state != RunState.OPEN:
        return False
    held = [
        port_address(facts.url)
        for facts in manifest.stations
        if facts.outcome == StationOutcome.RUNNING and facts.name not in ended
    ]
    return any(one.is_at(other) for one in held for other in wanted)


def _ended(folder: Path) -> set[str]:
    """Return the stations whose session has ended, by what the journal says of them."""
    from jbclog.record.journal_reader import Journal

    # a run may have no readable journal; its stations count as running then
    with contextlib.suppress(RecordError), Journal(folder) as journal:
        return {
            name
            for name, facts in journal.facts.items()
            if isinstance(facts, dict)
            and facts.get("outcome", StationOutcome.RUNNING) != StationOutcome.RUNNING
        }
    return set()
