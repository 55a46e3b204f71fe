"""Close a run: derive the manifest's accounting, losses and files, and name tools that may be hot.

Safe to repeat after a crash at any point: everything is derived again, and nothing is removed
before a manifest with state "sealed" is on the disk.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core import locks
from jbclog.core.disk_space import write_failure_below
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, open_regular, read_regular
from jbclog.core.json_files import json_of
from jbclog.core.locks import FolderLock
from jbclog.core.operating_system import sync_folder
from jbclog.core.rows import TABLES, EventRow, Severity, StationFacts
from jbclog.core.states import SafetyResult, StationOutcome
from jbclog.core.text import count_text
from jbclog.record import clock_steps, guard_actions
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.damage import DAMAGE_NOTES, REMAINS, Damage, read_damage, summary_of
from jbclog.record.folder import DERIVED, DERIVED_TABLES, derived_file
from jbclog.record.journal_reader import Journal
from jbclog.record.ledger import ledger_of
from jbclog.record.manifest import (
    NAME,
    Lost,
    Manifest,
    RunState,
    SealedFile,
    expect_readable,
    facts_in,
    fitting_units,
    iso,
    merged_facts,
    write_manifest,
)
from jbclog.record.part_chain import NAME as PARTS
from jbclog.record.part_chain import ChainedPart, PartChain
from jbclog.record.part_file import open_part
from jbclog.record.part_writer import collected, write_part
from jbclog.record.parts import part_paths
from jbclog.record.schema import CAPTURE, SCHEMAS
from jbclog.record.units import units_of

# A tool's safe state is unknown if recorder and guard both died, without a guard, or if the guard
# could not log its actions. The open lease and the sessions' last facts name these tools.

KIND: Final = "safety.not_known"
NO_GUARD: Final = "none"  # in the manifest
TOOK_OVER: Final = ("guard.took_over", "guard.left_over")
COLUMNS: Final = ["time", "station", "port", "temperature_c", "status"]


@dataclass(frozen=True, slots=True)
class Lease:
    """The ports of a station, and its feeder, that are not known to be safe."""

    ports: tuple[int, ...] = ()
    feeds: bool = False


class Unknown(NamedTuple):
    """A tool, or with `port` None a feeder, whose safe state is unknown; a sentence about it."""

    station: str
    port: int | None
    text: str
    celsius: float | None


@dataclass(slots=True)
class Last:
    """Last reading of a tool: UTC in µs, temperature in °C, and its status if that was read."""

    time: int
    celsius: float
    status: str | None


def left_leases(folder: Path) -> dict[str, Lease]:
    """Return the folder's open lease by station, as far as it can be read."""
    return _lease(folder)[0]


def _lease(folder: Path) -> tuple[dict[str, Lease], str]:
    """Return the leases by station, and why they cannot be read in full; both empty without a
    lease.
    """
    found: dict[str, Lease] = {}
    try:
        lines = read_regular(folder / guard_actions.LEASE, Kind.LEASE).splitlines()
    except FileNotFoundError:
        return found, ""
    except (OSError, ValueError) as error:
        return found, str(error)
    wrong = ""
    for number, line in enumerate(lines, 1):
        try:
            fields = json_of(line)
            found[str(fields["name"])] = Lease(
                tuple(int(port) for port in fields.get("ports", ())), bool(fields.get("feeds"))
            )
        except (ValueError, KeyError, TypeError, AttributeError):
            wrong = f"line {number} is not a station's lease"
    return found, wrong


def unconfirmed_leases(folder: Path, stations: Collection[StationFacts]) -> set[str]:
    """Return the stations of the open lease, except those whose leased tools are in their safe
    state by the facts.

    A guard killed after it made the tools safe, and logged that, leaves its lease open. A recorder
    that ends closes it: then only the guard's lines count.
    """
    held, known = left_leases(folder), {facts.name: facts for facts in stations}
    if not held.keys() & known.keys():
        return {*held}
    by_guard = {
        (event.station, event.port)
        for event in guard_actions.action_log(folder)
        if event.kind == guard_actions.SAFE
    }
    return {
        name
        for name, lease in held.items()
        if name not in known or not _is_confirmed(known[name], lease, by_guard)
    }


def _is_confirmed(
    facts: StationFacts, lease: Lease, by_guard: Collection[tuple[str | None, int | None]]
) -> bool:
    def is_safe(port: int) -> bool:
        is_open = facts.outcome == StationOutcome.RUNNING or (facts.name, port) in by_guard
        return is_open and facts.safe_state.get(port) == SafetyResult.VERIFIED

    return not facts.unsafe and not lease.feeds and all(is_safe(port) for port in lease.ports)


