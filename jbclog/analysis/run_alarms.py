"""Alarm episodes of a run, computed from its tables.

The table has a row for each episode of each detector (`ALARMS_SCHEMA`); `Alarms.incidents` groups
them. Also works for a run that is still open or was cut off, as far as its record reaches.
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
    PortRows,
    RunEvents,
    flags_in,
    read_events,
)
from jbclog.analysis.alarms.from_record import UNKNOWN as FLAGS_LOST
from jbclog.analysis.alarms.from_record import FlagRead, SampledEpisodes, earliest_us, flag_episodes
from jbclog.analysis.alarms.kpi import Figures, figures
from jbclog.analysis.alarms.live import KIND, rules_of
from jbclog.analysis.alarms.match import Incident, Unknown, incidents
from jbclog.analysis.alarms.state_machine import Detector, Episode
from jbclog.analysis.derived_schemas import ALARMS_SCHEMA
from jbclog.analysis.run_tables import RunTables, frame
from jbclog.core.clock import utc_micros
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.annotations import read as read_annotations
from jbclog.record.clock_steps import HostClock
from jbclog.record.manifest import iso as manifest_iso
from jbclog.record.schema import TIME

ACKNOWLEDGED: Final = "alarm.acknowledged"
"""Kind of the annotation that acknowledges an episode; its `what` is the episode's name."""


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Who acknowledged an episode, when (ISO 8601, UTC) and why."""

    who: str
    time: str
    why: str


@dataclass(frozen=True, slots=True)
class Alarms:
    """The alarms of the run with the name `run`.

    `figures`: KPIs of each station by each detector. `live`: a sentence for each difference between
    the recorder's events and the record. `acknowledged`: name of an episode -> acknowledgement of
    its whole incident.
    """

    run: str
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
        return incident.is_alarm and self.acknowledgement(incident) is None

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
        """Return the rows as a DataFrame with the columns of `ALARMS_SCHEMA`."""
        return frame(self.table())

    def table(self) -> pa.Table:
        """Return the rows as an Arrow table with `ALARMS_SCHEMA`."""
        times = [field.name for field in ALARMS_SCHEMA if field.type == TIME]
        rows = [
            {"run": self.run} | row | {name: _moment(row[name]) for name in times}
            for row in self.rows()
        ]
        return pa.Table.from_pylist(rows, schema=ALARMS_SCHEMA)

    def _row(self, incident: Incident, episode: Episode) -> dict[str, object]:
        given = self.acknowledgement(incident)
        return {
            "station": episode.station,
            "port": episode.port,
            "episode": episode.id,
            "incident": incident.number,
            "main": incident.is_alarm and episode is incident.main,
            "witnesses": incident.witnesses,
            "side": str(episode.side),
            "detector": str(episode.detector),
            "state": str(episode.state),
            "start_earliest": iso(episode.onset_earliest_us),
            "start": iso(episode.onset_us),
            "raised": iso(episode.raised_us),
            "stop_earliest": iso(episode.end_earliest_us),
            "stop": iso(episode.end_us),
            "stop_reason": episode.end_reason,
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
    return Alarms(
        run.manifest.run, found, kpis, list(_live_differences(episodes, events, stations)), given
    )


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
    """Return the episodes by samples, the flags of ports that lost some, and the time recorded."""
    losing = {
        key
        for key, alarms in events.alarms.items()
        if any(event.kind == FLAGS_LOST for event in alarms)
    }
    sampled: dict[PortKey, SampledEpisodes] = {}
    reads: dict[PortKey, list[FlagRead]] = {}
    spans: dict[str, Span] = {}
    samples = run.samples_by_port([*COLUMNS, *(FLAGS if losing else ())])
    t0_utc = run.manifest.t0_utc
    for key in samples.ports:
        facts = known.get(key[0])
        period_s = facts.period_s if facts else None
        episodes = SampledEpisodes(*key, period_s, events.changes.get(key, ()), rules_of(facts))
        port = PortRows(events.steps, t0_utc, period_s)
        for piece in samples.rows(key):
            rows = port.of(piece)
            episodes.feed(rows)
            if key in losing:
                reads.setdefault(key, []).extend(flags_in(piece))
            begin_us, end_us = int(rows.time_us[0]), int(rows.time_us[-1])
            first_us, last_us = spans.get(key[0], (begin_us, end_us))
            spans[key[0]] = min(first_us, begin_us), max(last_us, end_us)
            sampled[key] = episodes
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
    floods = [{"start": iso(start), "stop": iso(stop)} for start, stop in one.floods]
    return {
        **asdict(one),
        "detector": str(one.detector),
        "floods": floods,
        "top": [asdict(source) for source in one.top],
    }
