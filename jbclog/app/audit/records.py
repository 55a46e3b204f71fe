"""Data for an audit from the records of runs: counters of a run in progress, errors,
verifications.
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from pyarrow import ArrowException

from jbclog.app.audit.questions import SurveyTarget, is_parameter, parameter_name
from jbclog.config.tasks_file import Task
from jbclog.core.clock import utc_ms
from jbclog.core.errors import JbclogError, RecordError
from jbclog.core.rows import StationFacts
from jbclog.core.serial_line import is_one_port
from jbclog.maintenance.counter_totals.observed import (
    Count,
    Errors,
    Fact,
    Identity,
    Observation,
    Standing,
)
from jbclog.maintenance.verification import (
    NAME,
    Book,
    Verification,
    last_valid,
    places_of,
    read_book,
)
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.record.conclude import known_stations
from jbclog.record.find_runs import (
    CRASHED,
    Filter,
    Found,
    Unreadable,
    copies_texts,
    find,
    once,
)
from jbclog.record.journal_reader import Journal
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import read_manifest

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

# -- past runs -------------------------------------------------------------------------------------
# Errors since the last audit, in the runs of the folder of `jbclog audit --runs`: only a run can
# have recorded an error that came and went between two audits.
#
# Each observation has the time up to which errors were counted (`Errors.until`), and the next audit
# counts from there. So an event counts once, also in a run that lasts over several audits. What is
# not committed yet counts the next time (`LAG`).

# a recorder commits each second, and waits at most this long for the disk
LAG: Final = timedelta(seconds=10)
COUNTED: Final = ("error", "critical")  # severities of events
SHOWN: Final = 3
UNREADABLE: Final = (JbclogError, OSError, ValueError, ArrowException)
"""What reading a run raises that is not as it should be."""

Place = tuple[str, str]
"""Line and station."""
Events = Mapping[str, int]
"""Number of events of each kind."""


@dataclass(slots=True)
class PastRuns:
    """Errors of each station in the runs of a folder up to `until`. `trouble` lists records that
    cannot be read, and copies that differ from their run.
    """

    until: str = ""
    events: dict[Place, Counter[str]] = field(default_factory=dict)
    since: Mapping[Place, str] = field(default_factory=dict)
    folders: set[Path] = field(default_factory=set)
    is_read: bool = True
    trouble: list[str] = field(default_factory=list)

    def with_errors(self, seen: Observation) -> Observation:
        """Return the observation with the errors in these runs, plus those of its own run if that
        is not among them.
        """
        place = (seen.line, seen.station)
        if not seen.seen or place not in self.since:
            return seen
        errors, events = seen.errors, self.events.get(place)
        if not self.is_read:  # the next audit counts from where this one should have
            return replace(seen, errors=replace(errors, events=None, until=self.since[place]))
        if (
            errors.events is not None
            and Path(os.path.realpath(seen.source.removeprefix("run:"))) not in self.folders
        ):
            events = Counter(errors.events) + (events or Counter())
        until = max(self.until, self.since[place], key=datetime.fromisoformat)
        return replace(
            seen,
            errors=replace(errors, events=None if events is None else dict(events), until=until),
        )


def counted_to(audit: str) -> str:
    """Return the time up to which the audit that began at `audit` counts errors."""
    return utc_ms(datetime.fromisoformat(audit) - LAG)


def past_runs(folder: Path, since: Mapping[Place, str], audit: str) -> PastRuns:
    """Return the errors of each station of `since` from its time on, in the runs directly below
    `folder`. Never raises.
    """
    past = PastRuns(counted_to(audit), since=since)
    try:
        if not folder.is_dir():
            raise RecordError(f"{folder}: no such folder")
        for run in _runs(folder, since, past):
            _count(run, past)
    except RecordError as error:
        past.trouble.append(
            f"{error}; errors since the last audit are not counted now; the next audit counts them"
        )
        past.is_read = False
    return past


def _runs(folder: Path, since: Mapping[Place, str], past: PastRuns) -> list[Found]:
    """Return the runs with one of these stations that had not ended before, each once."""
    if not since:
        return []
    begin = min(map(datetime.fromisoformat, since.values()))
    found, unreadable = list[Found](), list[Unreadable]()
    for run in find(folder, Filter(ended_since=begin)):
        if isinstance(run, Unreadable):
            unreadable.append(run)
        elif any((run.line, station) in since for station in run.stations):
            found.append(run)
    counted, copies = once(found)
    past.folders.update(Path(os.path.realpath(one.folder)) for one in copies)
    past.trouble += copies_texts([one for one in copies if not one.is_same])
    past.trouble += [f"{one.folder}: {one.why}" for one in unreadable[:SHOWN]]
    if len(unreadable) > SHOWN:
        past.trouble.append(f"{folder}: {len(unreadable) - SHOWN} other runs cannot be read")
    return counted


def _count(found: Found, past: PastRuns) -> None:
    from jbclog.analysis.run import open_run

    places = [(found.line or "", station) for station in found.stations]
    try:
        run = open_run(found.folder)
        counted = {
            place: error_events(run, place[1], past.since[place], past.until)
            for place in places
            if place in past.since
            and _is_within(found, past.since[place], past.until)
            and (found.state != CRASHED or _has_rows(run, place[1], past.since[place]))
        }
    except UNREADABLE as error:
        past.trouble.append(f"{found.folder}: its errors cannot be read: {error}")
        return
    past.folders.add(Path(os.path.realpath(found.folder)))
    for place, events in counted.items():
        past.events.setdefault(place, Counter()).update(events)


def _is_within(found: Found, since: str, until: str) -> bool:
    start, end = found.host_start, found.host_stop
    began = start is None or datetime.fromisoformat(start) < datetime.fromisoformat(until)
    ended = end is not None and datetime.fromisoformat(end) < datetime.fromisoformat(since)
    return began and not ended


def _has_rows(run: Run, station: str, since: str) -> bool:
    """Whether a record without an end, because the recorder died, continues after `since`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return any(
            True
            for table in ("events", "samples")
            for _ in run.stream(table, station, start=run.run_time(since))
        )


