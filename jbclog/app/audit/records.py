"""What the records of runs give an audit: counters of a run in progress, errors, verifications."""

from __future__ import annotations

import os
import sqlite3
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from pyarrow import ArrowException

from jbclog.app.audit.questions import SurveyTarget, is_parameter, parameter_name
from jbclog.config.tasks_file import Task
from jbclog.core.errors import JbclogError, RecordError
from jbclog.core.rows import StationFacts
from jbclog.core.serial_line import is_one_port
from jbclog.maintenance.counter_totals.observed import Count, Errors, Fact, Identity, Observation, Standing
from jbclog.maintenance.verification.verification import Verification
from jbclog.maintenance.verification.verifications_file import NAME, Book, last_valid, places_of, read_book
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.record.conclude import known_stations
from jbclog.record.find_runs import Filter, Found, Unreadable, find
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import read_manifest
from jbclog.record.store_reader import StoreReader

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

# -- past runs ----------------------------------------------------------------------------------------------------------------
# What the records of runs tell of errors since an audit last looked: the runs in the folder that `jbclog audit --runs` names.
#
# An error that came and went between two audits only a run can have seen. Each look at a station says up to which moment errors
# were counted (`Errors.until`), and the next one counts from there on: whatever runs there are meanwhile, one that goes on over
# several audits among them, an event counts once. What a recorder has not put down yet counts the next time (`LAG`).

LAG: Final = timedelta(seconds=10)  # a recorder commits each second, and waits that long for a disk at the most
COUNTED: Final = ("error", "critical")  # severities of events
MOST_TOLD: Final = 3

Place = tuple[str, str]
"""Line and station."""
Events = Mapping[str, int]
"""How many of each kind."""


@dataclass(slots=True)
class PastRuns:
    """What the runs of a folder tell of each station up to `until`. `trouble` says what of them cannot be read."""

    until: str = ""
    events: dict[Place, Counter[str]] = field(default_factory=dict)
    since: Mapping[Place, str] = field(default_factory=dict)
    folders: set[Path] = field(default_factory=set)
    is_read: bool = True
    trouble: list[str] = field(default_factory=list)

    def with_errors(self, seen: Observation) -> Observation:
        """What was seen of a station, with the errors that these runs saw; those of a run that is none of them are added."""
        place = (seen.line, seen.station)
        if not seen.seen or place not in self.since:
            return seen
        errors, told = seen.errors, self.events.get(place)
        if not self.is_read:  # the next audit counts from where this one should have
            return replace(seen, errors=replace(errors, events=None, until=self.since[place]))
        if errors.events is not None and Path(os.path.realpath(seen.source.removeprefix("run:"))) not in self.folders:
            told = Counter(errors.events) + (told or Counter())
        until = max(self.until, self.since[place], key=datetime.fromisoformat)
        return replace(seen, errors=replace(errors, events=None if told is None else dict(told), until=until))


def counted_to(audit: str) -> str:
    """Up to when the audit that began then counts."""
    return (datetime.fromisoformat(audit) - LAG).astimezone(UTC).isoformat(timespec="milliseconds")


def past_runs(folder: Path, since: Mapping[Place, str], audit: str) -> PastRuns:
    """The errors of each station of `since` from its moment on, in the runs directly below `folder`. Never raises."""
    told = PastRuns(counted_to(audit), since=since)
    try:
        if not folder.is_dir():
            raise RecordError(f"{folder}: there is no such folder of runs")
        for run in _runs(folder, since, told):
            _count(run, told)
    except RecordError as error:
        told.trouble.append(f"{error}; errors since last time were not counted, and will be by the next audit")
        told.is_read = False
    return told


def _runs(folder: Path, since: Mapping[Place, str], told: PastRuns) -> Iterator[Found]:
    """Those with one of these stations, that had not ended before."""
    if not since:
        return
    begin = min(map(datetime.fromisoformat, since.values()))
    unreadable = []
    for run in find(folder, Filter(ended_since=begin)):
        if isinstance(run, Unreadable):
            unreadable.append(run)
        elif any((run.line, station) in since for station in run.stations):
            yield run
    told.trouble += [f"{one.folder}: {one.why}" for one in unreadable[:MOST_TOLD]]
    if len(unreadable) > MOST_TOLD:
        told.trouble.append(f"{folder}: {len(unreadable) - MOST_TOLD} other runs cannot be read")


