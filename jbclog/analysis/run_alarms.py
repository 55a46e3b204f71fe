"""Alarm episodes of a run, computed from its tables.

A table has a row for each episode of each detector (`TABLE`); `Alarms.incidents` puts them side by side. Works also for a run
that is still open or was cut off, as far as its record goes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Final, NamedTuple, cast

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.analysis.alarms import (
    BEFORE_ALL,
    KIND,
    WATCHED,
    Change,
    Detector,
    Episode,
    Figures,
    FlagRead,
    Incident,
    Rows,
    SampledEpisodes,
    Unknown,
    change_of,
    figures,
    flag_episodes,
    incidents,
    rules_of,
)
from jbclog.analysis.alarms.from_record import UNKNOWN as FLAGS_LOST
from jbclog.analysis.verdict.samples import Step, Unstepped
from jbclog.core.rows import EventRow, Severity, StationFacts
from jbclog.record.annotations import read as read_annotations
from jbclog.record.conclude import known_stations
from jbclog.record.parts import groups_of, part_paths
from jbclog.record.sealed_files import expect_unchanged
from jbclog.record.store_reader import StoreReader

if TYPE_CHECKING:
    from jbclog.analysis.run import Run

# -- alarm rows ---------------------------------------------------------------------------------------------------------------
# From a run's tables to what the episodes are computed from: one pass over the samples, and the alarm events of each port.

Place = tuple[str, int]
"""Station and port."""

COLUMNS: Final = ["time", "tick", "station", "port", "temperature_c", "status", "set_c", "alarm_high", "alarm_low"]
CLOCK_STEP: Final = "clock.step"


def stations_of(run: Run) -> list[StationFacts]:
    """What is known of the stations; of a run that is not sealed, what its live store has."""
    manifest = run.manifest
    if manifest.state == "sealed":
        return manifest.stations
    with StoreReader(run.folder) as stock:
        manifest = run.manifest  # after the store: a run that is sealed meanwhile has them there
        return manifest.stations if manifest.state == "sealed" else known_stations(stock, manifest.stations)


def pieces(run: Run) -> Iterator[pa.Table]:
    """The samples piece by piece, in order; of a sealed run only one is in memory at a time."""
    manifest = run.manifest
    if manifest.state != "sealed":
        yield from run.pieces("samples", COLUMNS)
        return
    parts = part_paths(run.folder, "samples")
    expect_unchanged(run.folder, manifest, "samples", parts)
    yield from groups_of(parts, COLUMNS)


@dataclass(slots=True)
class Told:
    """What the events and settings of a run say: of each port its alarm events and what changed; the steps of the clock.

    `changes` have their times less the steps before them.
    """

    events: dict[Place, list[EventRow]] = field(default_factory=dict)
    changes: dict[Place, list[Change]] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)


def told_by(run: Run) -> Told:
    """Read events and settings once."""
    told, stepped_us = Told(), 0
    events = [*_events(run.events())]
    for event in events:
        if event.kind == CLOCK_STEP and event.value:
            stepped_us += round(event.value * 1e6)
            told.steps.append(Step(event.time / 1e6, event.value))
        elif event.station is not None and event.port is not None:
            place = event.station, event.port
            told.events.setdefault(place, []).append(event)
            change = change_of(event.kind, event.time - stepped_us, event.raw)
            if change is not None:
                told.changes.setdefault(place, []).append(change)
    for place, changes in _settings(run.settings()).items():
        told.changes[place] = [*changes, *told.changes.get(place, ())]
    return told


def _events(frame: pd.DataFrame) -> Iterator[EventRow]:
    """Those that alarms are about, in their order."""
    kinds = frame["kind"]
    wanted = frame[kinds.str.startswith("alarm.") | kinds.isin(["setting.changed", "tool.changed", CLOCK_STEP])]
    times, earliest = micros(wanted["time"]), micros(wanted["earliest"])
    columns = (wanted[name] for name in ("kind", "severity", "text", "station", "port", "value", "limit", "raw"))
    for time, early, kind, severity, text, station, port, value, limit, raw in zip(times, earliest, *columns, strict=True):
        yield EventRow(
            cast(int, time),
            kind,
            Severity(severity),
            text,
            _or_none(station),
            None if pd.isna(port) else int(port),
            early,
            value=None if pd.isna(value) else float(value),
            limit=None if pd.isna(limit) else float(limit),
            raw=_or_none(raw),
        )


def _or_none(text: object) -> str | None:
    return text if isinstance(text, str) else None


def _settings(frame: pd.DataFrame) -> dict[Place, list[Change]]:
    """What each port held when its sampling began: these settings are told before its first row, and then only as events."""
    found: dict[Place, list[Change]] = {}
    wanted = frame[frame["setting"].isin([*WATCHED]) & frame["port"].notna() & frame["readback"].notna()]
    for station, port, name, text in zip(*(wanted[name] for name in ("station", "port", "setting", "readback")), strict=True):
        found.setdefault((str(station), int(port)), []).append(Change(BEFORE_ALL, str(name), str(text)))
    return found


def micros(times: pd.Series) -> list[int | None]:
    """UTC microseconds; None where there is no time."""
    numbers = times.astype("datetime64[us, UTC]").astype("int64").tolist()
    return [None if gone else number for number, gone in zip(numbers, times.isna(), strict=True)]


class Piece(NamedTuple):
    """The rows of one port in one piece of the samples."""

    place: Place
    rows: Rows
    flags: list[FlagRead]


class Ports:
    """Takes the samples apart by station and port, in their order. `flags_of`: the ports whose flags are wanted, too.

    `t0_utc` is the run's zero by the wall clock as it was then, `periods` the grids of the stations: a first row that lies off
    its grid by the size of a step came behind it.
    """

    def __init__(
        self, steps: Sequence[Step], flags_of: frozenset[Place], t0_utc: float | None, periods: Mapping[str, float | None]
    ) -> None:
        self._steps = steps
        self._t0_utc = t0_utc
        self._periods = periods
        self._flags_of = flags_of
        self._unstepped: dict[Place, Unstepped] = {}
        self._stepped_us: dict[Place, int] = {}
        self._before_us: dict[Place, int] = {}

    def of(self, piece: pa.Table) -> Iterator[Piece]:
        """The ports that have rows in this piece."""
        names = piece["station"].cast(pa.string()).combine_chunks().dictionary_encode()
        ports = piece["port"].to_numpy().astype(np.int64)
        keys = np.asarray(names.indices.to_numpy(zero_copy_only=False)).astype(np.int64) * 16 + ports
        for key in np.unique(keys):
            mine = piece.take(pa.array(np.flatnonzero(keys == key)))
            place = names.dictionary[int(key) // 16].as_py(), int(key) % 16
            yield Piece(place, self._rows(place, mine), self._flags(mine) if place in self._flags_of else [])

    def _rows(self, place: Place, mine: pa.Table) -> Rows:
        times = mine["time"].cast(pa.int64()).to_numpy()
        columns = (values(mine[name]) for name in ("temperature_c", "status", "set_c"))
        temperature, status, setting = columns
        steps = self._steps_in(place, times, mine["tick"][0].as_py()) if self._steps else {}
        return Rows(times.tolist(), mine["tick"].to_numpy().tolist(), temperature, status, setting, steps)  # type: ignore[arg-type]

    def _steps_in(self, place: Place, times: NDArray[np.int64], tick: int) -> dict[int, int]:
        """By how much the clock was stepped just before which of these rows."""
        seconds = times.astype(np.float64) / 1e6
        if place not in self._unstepped:
            number = self._steps_before(place[0], float(seconds[0]), tick)
            self._unstepped[place] = Unstepped(self._steps[number:])
            self._before_us[place] = round(sum(step.size_s for step in self._steps[:number]) * 1e6)
        stepped = np.rint((seconds - self._unstepped[place].of(seconds)) * 1e6).astype(np.int64) + self._before_us[place]
        sizes = np.diff(stepped, prepend=self._stepped_us.get(place, 0))
        self._stepped_us[place] = int(stepped[-1])
        return {int(row): int(sizes[row]) for row in np.flatnonzero(np.abs(sizes) > 1000)}

    def _steps_before(self, station: str, first_s: float, tick: int) -> int:
        """How many steps came before the first row of a port: as many as bring it nearest to its grid."""
        period_s = self._periods.get(station)
        if period_s is None or self._t0_utc is None:
            return 0
        sums = np.concatenate([[0.0], np.cumsum([step.size_s for step in self._steps])])
        return int(np.argmin(np.abs(first_s - (self._t0_utc + tick * period_s) - sums)))

    @staticmethod
    def _flags(mine: pa.Table) -> list[FlagRead]:
        read = mine.select(["time", "alarm_high", "alarm_low"]).filter(mine["alarm_high"].is_valid())
        times = read["time"].cast(pa.int64()).to_pylist()
        return [*map(FlagRead, times, read["alarm_high"].to_pylist(), read["alarm_low"].to_pylist())]


def values(column: pa.ChunkedArray) -> list[object]:
    """The column as a list with None for what was not read; quick where it is long."""
    array = column.combine_chunks() if isinstance(column, pa.ChunkedArray) else column
    if isinstance(array, pa.ChunkedArray):
        array = pa.concat_arrays(array.chunks)
    if pa.types.is_string(array.type) or pa.types.is_large_string(array.type):
        array = array.dictionary_encode()
    if pa.types.is_dictionary(array.type):
        words = array.dictionary.to_pylist()
        return [None if code is None else words[code] for code in values(array.indices)]
    if not array.null_count:
        return cast(list[object], array.to_numpy(zero_copy_only=False).tolist())
    found: list[object] = [None] * len(array)
    there = np.flatnonzero(array.is_valid().to_numpy(zero_copy_only=False))
    for place, value in zip(there.tolist(), array.drop_null().to_numpy(zero_copy_only=False).tolist(), strict=True):
        found[place] = value
    return found


# -- run alarms ---------------------------------------------------------------------------------------------------------------

ACKNOWLEDGED: Final = "alarm.acknowledged"
"""The kind of the annotation; its `what` is the episode's name."""

