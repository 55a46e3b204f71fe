"""Alarm episodes of a run, computed from its tables.

The table has a row for each episode of each detector (`TABLE`); `Alarms.incidents` groups them.
Also works for a run that is still open or was cut off, as far as its record reaches.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Final

import pandas as pd
import pyarrow as pa

from jbclog.analysis.alarm_rows import (
    COLUMNS,
    FLAGS,
    PortSplitter,
    RunEvents,
    read_events,
)
from jbclog.analysis.alarms.from_record import UNKNOWN as FLAGS_LOST
from jbclog.analysis.alarms.from_record import FlagRead, SampledEpisodes, earliest_us, flag_episodes
from jbclog.analysis.alarms.kpi import Figures, figures
from jbclog.analysis.alarms.live import KIND, rules_of
from jbclog.analysis.alarms.match import Incident, Unknown, incidents
from jbclog.analysis.alarms.state_machine import Detector, Episode
from jbclog.analysis.port_split import gathered
from jbclog.analysis.run_tables import RunTables
from jbclog.core.clock import utc_micros
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.annotations import read as read_annotations
from jbclog.record.clock_steps import HostClock
from jbclog.record.manifest import iso as manifest_iso
from jbclog.record.schema import FLAG, FLOAT, INT, TEXT, TIME

ACKNOWLEDGED: Final = "alarm.acknowledged"
"""Kind of the annotation that acknowledges an episode; its `what` is the episode's name."""

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
    "seconds_least": "Float64",
    "seconds_most": "Float64",
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
"""Columns of `Run.alarms()`, which describes them, and their types."""

