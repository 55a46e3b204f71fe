"""Alarm episodes as text: each incident with its episodes, then the KPIs of each station."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from jbclog.analysis.alarms.kpi import Figures
from jbclog.analysis.alarms.match import Incident
from jbclog.analysis.alarms.state_machine import Detector, Episode, State
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from jbclog.analysis.run_alarms import Alarms

DETECTOR_NAMES = {
    Detector.STATION: "flag",
    Detector.SAMPLES: "samples",
    Detector.AFTERWARDS: "excursion",
}


def lines(found: Alarms) -> list[str]:
    """Return all lines; none without alarms."""
    body = [line for incident in found.incidents for line in _incident(found, incident)]
    return [
        *body,
        *(
            _figures(one)
            for one in found.figures
            if one.count and one.detector is not Detector.AFTERWARDS
        ),
        *found.live,
        *found.without_episode(),
    ]


def _incident(found: Alarms, one: Incident) -> Iterator[str]:
    first, limit = (
        one.episodes[0],
        next((each.limit_c for each in one.episodes if each.limit_c is not None), None),
    )
    beyond = "" if limit is None else f", limit {limit:g} °C"
    day = datetime.fromtimestamp(one.begin_us / 1e6, UTC).date()
    where = f"{one.number}  {first.station} port {first.port}, {day} UTC"
    yield f"{where}: {first.side} temperature{beyond}; {_detectors(one)}; {_state(one)}"
    for episode in one.episodes:
        yield f"   {episode.id}  {DETECTOR_NAMES[episode.detector]}: {_span(episode)}"
    if one.finding:
        yield f"   Detectors disagree: {one.finding}."
    given = found.acknowledgement(one)
    if given is not None:
        yield f"   Acknowledged by {given.who} at {given.time[:19]}Z: {given.why}"
    elif found.is_waiting(one):
        yield "   Not acknowledged."


def _detectors(one: Incident) -> str:
    return " ".join(
        f"{detector}{_times(len(those))}" for detector, those in one.by.items() if those
    )


def _times(count: int) -> str:
    return f"×{count}" if count > 1 else ""


def _state(one: Incident) -> str:
    states = {episode.state for episode in one.episodes}
    return str(
        next(state for state in (State.ACTIVE, State.UNCERTAIN, State.CLEARED) if state in states)
    )


def _span(one: Episode) -> str:
    begins = f"began {_between(one.onset_earliest_us, one.onset_us)}"
    seconds = "" if one.seconds is None else f", {one.seconds:.1f} s"
    if one.seconds_least is not None:
        seconds = f", {one.seconds_least:.1f} to {one.seconds_most:.1f} s, partly unread"
    ends = (
        ""
        if one.end_us is None
        else f", ended {_between(one.end_earliest_us, one.end_us)}{seconds} ({one.end_reason})"
    )
    peak = (
        ""
        if one.peak_c is None
        else f", {'hottest' if one.side == 'high' else 'coldest'} {one.peak_c:g} °C"
    )
    unconfirmed = "" if one.is_confirmed else ", confirmed by no sample"
    return (
        f"{begins}{ends}{peak}{unconfirmed}{', reading gap too long' if one.is_uncertain else ''}"
    )


def _between(earliest_us: int | None, latest_us: int) -> str:
    latest = _clock(latest_us)
    return latest if earliest_us in (None, latest_us) else f"{_clock(earliest_us)} to {latest}"


def _clock(micros: int | None) -> str:
    seconds, micros = divmod(micros or 0, 1_000_000)
    minutes, second = divmod(seconds, 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours % 24:02d}:{minute:02d}:{second:02d}.{micros // 1000:03d}"


def _figures(one: Figures) -> str:
    parts = [f"{count_text(one.count, 'alarm')}, at most {one.most_in_10_min} in 10 minutes"]
    parts.append(count_text(len(one.floods), "flood") if one.floods else "no flood")
    parts += [f"{name} chattering ({count} in a minute)" for name, count in one.chattering.items()]
    parts += [
        f"{count} {word}"
        for count, word in ((one.fleeting, "fleeting"), (one.stale, "stale"))
        if count
    ]
    parts += (
        [f"one every {_long(one.apart.value)} on average"] if one.apart.value is not None else []
    )
    parts += (
        [_acknowledged(one)]
        if one.ack_p50.value is not None and one.ack_p95.value is not None
        else []
    )
    parts.append(
        "most from " + ", ".join(f"{source.name} ({source.percent:g} %)" for source in one.top[:3])
    )
    return f"{one.station}, {one.detector} ({DETECTOR_NAMES[one.detector]}): {'; '.join(parts)}"


def _acknowledged(one: Figures) -> str:
    half, most = _long(one.ack_p50.value or 0.0), _long(one.ack_p95.value or 0.0)
    return f"{one.ack_p50.n} acknowledged, 50 % within {half}, 95 % within {most}"


def _long(seconds: float) -> str:
    """Return ``12 s``, ``8.5 min``, ``31 h``, ``69 days``."""
    if seconds < 99.5:
        return f"{seconds:.3g} s"
    if seconds < 5940:
        return f"{seconds / 60:.2g} min"
    if seconds < 100 * 3600:
        return f"{seconds / 3600:.3g} h"
    return f"{seconds / 86400:.0f} days"