TABLE: Final = {
    "episode": "str",
    "incident": "int64",
    "station": "str",
    "port": "int64",
    "side": "str",
    "detector": "str",
    "state": "str",
    "onset_earliest": "time",
    "onset": "time",
    "raised": "time",
    "end_earliest": "time",
    "end": "time",
    "end_reason": "str",
    "seconds": "Float64",
    "peak_c": "Float64",
    "limit_c": "Float64",
    "delay_s": "Float64",
    "confirmed": "boolean",
    "uncertain": "boolean",
    "finding": "str",
    "acknowledged_by": "str",
    "acknowledged_at": "time",
    "acknowledged_why": "str",
}
"""The columns of `Run.alarms()` and their kinds. Stable; what they mean is in `Run.alarms`."""


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Who acknowledged it, when (ISO 8601, UTC) and why."""

    who: str
    time: str
    why: str


@dataclass(frozen=True, slots=True)
class Alarms:
    """All that is to be said of a run's alarms.

    `figures`: of each station by each detector. `live`: where what the recorder told while it ran is not what its record
    gives, a sentence each. `acknowledged`: by the name of an episode; it holds for the whole incident.
    """

    incidents: list[Incident]
    figures: list[Figures]
    live: list[str]
    acknowledged: Mapping[str, Acknowledgement]

    def acknowledgement(self, incident: Incident) -> Acknowledgement | None:
        """Who acknowledged any of its episodes, first."""
        given = (self.acknowledged.get(episode.id) for episode in incident.episodes)
        return min((one for one in given if one is not None), key=lambda one: one.time, default=None)

    def is_waiting(self, incident: Incident) -> bool:
        """Whether it is an alarm, by the station or by our samples, and nobody has acknowledged it."""
        is_alarm = any(one.detector is not Detector.AFTERWARDS for one in incident.episodes)
        return is_alarm and self.acknowledgement(incident) is None

    def incident_of(self, episode_id: str) -> Incident | None:
        """The incident that an episode belongs to."""
        return next((one for one in self.incidents for each in one.episodes if each.id == episode_id), None)

    def findings(self) -> list[str]:
        """On what the detectors do not agree, and what was acknowledged that the record does not have: a sentence each."""
        places = (f"{one.station} port {one.port}: {one.finding}." for one in self.incidents if one.finding)
        return [*places, *self.live, *self.astray()]

    def astray(self) -> list[str]:
        """What was acknowledged and is no episode of this record, a sentence each."""
        known = {episode.id for incident in self.incidents for episode in incident.episodes}
        return [
            f"{name}: acknowledged by {given.who}; the record gives no such episode."
            for name, given in self.acknowledged.items()
            if name not in known
        ]

    def rows(self) -> list[dict[str, object]]:
        """A row per episode as plain values, in the order of their incidents: for reports and ``--json``."""
        return [self._row(incident, episode) for incident in self.incidents for episode in incident.episodes]

    def figure_rows(self) -> list[dict[str, object]]:
        """The figures as plain values; times in ISO 8601."""
        return [_plain(one) for one in self.figures]

    def frame(self) -> pd.DataFrame:
        """The rows as a DataFrame with the columns of `TABLE`."""
        rows = self.rows()
        return pd.DataFrame({name: _column(kind, [row[name] for row in rows]) for name, kind in TABLE.items()})

    def _row(self, incident: Incident, episode: Episode) -> dict[str, object]:
        given = self.acknowledgement(incident)
        return {
            "episode": episode.id,
            "incident": incident.number,
            "station": episode.station,
            "port": episode.port,
            "side": str(episode.side),
            "detector": str(episode.detector),
            "state": str(episode.state),
            "onset_earliest": iso(episode.onset_earliest_us),
            "onset": iso(episode.onset_us),
            "raised": iso(episode.raised_us),
            "end_earliest": iso(episode.end_earliest_us),
            "end": iso(episode.end_us),
            "end_reason": episode.end_reason,
            "seconds": episode.seconds,
            "peak_c": episode.peak_c,
            "limit_c": episode.limit_c,
            "delay_s": episode.on_delay_s,
            "confirmed": episode.is_confirmed,
            "uncertain": episode.is_uncertain,
            "finding": incident.finding,
            "acknowledged_by": given and given.who,
            "acknowledged_at": given and given.time,
            "acknowledged_why": given and given.why,
        }


def alarms_of(run: Run) -> Alarms:
    """Compute the episodes of `run` from its record. Raises `RecordError`."""
    stations, told = stations_of(run), told_by(run)
    known = {facts.name: facts for facts in stations}
    sampled, reads, spans = _sampled(run, known, told)
    episodes = [episode for one in sampled.values() for episode in one.found]
    for place, events in told.events.items():
        episodes += flag_episodes(events, reads.get(place, ()))
    found, given = incidents(episodes, _lost_flags(told), _tell_flags(stations)), acknowledged_in(run)
    at = _acknowledged_us(found, given)
    spanned = [
        figures(name, detector, episodes, begin, end, at)
        for name in known
        for begin, end in [spans.get(name, (None, None))]
        for detector in Detector
    ]
    return Alarms(found, spanned, list(_live_differences(episodes, told, stations)), given)


def _acknowledged_us(found: Iterable[Incident], given: Mapping[str, Acknowledgement]) -> dict[str, int]:
    """When each episode was acknowledged, by its name: with any of its incident."""
    at: dict[str, int] = {}
    for incident in found:
        said = [given[one.id].time for one in incident.episodes if one.id in given]
        if said:
            at |= dict.fromkeys((one.id for one in incident.episodes), round(datetime.fromisoformat(min(said)).timestamp() * 1e6))
    return at


Span = tuple[int, int]
"""First and last row of a station, UTC microseconds."""


def _sampled(
    run: Run, known: Mapping[str, StationFacts], told: Told
) -> tuple[dict[Place, SampledEpisodes], dict[Place, list[FlagRead]], dict[str, Span]]:
    """One pass over the samples: the episodes by samples, the flags of ports where some were lost, the time recorded."""
    losing = frozenset(place for place, events in told.events.items() if any(event.kind == FLAGS_LOST for event in events))
    periods = {name: facts.period_s for name, facts in known.items()}
    ports, sampled = Ports(told.steps, losing, run.manifest.t0_utc, periods), dict[Place, SampledEpisodes]()
    reads, spans = dict[Place, list[FlagRead]](), dict[str, Span]()
    for piece in pieces(run):
        for place, rows, flags in ports.of(piece):
            if place not in sampled:
                facts = known.get(place[0])
                period_s = facts.period_s if facts else None
                sampled[place] = SampledEpisodes(*place, period_s, told.changes.get(place, ()), rules_of(facts))
            sampled[place].feed(rows)
            reads.setdefault(place, []).extend(flags)
            first, last = spans.get(place[0], (rows.time_us[0], rows.time_us[-1]))
            spans[place[0]] = min(first, rows.time_us[0]), max(last, rows.time_us[-1])
    return sampled, reads, spans


def _lost_flags(told: Told) -> dict[Place, list[Unknown]]:
    return {
        place: [Unknown(_earliest(event), event.time) for event in events if event.kind == FLAGS_LOST]
        for place, events in told.events.items()
    }


def _earliest(event: EventRow) -> int:
    return event.time if event.earliest is None else event.earliest


def _tell_flags(stations: Iterable[StationFacts]) -> list[str]:
    """The stations that tell alarm flags; where the record does not say what they tell, they do."""
    return [
        one.name for one in stations if (not one.signals or "alarm_high" in one.signals) and "alarm_high" not in one.not_supported
    ]


def _live_differences(episodes: Iterable[Episode], told: Told, stations: Iterable[StationFacts]) -> Iterable[str]:
    """What the recorder told of B while it ran held against what the record gives. Older recorders told nothing."""
    evaluated = {facts.name for facts in stations if facts.alarm_rules}
    given = [one for one in episodes if one.detector is Detector.SAMPLES and one.station in evaluated]
    events = [event for (station, _), these in told.events.items() if station in evaluated for event in these]
    for kind, names in (("raised", {one.id for one in given}), ("cleared", {one.id for one in given if one.end_us is not None})):
        live = {str(event.raw) for event in events if event.kind == f"{KIND}.{kind}"}
        for name in sorted(names - live):
            yield f"{name}: by the record it was {kind}; the recorder did not tell so while it ran."
        for name in sorted(live - names):
            yield f"{name}: the recorder told that it was {kind}; the record does not give it."


def acknowledged_in(run: Run) -> dict[str, Acknowledgement]:
    """What was acknowledged since the run was sealed, by the name of the episode; the first word counts."""
    if run.manifest.state != "sealed":
        return {}
    given: dict[str, Acknowledgement] = {}
    for said in read_annotations(run.folder).said:
        if said.kind == ACKNOWLEDGED:
            given.setdefault(said.what, Acknowledgement(said.who, said.time, said.why))
    return given


# -- plain values -----------------------------------------------------------------------------------------------------------


def iso(micros: int | None) -> str | None:
    """UTC as ISO 8601 with microseconds."""
    return None if micros is None else pd.Timestamp(micros, unit="us", tz="UTC").strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _plain(one: Figures) -> dict[str, object]:
    floods = [{"begin": iso(begin), "end": iso(end)} for begin, end in one.floods]
    return {**asdict(one), "detector": str(one.detector), "floods": floods, "top": [asdict(source) for source in one.top]}


def _column(kind: str, cells: list[object]) -> pd.Series:
    if kind == "time":
        return pd.to_datetime(pd.Series(cells, dtype="object"), utc=True, format="ISO8601").astype("datetime64[us, UTC]")
    return pd.Series(cells, dtype=kind)