ARROW_TYPES: Final = {"str": TEXT, "int64": INT, "time": TIME, "Float64": FLOAT, "boolean": FLAG}
"""Type of a column in `TABLE` -> Arrow type."""
_UNITS: Final = {
    "seconds": "s",
    "seconds_least": "s",
    "seconds_most": "s",
    "peak_c": "°C",
    "limit_c": "°C",
    "delay_s": "s",
}
ALARMS_SCHEMA: Final = pa.schema(
    [
        pa.field(
            name, ARROW_TYPES[kind], metadata={"unit": _UNITS[name]} if name in _UNITS else None
        )
        for name, kind in TABLE.items()
    ]
)
"""The columns of `TABLE` as Arrow fields, with units."""


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Who acknowledged an episode, when (ISO 8601, UTC) and why."""

    who: str
    time: str
    why: str


@dataclass(frozen=True, slots=True)
class Alarms:
    """The alarms of a run.

    `figures`: KPIs of each station by each detector. `live`: a sentence for each difference between
    the recorder's events and the record. `acknowledged`: name of an episode -> acknowledgement of
    its whole incident.
    """

    incidents: list[Incident]
    figures: list[Figures]
    live: list[str]
    acknowledged: Mapping[str, Acknowledgement]

    def acknowledgement(self, incident: Incident) -> Acknowledgement | None:
        """Return the first acknowledgement of any episode of an incident, or None."""
        given = (self.acknowledged.get(episode.id) for episode in incident.episodes)
        return min(
            (one for one in given if one is not None), key=lambda one: one.time, default=None
        )

    def is_waiting(self, incident: Incident) -> bool:
        """Whether an incident is an alarm, by the station or by our samples, and not
        acknowledged.
        """
        is_alarm = any(one.detector is not Detector.AFTERWARDS for one in incident.episodes)
        return is_alarm and self.acknowledgement(incident) is None

    def incident_of(self, episode_id: str) -> Incident | None:
        """Return the incident of an episode; None for an unknown name."""
        return next(
            (one for one in self.incidents for each in one.episodes if each.id == episode_id), None
        )

    def findings(self) -> list[str]:
        """Return a sentence for each disagreement of the detectors, and for each acknowledgement of
        an unknown episode.
        """
        disagreements = (
            f"{one.station} port {one.port}: {one.finding}."
            for one in self.incidents
            if one.finding
        )
        return [*disagreements, *self.live, *self.without_episode()]

    def without_episode(self) -> list[str]:
        """Return a sentence for each acknowledgement of an episode that the record does not
        have.
        """
        known = {episode.id for incident in self.incidents for episode in incident.episodes}
        return [
            f"{name}: acknowledged by {given.who}, but the record gives no such episode."
            for name, given in self.acknowledged.items()
            if name not in known
        ]

    def rows(self) -> list[dict[str, object]]:
        """Return the episodes as values for JSON, ordered by incident; times in ISO 8601."""
        return [
            self._row(incident, episode)
            for incident in self.incidents
            for episode in incident.episodes
        ]

    def figure_rows(self) -> list[dict[str, object]]:
        """Return the figures as values for JSON; times in ISO 8601."""
        return [_figure_row(one) for one in self.figures]

    def frame(self) -> pd.DataFrame:
        """Return the rows as a DataFrame with the columns of `TABLE`."""
        rows = self.rows()
        return pd.DataFrame(
            {name: _column(kind, [row[name] for row in rows]) for name, kind in TABLE.items()}
        )

    def table(self) -> pa.Table:
        """Return the rows as an Arrow table with `ALARMS_SCHEMA`."""
        times = [name for name, kind in TABLE.items() if kind == "time"]
        rows = [row | {name: _moment(row[name]) for name in times} for row in self.rows()]
        return pa.Table.from_pylist(rows, schema=ALARMS_SCHEMA)

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
            "seconds_least": episode.seconds_least,
            "seconds_most": episode.seconds_most,
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


def alarms_of(run: RunTables) -> Alarms:
    """Return the alarms of a run, computed from its record. Raises `RecordError`."""
    stations, events = run.stations, read_events(run)
    known = {facts.name: facts for facts in stations}
    sampled, reads, spans = _sampled(run, known, events)
    episodes = [episode for one in sampled.values() for episode in one.found]
    for place, alarms in events.alarms.items():
        episodes += flag_episodes(alarms, reads.get(place, ()))
    found = incidents(episodes, _lost_flags(events), _with_flags(stations))
    given = acknowledged_in(run)
    at = _acknowledged_us(found, given)
    kpis: list[Figures] = []
    for name in known:
        begin_us, end_us = spans.get(name, (None, None))
        kpis += [figures(name, detector, episodes, begin_us, end_us, at) for detector in Detector]
    return Alarms(found, kpis, list(_live_differences(episodes, events, stations)), given)


def _acknowledged_us(
    found: Iterable[Incident], given: Mapping[str, Acknowledgement]
) -> dict[str, int]:
    """Return episode name -> first acknowledgement of its incident, UTC microseconds."""
    at: dict[str, int] = {}
    for incident in found:
        times = [given[one.id].time for one in incident.episodes if one.id in given]
        if times:
            first_us = round(datetime.fromisoformat(min(times)).timestamp() * 1e6)
            at |= dict.fromkeys((one.id for one in incident.episodes), first_us)
    return at


Span = tuple[int, int]
"""Times of a station's first and last row, UTC microseconds."""