def error_events(run: Run, station: str, since: str | None, until: str) -> Events:
    """Return kind -> number of a station's errors in a run's record, from `since` (included) to
    `until`, by the host's clock.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # `check` reports damage to a record
        start = None if since is None else run.run_time(since)
        events = run.events(station, start=start, stop=run.run_time(until))
    counted = events[events["severity"].isin(COUNTED)]["kind"].value_counts()
    return {str(kind): int(count) for kind, count in sorted(counted.items())}


# -- recorded counters -----------------------------------------------------------------------------
# The readings of a run in progress, instead of reading the station: a run is never disturbed. The
# station of the run is the one on the same port, whatever its name there.

FRESH: Final = timedelta(hours=1)  # the counters' own resolution
NOW: Final = timedelta(minutes=2)  # errors read before that are not current


class _CounterRow(NamedTuple):
    time: datetime
    port: int
    counter: str
    value: float | None
    uom: str
    raw: str


@dataclass(frozen=True, slots=True)
class _Record:
    """The record of one station in a run, read at `now` by the run's clock."""

    run: Run
    facts: StationFacts
    now: datetime

    @property
    def family(self) -> Family | None:
        return FAMILIES.get(self.facts.family)


def observed_in(folder: Path, wanted: SurveyTarget, now: datetime) -> Observation:
    """Return the station as recorded by the run in `folder`. `seen` is false, with the reason, if
    there are no counters of it yet.
    """
    source = f"run:{folder}"
    try:
        record = _record(folder, wanted, now)
        counts = [] if record is None else list(_newest(record))
        if record is None or (not counts and record.family is not None and record.family.counters):
            return replace(wanted.unseen(utc_ms(now), _nothing_yet(folder, record)), source=source)
        return _observation(wanted, record, counts, source)
    except UNREADABLE as error:
        return replace(
            wanted.unseen(
                utc_ms(now), f"the run {folder} holds it, and its record cannot be read: {error}"
            ),
            source=source,
        )


def _record(folder: Path, wanted: SurveyTarget, now: datetime) -> _Record | None:
    from jbclog.analysis.run import open_run

    facts = next((one for one in _facts(folder) if is_one_port(one.url, wanted.target.url)), None)
    if facts is None:
        return None
    run = open_run(folder)
    return _Record(run, facts, run.run_time(now).to_pydatetime())


def _facts(folder: Path) -> list[StationFacts]:
    """Return the facts of the stations of a run: from its journal, or from its manifest if it was
    sealed meanwhile.
    """
    with Journal(folder) as journal:
        stored = known_stations(journal, [])
    if stored or not (folder / MANIFEST).exists():
        return stored
    manifest = read_manifest(folder)
    return manifest.stations if manifest.is_sealed else []


def _nothing_yet(folder: Path, record: _Record | None) -> str:
    has = (
        "has not asked it yet"
        if record is None or record.facts.model is None
        else "has read none of its counters within the last hour"
    )
    return (
        f"the run {folder} holds this station and {has}; it was not read. Audit again in a minute,"
        " or after the run has ended"
    )


