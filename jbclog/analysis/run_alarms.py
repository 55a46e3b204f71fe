"""Alarm episodes of a run, computed from its tables.

A table has a row for each episode of each detector (`TABLE`); `Alarms.incidents` puts them side by side. Works also for a run
that is still open or was cut off, as far as its record goes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Final

import pandas as pd

from jbclog.analysis.alarm_rows import Place, Ports, Told, pieces, told_by
from jbclog.analysis.alarms import (
    KIND,
    Detector,
    Episode,
    Figures,
    FlagRead,
    Incident,
    SampledEpisodes,
    Unknown,
    figures,
    flag_episodes,
    incidents,
    rules_of,
)
from jbclog.analysis.alarms.from_record import UNKNOWN as FLAGS_LOST
from jbclog.analysis.run_tables import RunTables, stations_of
from jbclog.core.rows import EventRow, StationFacts
from jbclog.record.annotations import read as read_annotations

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


def alarms_of(run: RunTables) -> Alarms:
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
    run: RunTables, known: Mapping[str, StationFacts], told: Told
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


def acknowledged_in(run: RunTables) -> dict[str, Acknowledgement]:
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