def _sampled(
    run: RunTables, known: Mapping[str, StationFacts], events: RunEvents
) -> tuple[dict[PortKey, SampledEpisodes], dict[PortKey, list[FlagRead]], dict[str, Span]]:
    """Return, from one pass over the samples, the episodes by samples, the flags of ports that lost
    some, and the time recorded.
    """
    losing = frozenset(
        place
        for place, alarms in events.alarms.items()
        if any(event.kind == FLAGS_LOST for event in alarms)
    )
    periods = {name: facts.period_s for name, facts in known.items()}
    splitter = PortSplitter(events.steps, losing, run.manifest.t0_utc, periods)
    sampled = dict[PortKey, SampledEpisodes]()
    reads, spans = dict[PortKey, list[FlagRead]](), dict[str, Span]()
    ports = sum(len(facts.ports) for facts in known.values())
    columns = [*COLUMNS, *(FLAGS if losing else ())]
    for piece in gathered(run.groups("samples", columns, coded=True), ports):
        for place, rows, flags in splitter.split(piece):
            if place not in sampled:
                facts = known.get(place[0])
                period_s = facts.period_s if facts else None
                sampled[place] = SampledEpisodes(
                    *place, period_s, events.changes.get(place, ()), rules_of(facts)
                )
            sampled[place].feed(rows)
            reads.setdefault(place, []).extend(flags)
            begin, end = int(rows.time_us[0]), int(rows.time_us[-1])
            first, last = spans.get(place[0], (begin, end))
            spans[place[0]] = min(first, begin), max(last, end)
    return sampled, reads, spans


def _lost_flags(events: RunEvents) -> dict[PortKey, list[Unknown]]:
    return {
        place: [
            Unknown(earliest_us(event), event.time) for event in alarms if event.kind == FLAGS_LOST
        ]
        for place, alarms in events.alarms.items()
    }


def _with_flags(stations: Iterable[StationFacts]) -> list[str]:
    """Return the stations that report alarm flags, and those whose signals are not listed."""
    return [
        one.name
        for one in stations
        if (not one.signals or "alarm_high" in one.signals)
        and "alarm_high" not in one.not_supported
    ]


def _live_differences(
    episodes: Iterable[Episode], found: RunEvents, stations: Iterable[StationFacts]
) -> Iterable[str]:
    """Yield a sentence for each difference between detector B's events and episodes.

    Runs of early versions have no such events.
    """
    evaluated = {facts.name for facts in stations if facts.alarm_rules}
    given = [
        one for one in episodes if one.detector is Detector.SAMPLES and one.station in evaluated
    ]
    events = [
        event
        for (station, _), alarms in found.alarms.items()
        if station in evaluated
        for event in alarms
    ]
    for kind, names in (
        ("raised", {one.id for one in given}),
        ("cleared", {one.id for one in given if one.end_us is not None}),
    ):
        live = {str(event.raw) for event in events if event.kind == f"{KIND}.{kind}"}
        for name in sorted(names - live):
            yield f"{name}: {kind} by the record, but the recorder logged no such event."
        for name in sorted(live - names):
            yield f"{name}: the recorder logged it as {kind}, but the record does not give it."


def acknowledged_in(run: RunTables) -> dict[str, Acknowledgement]:
    """Return the first acknowledgement of each episode, by name, with its time by the run's clock;
    empty for an open run.
    """
    if not run.manifest.is_sealed:
        return {}
    given: dict[str, Acknowledgement] = {}
    host = HostClock(run.manifest.clock_steps or ())
    for one in read_annotations(run.folder).said:
        if one.kind == ACKNOWLEDGED:
            time = manifest_iso(host.run_time(utc_micros(one.time)))
            given.setdefault(one.what, Acknowledgement(one.who, time, one.why))
    return given


def iso(micros: int | None) -> str | None:
    """Return a UTC time as ISO 8601 with microseconds."""
    return None if micros is None else manifest_iso(int(micros))


def _moment(text: object) -> datetime | None:
    return datetime.fromisoformat(text) if isinstance(text, str) else None


def _figure_row(one: Figures) -> dict[str, object]:
    floods = [{"begin": iso(begin), "end": iso(end)} for begin, end in one.floods]
    return {
        **asdict(one),
        "detector": str(one.detector),
        "floods": floods,
        "top": [asdict(source) for source in one.top],
    }


def _column(kind: str, cells: list[object]) -> pd.Series:
    if kind == "time":
        return pd.to_datetime(pd.Series(cells, dtype="object"), utc=True, format="ISO8601").astype(
            "datetime64[us, UTC]"
        )
    return pd.Series(cells, dtype=kind)