def _ordered_text(folder: Path) -> str:
    """Say how often the guard ordered stations without an answer: ``; ucr-1 was ordered once``."""
    orders: dict[str, int] = {}
    try:
        events = guard_actions.action_log(folder)
    except OSError:
        return ""
    for event in events:
        if event.kind == guard_actions.NOT_SAFE and event.station and event.value:
            orders[event.station] = max(orders.get(event.station, 0), int(event.value))
    return "".join(
        f"; {station} was ordered {count_text(times, 'time')} without an answer"
        for station, times in sorted(orders.items())
    )


def hot_warning(
    folder: Path, stations: Collection[StationFacts], unsafe: Collection[str] = ()
) -> str:
    """Return the warning about stations that may still be hot, `unsafe` included; empty if there
    are none.

    `stations` are the facts of the record, with the guard's results.
    """
    try:
        left = unconfirmed_leases(folder, stations)
    except OSError:  # of the guard's log: it confirms no tool
        left = {*left_leases(folder)}
    names, why = ", ".join(sorted({*left, *unsafe})), _lease(folder)[1]
    found = []
    if names:
        found.append(
            f"Tools of {names} may still be hot: their safe state is not confirmed"
            f"{_ordered_text(folder)}."
        )
    if why:
        found.append(
            f"{guard_actions.LEASE} cannot be read ({why}): which tools of this run may still be"
            " hot is not known."
        )
    return (
        " ".join([*found, "`jbclog safe`, or a new run on their ports, makes them safe."])
        if found
        else ""
    )


def unknown_tools(folder: Path, stations: list[StationFacts], guard: str | None) -> list[Unknown]:
    """Return the tools and feeders whose safe state is unknown.

    `stations` are the facts with the guard's results, `guard` is the manifest's state of the guard.
    """
    places = [*_places(folder, stations)]
    last = _last_read(folder, {place for place in places if place[1] is not None}) if places else {}
    return [_unknown(place, last.get(place), guard) for place in places]


def _places(folder: Path, stations: list[StationFacts]) -> Iterator[tuple[str, int | None]]:
    held, why = _lease(folder)
    was_taken_over = any(event.kind in TOOK_OVER for event in guard_actions.action_log(folder))
    for facts in stations:
        lease, is_running = (
            held.get(facts.name, Lease()),
            facts.outcome == StationOutcome.RUNNING and facts.asked_safe_state != "",
        )
        ports = {*lease.ports, *(facts.touched if is_running or why else ())}
        yield from ((facts.name, port) for port in sorted(ports - facts.safe_state.keys()))
        if lease.feeds or ((is_running or why) and facts.may_feed and not was_taken_over):
            yield facts.name, None


def _unknown(place: tuple[str, int | None], last: Last | None, guard: str | None) -> Unknown:
    what = "the feeder was stopped" if place[1] is None else "the tool was made safe"
    why = (
        "the recorder ended, and there was no guard"
        if guard == NO_GUARD
        else "recorder and guard ended, or could not write it down"
    )
    text = f"Whether {what} is not known: {why}."
    if place[1] is not None:
        text += f" {_seen(last)}; it may be hot."
    return Unknown(*place, text, last.celsius if last else None)


def _seen(last: Last | None) -> str:
    if last is None:
        return "It was never read"
    moment = datetime.fromtimestamp(last.time / 1_000_000, UTC)
    status = f", {last.status}" if last.status else ""
    return f"Last read {last.celsius:g} °C{status} at {moment:%H:%M:%S} UTC"


def _last_read(
    folder: Path, places: set[tuple[str, int | None]]
) -> dict[tuple[str, int | None], Last]:
    """Return the last reading of each place, searching the samples from their end."""
    found: dict[tuple[str, int | None], Last] = {}
    for path in reversed(part_paths(folder, "samples")):
        with open_part(path) as part:
            for index in reversed(range(part.num_row_groups)):
                group = part.group(index, COLUMNS)
                for place in places - found.keys():
                    last = _last_in(group, *place)
                    if last is not None:
                        found[place] = last
                if places == found.keys():
                    return found
    return found


def _last_in(group: pa.Table, station: str, port: int | None) -> Last | None:
    mine = pc.and_(pc.equal(group["station"], station), pc.equal(group["port"], port))
    read = group.filter(pc.and_(mine, pc.is_valid(group["temperature_c"])))
    if not len(read):
        return None
    row = (
        read.slice(len(read) - 1)
        .set_column(0, "time", read["time"].slice(len(read) - 1).cast(pa.int64()))
        .to_pylist()[0]
    )
    return Last(row["time"], row["temperature_c"], row["status"])