def _count(found: Found, told: PastRuns) -> None:
    from jbclog.analysis.run import open_run

    places = [(found.line or "", station) for station in found.stations]
    try:
        run = open_run(found.folder)
        counted = {
            place: error_events(run, place[1], told.since[place], told.until)
            for place in places
            if place in told.since and _is_within(found, told.since[place], told.until)
        }
    except (JbclogError, OSError, ValueError) as error:
        told.trouble.append(f"{found.folder}: its errors cannot be read: {error}")
        return
    told.folders.add(Path(os.path.realpath(found.folder)))
    for place, events in counted.items():
        told.events.setdefault(place, Counter()).update(events)


def _is_within(found: Found, since: str, until: str) -> bool:
    began = found.started is None or datetime.fromisoformat(found.started) < datetime.fromisoformat(until)
    ended = found.ended is not None and datetime.fromisoformat(found.ended) < datetime.fromisoformat(since)
    return began and not ended


def error_events(run: Run, station: str, since: str | None, until: str) -> Events:
    """How many errors of each kind a run's record has of a station, from `since` (included) to `until`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # damage to a record is told by `check`
        events = run.events(station, start=since, stop=until)
    counted = events[events["severity"].isin(COUNTED)]["kind"].value_counts()
    return {str(kind): int(count) for kind, count in sorted(counted.items())}


# -- recorded counters --------------------------------------------------------------------------------------------------------
# What a run in progress has read of a station, in the place of asking it: a run is never disturbed.
#
# The run's own station is the one on the same port; what it is called there does not matter.

FRESH: Final = timedelta(hours=1)  # the counters' own resolution
NOW: Final = timedelta(minutes=2)  # what was read of errors before is no more "now"


class _Told(NamedTuple):
    """A row of `counters`."""

    time: datetime
    port: int
    counter: str
    value: float | None
    unit: str
    raw: str


@dataclass(frozen=True, slots=True)
class _Record:
    """The record of one station in a run; `now` is the moment of looking."""

    run: Run
    facts: StationFacts
    now: datetime

    @property
    def family(self) -> Family | None:
        return FAMILIES.get(self.facts.family)


def observed_in(folder: Path, wanted: SurveyTarget, now: datetime) -> Observation:
    """The station as the run in `folder` has it. `seen` is false, with the reason, where it has no counters of it yet."""
    source = f"run:{folder}"
    try:
        record = _record(folder, wanted, now)
        counts = [] if record is None else list(_newest(record))
        if record is None or (not counts and record.family is not None and record.family.counters):
            return replace(wanted.unseen(_text(now), _nothing_yet(folder, record)), source=source)
        return _observation(wanted, record, counts, source)
    except (JbclogError, OSError, sqlite3.Error, ArrowException) as error:
        return replace(wanted.unseen(_text(now), f"the run {folder} has it, and its record cannot be read: {error}"), source=source)


def _record(folder: Path, wanted: SurveyTarget, now: datetime) -> _Record | None:
    from jbclog.analysis.run import open_run

    facts = next((one for one in _facts(folder) if is_one_port(one.url, wanted.target.url)), None)
    return None if facts is None else _Record(open_run(folder), facts, now)


def _facts(folder: Path) -> list[StationFacts]:
    """What the run knows of its stations by now; where it was sealed meanwhile, what its manifest says."""
    with StoreReader(folder) as stock:
        stored = known_stations(stock, [])
    if stored or not (folder / MANIFEST).exists():
        return stored
    manifest = read_manifest(folder)
    return manifest.stations if manifest.state == "sealed" else []


def _nothing_yet(folder: Path, record: _Record | None) -> str:
    has = (
        "has not asked it yet" if record is None or record.facts.model is None else "has read no counter of it within the last hour"
    )
    return f"the run {folder} has this station, and {has}; it was left alone. Audit again in a minute, or when the run has ended"


def _observation(wanted: SurveyTarget, record: _Record, counts: list[_Told], source: str) -> Observation:
    facts = record.facts
    return Observation(
        _text(max((one.time for one in counts), default=record.now)),
        wanted.audit,
        wanted.line,
        wanted.target.name,
        wanted.target.url,
        seen=True,
        source=source,
        identity=Identity(facts.family, facts.model, facts.software),
        counts=tuple(map(_recorded_count, counts)),
        tools=dict(facts.tools),
        parameters=dict(_parameters(record)),
        errors=_errors(record, wanted),
    )


def _recorded_count(told: _Told) -> Count:
    if told.value is None:
        return Count(told.port, told.counter, told.unit, None, Standing.UNREAD, (), told.raw.strip("<>"))
    return Count(told.port, told.counter, told.unit, told.value, Standing.OK, (told.value,))


# -- from the tables --------------------------------------------------------------------------------------------------------


def _newest(record: _Record) -> Iterator[_Told]:
    """The newest reading of each counter that gave a value within the last hour; where none did, the newest that failed."""
    newest: dict[tuple[int, str], _Told] = {}
    for rows in record.run.stream("counters", record.facts.name, start=record.now - FRESH):
        for time, port, counter, value, unit, raw in rows[list(_Told._fields)].itertuples(index=False, name=None):
            told = _Told(time.to_pydatetime(), int(port), str(counter), _number(value), str(unit), str(raw))
            if told.value is not None or newest.get((told.port, told.counter), told).value is None:
                newest[told.port, told.counter] = told
    yield from newest.values()


def _number(value: float | None) -> float | None:
    return None if value is None or value != value else float(value)  # pandas: a float that is none


def _parameters(record: _Record) -> Iterator[tuple[str, str]]:
    """Each setting as it was read last."""
    commands = {} if record.family is None else record.family.commands
    rows = record.run.settings(record.facts.name)
    for port, setting, readback in rows[["port", "setting", "readback"]].itertuples(index=False, name=None):
        command = commands.get(setting)
        if command is not None and is_parameter(command) and isinstance(readback, str):
            yield parameter_name(setting, None if command.scope is Scope.STATION else int(port)), readback


def _errors(record: _Record, wanted: SurveyTarget) -> Errors:
    family, name = record.family, record.facts.name
    rows = record.run.samples(name, start=record.now - NOW, columns=["port", "station_error", "port_error"])
    stations, ports = rows["station_error"].dropna(), rows.dropna(subset=["port_error"])
    if family is None:
        return Errors()
    station = family.station_errors.text(int(stations.iloc[-1])) if len(stations) else None
    codes = {int(port): int(code) for port, code in zip(ports["port"], ports["port_error"], strict=True)}
    until = max(counted_to(wanted.audit), wanted.since or "")
    events = error_events(record.run, name, wanted.since, until)
    return Errors(station, {port: family.port_errors.text(code) for port, code in codes.items()}, dict(events), until)


def _text(moment: datetime) -> str:
    return moment.astimezone(UTC).isoformat(timespec="milliseconds")


# -- verifications ------------------------------------------------------------------------------------------------------------
# When each tip was verified last, from the file of verifications beside the runs, as if somebody had told the ledger.

TASK: Final = "verification"
"""The task whose last time verifications tell."""

"""Line and station."""


def verified(runs: Path, places: Iterable[Place]) -> tuple[list[Fact], list[str]]:
    """The last valid verification of each port of these stations; and what is wrong with the file. Never raises.

    The file knows stations by their names alone: where two lines have one of a name, it is of both.
    """
    try:
        book = read_book(runs)
    except RecordError as error:
        return [], [str(error)]
    wrong = [f"{runs / NAME}: line {number} {text}" for number, text in book.wrong if "cut off" not in text]
    return [_fact(place, one, runs) for place in places for one in _last(book, place[1])], wrong


def _last(book: Book, station: str) -> Iterator[Verification]:
    for port in places_of(book, station):
        one = last_valid(book, station, port)
        if one is not None:
            yield one


def _fact(place: Place, one: Verification, runs: Path) -> Fact:
    time = datetime.fromisoformat(one.time).astimezone(UTC).isoformat(timespec="milliseconds")
    text = f"port {one.port} verified by {one.by}, {one.result.upper()}: line {one.seq} of {runs / NAME}"
    return Fact(time, time, one.by, *place, TASK, one.port, one.tip, text)


def with_never(tasks: Sequence[Task], runs: Path) -> list[Task]:
    """The tasks, of which that of verifications says that no verification is known."""
    never = f"never verified, as far as {runs / NAME} and the ledger tell"
    return [replace(task, never=never) if task.name == TASK else task for task in tasks]