def _observation(
    wanted: SurveyTarget, record: _Record, counts: list[_CounterRow], source: str
) -> Observation:
    facts = record.facts
    return Observation(
        utc_ms(record.run.host_time(max((one.time for one in counts), default=record.now))),
        wanted.audit,
        wanted.line,
        wanted.target.name,
        wanted.target.url,
        seen=True,
        source=source,
        identity=Identity(facts.family, facts.model, facts.software),
        counts=tuple(map(_recorded_count, counts)),
        tool_names=dict(facts.tool_names),
        parameters=dict(_parameters(record)),
        errors=_errors(record, wanted),
    )


def _recorded_count(row: _CounterRow) -> Count:
    if row.value is None:
        return Count(row.port, row.counter, row.uom, None, Standing.UNREAD, (), row.raw.strip("<>"))
    return Count(row.port, row.counter, row.uom, row.value, Standing.OK, (row.value,))


# -- from the tables -------------------------------------------------------------------------------


def _newest(record: _Record) -> Iterator[_CounterRow]:
    """Yield each counter's latest value of the last hour; if none was read, the latest failure."""
    newest: dict[tuple[int, str], _CounterRow] = {}
    for rows in record.run.stream("counters", record.facts.name, start=record.now - FRESH):
        for time, port, counter, value, uom, raw in rows[list(_CounterRow._fields)].itertuples(
            index=False, name=None
        ):
            row = _CounterRow(
                time.to_pydatetime(), int(port), str(counter), _number(value), str(uom), str(raw)
            )
            if row.value is not None or newest.get((row.port, row.counter), row).value is None:
                newest[row.port, row.counter] = row
    yield from newest.values()


def _number(value: float | None) -> float | None:
    return None if value is None or value != value else float(value)  # NaN of pandas


def _parameters(record: _Record) -> Iterator[tuple[str, str]]:
    commands = {} if record.family is None else record.family.commands
    rows = record.run.settings(record.facts.name)
    for port, setting, readback in rows[["port", "setting", "readback"]].itertuples(
        index=False, name=None
    ):
        command = commands.get(setting)
        if command is not None and is_parameter(command) and isinstance(readback, str):
            yield (
                parameter_name(setting, None if command.scope is Scope.STATION else int(port)),
                readback,
            )


def _errors(record: _Record, wanted: SurveyTarget) -> Errors:
    family, name = record.family, record.facts.name
    rows = record.run.samples(
        name, start=record.now - NOW, columns=["port", "station_error", "port_error"]
    )
    stations, ports = rows["station_error"].dropna(), rows.dropna(subset=["port_error"])
    if family is None:
        return Errors()
    station = family.station_errors.text(int(stations.iloc[-1])) if len(stations) else None
    codes = {
        int(port): int(code) for port, code in zip(ports["port"], ports["port_error"], strict=True)
    }
    until = max(counted_to(wanted.audit), wanted.since or "")
    events = error_events(record.run, name, wanted.since, until)
    return Errors(
        station,
        {port: family.port_errors.text(code) for port, code in codes.items()},
        dict(events),
        until,
    )


# -- verifications ---------------------------------------------------------------------------------
# The last verification of each tip, from the file of verifications beside the runs, as entries of
# the ledger.

TASK: Final = "verification"
"""The task of verifications."""


def verified(runs: Path, places: Iterable[Place]) -> tuple[list[Fact], list[str]]:
    """Return the last valid verification of each port of these stations, and the errors of the
    file. Never raises.

    The file has only the names of stations: if two lines have the same name, a verification counts
    for both.
    """
    try:
        book = read_book(runs)
    except RecordError as error:
        return [], [str(error)]
    wrong = [f"{runs / NAME}: {text}" for text in book.damage]
    return [_fact(place, one, runs) for place in places for one in _last(book, place[1])], wrong


def _last(book: Book, station: str) -> Iterator[Verification]:
    for port in places_of(book, station):
        one = last_valid(book, station, port)
        if one is not None:
            yield one


def _fact(place: Place, one: Verification, runs: Path) -> Fact:
    time = utc_ms(datetime.fromisoformat(one.time))
    text = (
        f"port {one.port} verified by {one.by}, {one.result.upper()}: line {one.seq} of"
        f" {runs / NAME}"
    )
    return Fact(time, time, one.by, *place, TASK, one.port, one.tip, text)


def with_never(tasks: Sequence[Task], runs: Path) -> list[Task]:
    """Return the tasks, with the text for a missing verification in that of verifications."""
    never = f"no verification in {runs / NAME} or the ledger"
    return [replace(task, never=never) if task.name == TASK else task for task in tasks]