def hot_events(found: list[Unknown], time: int) -> list[EventRow]:
    """Return an event for each, at `time` (UTC in µs), the record's last moment."""
    return [
        EventRow(time, KIND, Severity.CRITICAL, one.text, one.station, one.port, value=one.celsius)
        for one in found
    ]


def with_unknown(stations: list[StationFacts], found: list[Unknown]) -> list[StationFacts]:
    """Return the facts with these sentences added to `unsafe`."""
    texts: dict[str, list[str]] = {}
    for one in found:
        place = one.station if one.port is None else f"{one.station} port {one.port}"
        texts.setdefault(one.station, []).append(f"{place}: {one.text}")
    return [
        replace(facts, unsafe=[*facts.unsafe, *_new(facts, texts.get(facts.name, []))])
        for facts in stations
    ]


def _new(facts: StationFacts, texts: list[str]) -> list[str]:
    return [text for text in texts if text not in facts.unsafe]


NOT_KEPT: Final = "could not be stored while the disk refused them"
OF_REPORT: Final = ("report.html", "report.pdf", "report.json")
DERIVED_FILES: Final = tuple(derived_file(table) for table in DERIVED_TABLES)
# their writer was killed
UNFINISHED: Final = tuple(f"{DERIVED}/.{table}.parquet.tmp" for table in DERIVED_TABLES)
OF_EARLIER: Final = ("joints.parquet", "metrics.parquet")
"""Derived tables where earlier versions left them; nothing reads them."""
LATER: Final = (
    *(NAME, ANNOTATIONS, guard_actions.LEASE, guard_actions.LOCK),
    *(*DERIVED_FILES, *UNFINISHED, *OF_EARLIER),
)
"""Files outside the sealed record: the manifest, annotations, the lease and lock of tools left hot,
and the derived tables.
"""
# folders of a report, and their files' suffixes
MADE: Final = (("figures/", ".svg"), ("tables/", ".csv"))

TAKEN_IN: Final = (
    "line.toml",
    "recipes",
    guard_actions.ACTION_LOG,
    DAMAGE_NOTES,
    REMAINS,
)


def conclude(folder: Path, manifest: Manifest, lock: FolderLock) -> Manifest:
    """Close a run whose rows are all sealed (`seal`); return the manifest as written, in state
    "sealed".

    `manifest` has what only the recorder knows: outcome, verdict, times; stations, ledger, losses
    and files are added here. Releases and removes the lock. Raises `RecordError` before removing
    anything.
    """
    lock.expect_ours()
    try:
        with Journal(folder) as journal:
            _refuse_unsealed(journal)
            _complete(journal.chain)
            stations = stations_of(folder, journal, manifest)
            stations = with_unknown(stations, unknown_tools(folder, stations, manifest.guard))
            dropped = unkept_rows(journal)
        lost = manifest.lost or _lost(read_damage(folder), dropped)
        sealed = replace(
            manifest,
            state=RunState.SEALED,
            stations=stations,
            lost=lost,
            stop=manifest.stop or last_time(folder),
        )
        sealed.ledger = ledger_of(folder, stations)
        guard_actions.tidy(folder)
        sealed.files = [*(part.file for part in _parts(journal.chain)), *other_files(folder)]
        if sealed.clock_steps is not None:
            sealed.clock_steps = clock_steps.listed_steps(folder)
        sealed.units = fitting_units(sealed, units_of(folder))
        expect_readable(sealed)
    except (OSError, pa.ArrowException) as error:
        raise RecordError(
            f"{folder} cannot be sealed: {write_failure_below(error, folder)}"
        ) from error
    write_manifest(folder, sealed)
    remove_live(folder, lock)
    return sealed


def _refuse_unsealed(journal: Journal) -> None:
    rows = sum(len(rows) for table in TABLES for rows in journal.rows(table))
    if rows:
        raise RecordError(
            f"{journal.folder}: {count_text(rows, 'row')} of the journal not sealed yet"
        )


def _complete(chain: PartChain) -> None:
    """Write an empty part for every table without one, so that all tables are readable."""
    for table in TABLES:
        if not part_paths(chain.folder, table):
            chain.add(0, write_part(chain.folder, table, collected(table, ()), 0))


def stations_of(folder: Path, journal: Journal, manifest: Manifest) -> list[StationFacts]:
    """Return the stations' facts with the guard's results, unless something in the record is
    later.
    """
    return guard_actions.with_guard(
        folder, known_stations(journal, manifest.stations), _overtaken(folder)
    )


