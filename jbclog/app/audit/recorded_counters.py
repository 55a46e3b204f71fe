"""What a run in progress has read of a station, in the place of asking it: a run is never disturbed.

The run's own station is the one on the same port; what it is called there does not matter.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from pyarrow import ArrowException

from jbclog.app.audit.past_runs import counted_to, error_events
from jbclog.app.audit.questions import SurveyTarget, is_parameter, parameter_name
from jbclog.core.errors import JbclogError
from jbclog.core.rows import StationFacts
from jbclog.core.wire import is_one_port
from jbclog.maintenance.counter_totals.observed import Count, Errors, Identity, Observation, Standing
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import FAMILIES, Family
from jbclog.record.conclude import known_stations
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import read_manifest
from jbclog.record.store_reader import StoreReader

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

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
        counts=tuple(map(_count, counts)),
        tools=dict(facts.tools),
        parameters=dict(_parameters(record)),
        errors=_errors(record, wanted),
    )


def _count(told: _Told) -> Count:
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
