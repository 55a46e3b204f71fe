"""Detects alarms (detector B) while a run is recorded, and adds their events to the record.

Uses recorded values only, so that the analysis of the record finds the same episodes. A row within
all limits costs one look-up and two comparisons.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Final

from jbclog.analysis.alarms.port_watch import BEFORE_ALL, TOOL, WORKING, Change, PortWatch
from jbclog.analysis.alarms.state_machine import (
    WATCHED,
    Detector,
    Episode,
    Report,
    Rules,
    Side,
    Transition,
)
from jbclog.core.rows import (
    COLUMN,
    EventRow,
    PortKey,
    SampleRow,
    SettingRow,
    Severity,
    StationFacts,
)

_TIME, _TICK, _STATION, _PORT = (COLUMN[name] for name in ("time", "tick", "station", "port"))
_TEMPERATURE, _STATUS, _SET = (COLUMN[name] for name in ("temperature_c", "status", "setpoint_c"))

KIND: Final = "alarm.episode"
_SEVERITY: Final = {
    Transition.RAISED: Severity.WARNING,
    Transition.CLEARED: Severity.INFO,
    Transition.UNCERTAIN: Severity.WARNING,
}

RULES: Final = tuple(field.name for field in fields(Rules))


class LiveAlarms:
    """Detector B for all ports of a run; calls `emit` with its events."""

    def __init__(self, emit: Callable[[EventRow], None]) -> None:
        self._emit = emit
        self._facts: dict[str, StationFacts] = {}
        self._watches: dict[PortKey, PortWatch] = {}
        self._waiting: dict[PortKey, list[Change]] = {}  # for ports without a row yet
        self._stepped_us = 0

    def facts(self, facts: StationFacts) -> None:
        """Add a station's period and rules."""
        self._facts[facts.name] = facts

    def setting(self, row: SettingRow) -> None:
        """Add a setting that was read before sampling began; later changes come as events."""
        if row.setting in WATCHED and row.port is not None and row.readback is not None:
            self._change((row.station, row.port), Change(BEFORE_ALL, row.setting, row.readback))

    def event(self, event: EventRow) -> None:
        """Add a change of a setting or tool; ignore other events.

        A step of the wall clock counts if the times of the record follow it.
        """
        if event.kind == "clock.step" and event.value and event.raw is None:
            self._step(round(event.value * 1e6))
        elif event.station is not None and event.port is not None:
            change = change_of(event.kind, event.time - self._stepped_us, event.raw)
            if change is not None:
                self._change((event.station, event.port), change)

    def sample(self, row: SampleRow) -> None:
        """Add the next row of any port."""
        watch = self._watches.get((row[_STATION], row[_PORT]))  # type: ignore[arg-type]  # a row is a list of anything
        if watch is None:
            watch = self._begin(str(row[_STATION]), int(str(row[_PORT])))
        status = row[_STATUS]
        temperature = None if status is None else row[_TEMPERATURE]
        reports = watch.row(row[_TIME], row[_TICK], temperature, status in WORKING, row[_SET])  # type: ignore[arg-type]
        if reports:
            self._emit_all(reports, row[_TIME])  # type: ignore[arg-type]

    def _begin(self, station: str, port: int) -> PortWatch:
        facts = self._facts.get(station)
        watch = PortWatch(
            station, port, facts.period_s if facts else None, rules_of(facts), [Detector.SAMPLES]
        )
        watch.step(self._stepped_us)
        for change in self._waiting.pop((station, port), []):
            watch.change(change)
        self._watches[station, port] = watch
        return watch

    def _change(self, place: PortKey, change: Change) -> None:
        watch = self._watches.get(place)
        if watch is None:
            self._waiting.setdefault(place, []).append(change)
        else:
            watch.change(change)

    def _step(self, size_us: int) -> None:
        self._stepped_us += size_us
        for watch in self._watches.values():
            watch.step(size_us)

    def _emit_all(self, reports: Sequence[Report], time_us: int) -> None:
        for transition, episode in reports:
            self._emit(event_of(transition, episode, time_us))


def rules_of(facts: StationFacts | None) -> Rules:
    """Return the rules of a station's recipe, as in its facts, completed by the defaults."""
    stated = (
        {}
        if facts is None
        else {name: facts.alarm_rules[name] for name in RULES if name in facts.alarm_rules}
    )
    return Rules(**stated)


def change_of(kind: str, at_us: int, raw: str | None) -> Change | None:
    """Return the change that an event of a port makes to its alarms, or None."""
    if kind == "tool.changed":
        return Change(at_us, TOOL)
    name, equals, text = (raw or "").partition("=")
    return (
        Change(at_us, name, text)
        if kind == "setting.changed" and equals and name in WATCHED
        else None
    )


def event_of(transition: Transition, episode: Episode, time_us: int) -> EventRow:
    """Return the event for a transition of an episode; its `raw` is the episode's name."""
    earliest = (
        episode.end_earliest_us if transition is Transition.CLEARED else episode.onset_earliest_us
    )
    return EventRow(
        time_us,
        f"{KIND}.{transition.value}",
        _SEVERITY[transition],
        f"Port {episode.port}: {_sentence(transition, episode)}.",
        episode.station,
        episode.port,
        earliest,
        value=episode.peak_c,
        limit_value=episode.limit_c,
        raw=episode.id,
    )


def _sentence(transition: Transition, episode: Episode) -> str:
    beyond = "above" if episode.side is Side.HIGH else "below"
    if transition is Transition.RAISED:
        return (
            f"{episode.peak_c:g} °C read, {beyond} {episode.limit_c:g} °C for"
            f" {episode.on_delay_s:g} s"
        )
    if transition is Transition.CLEARED:
        extreme = "hottest" if episode.side is Side.HIGH else "coldest"
        return (
            f"the {episode.side}-temperature episode is over ({episode.end_reason}); {extreme}"
            f" {episode.peak_c:g} °C"
        )
    return (
        f"the temperature was not read for too long; it may still be {beyond}"
        f" {episode.limit_c:g} °C"
    )