def _overtaken(folder: Path) -> dict[tuple[str, int], int]:
    """Return from when on (UTC in µs) the guard's results count, for each tool of the open lease.

    The guard logs a tool after the lease, and after the recorder's last reading: a lease or a
    reading later than its line shows that the tool may have been touched again.
    """
    held, why = _lease(folder)
    if not held and not why:
        return {}
    written = (folder / guard_actions.LEASE).lstat().st_mtime_ns // 1000
    logged = [
        (event.station, event.port)
        for event in guard_actions.action_log(folder)
        if event.kind == guard_actions.SAFE
    ]
    open_ports = {(name, port) for name, lease in held.items() for port in lease.ports}
    places = {
        (name, port)
        for name, port in logged
        if name is not None and port is not None and (why or (name, port) in open_ports)
    }
    last = _last_read(folder, {*places}) if places else {}
    host = clock_steps.HostClock(clock_steps.steps_of(folder)) if last else None
    return {
        place: max(written, host.corrected(last[place].time) if host and place in last else 0)
        for place in places
    }


def unkept_rows(journal: Journal) -> int:
    """Return how many rows the disk never took: the larger number of the journal's and the
    lock's.
    """
    dropped = journal.notes.get("dropped", 0)
    return max(dropped if isinstance(dropped, int) else 0, locks.unkept_rows(journal.folder))


def known_stations(journal: Journal, known: list[StationFacts]) -> list[StationFacts]:
    """Return the facts in the journal, in the manifest's order of stations; the manifest's for an
    ended session.
    """
    ended = {facts.name for facts in known if facts.outcome != StationOutcome.RUNNING}
    texts = {
        name: json.dumps(facts)
        for name, facts in sorted(journal.facts.items())
        if name not in ended
    }
    return merged_facts(known, facts_in(journal.folder, texts))


def _lost(found: list[Damage], dropped: int) -> Lost | None:
    parts = summary_of(found)
    if dropped:
        parts.append(f"{count_text(dropped, 'row')} {NOT_KEPT}")
    return Lost(None, "; ".join(parts)) if parts else None


def last_time(folder: Path) -> str | None:
    """Return the time of the last sealed row in the manifest's format; None without a row."""
    latest = last_micros(folder)
    return None if latest is None else iso(latest)


def last_micros(folder: Path) -> int | None:
    """Return the time of the last sealed row, UTC in µs; None without a row."""
    latest = [
        bounds[1]
        for table in TABLES
        for path in part_paths(folder, table)
        for bounds in _time_bounds(path)
        if bounds is not None
    ]
    return max(latest, default=None)


def _time_bounds(path: Path) -> list[tuple[int, int] | None]:
    with open_part(path) as part:
        return part.bounds("time")


def _parts(chain: PartChain) -> list[ChainedPart]:
    """Return the parts that are there, table by table."""
    there = [part for part in chain.parts if (chain.folder / part.file.path).exists()]
    return sorted(there, key=lambda part: ([*SCHEMAS].index(part.table), part.file.path))


def other_files(folder: Path) -> Iterator[SealedFile]:
    """Yield every file of the record but the parts, with its rows, size and hash."""
    for name in TAKEN_IN:
        place = folder / name
        paths = [place] if place.exists() else []
        if place.is_dir():
            paths = sorted(place.iterdir())
        for path in paths:
            yield sealed_file(folder, path, None)


def sealed_file(folder: Path, path: Path, rows: int | None) -> SealedFile:
    with open_regular(path, Kind.RECORD) as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    return SealedFile(path.relative_to(folder).as_posix(), rows, path.stat().st_size, digest)


def is_later(name: str) -> bool:
    """Return True if the file `name` may appear, change and disappear after sealing."""
    return name in LATER or is_of_report(name)


def is_of_report(name: str) -> bool:
    """Return True if `report` writes a file of that name."""
    made = any(name.startswith(folder) and name.endswith(ending) for folder, ending in MADE)
    return name in OF_REPORT or (made and name.count("/") == 1)


def live_files(folder: Path) -> list[Path]:
    """Return the files that a recorder needs and a sealed run does not have."""
    names = ("live[.-]*", PARTS, f"{CAPTURE}-*.journal")
    return sorted(path for name in names for path in folder.glob(name))


def remove_live(folder: Path, lock: FolderLock) -> None:
    """Remove the journal and the lock of a sealed run. Raises `RecordError`."""
    try:
        for path in live_files(folder):
            if path.name != lock.name:
                path.unlink(missing_ok=True)
        lock.remove()
        sync_folder(folder)
    except OSError as error:
        raise RecordError(
            f"{folder}: the journal of a sealed run cannot be removed: {error}"
        ) from error
