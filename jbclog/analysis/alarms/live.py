"""Detect alarms while a run is recorded, and add their start and end to the record.

It only follows what the record gets, so a replay of the record comes to the same. A row within all limits costs one
look-up and two comparisons.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Final

from jbclog.analysis.alarms.port_watch import BEFORE_ALL, TOOL, Change, PortWatch
from jbclog.analysis.alarms.state_machine import WATCHED, Detector, Episode, News, Rules, Side, Told
from jbclog.core.rows import COLUMN, EventRow, SampleRow, SettingRow, Severity, StationFacts

_TIME, _TICK, _STATION, _PORT = (COLUMN[name] for name in ("time", "tick", "station", "port"))
_TEMPERATURE, _STATUS, _SET = (COLUMN[name] for name in ("temperature_c", "status", "set_c"))

KIND: Final = "alarm.episode"
_SEVERITY: Final = {News.RAISED: Severity.WARNING, News.CLEARED: Severity.INFO, News.UNCERTAIN: Severity.WARNING}

RULES: Final = tuple(field.name for field in fields(Rules))

Place = tuple[str, int]
"""Station and port."""


class LiveAlarms:
    """Detector B for all ports of a run. `tell` is given its events."""

    def __init__(self, tell: Callable[[EventRow], None]) -> None:
        self._tell = tell
        self._facts: dict[str, StationFacts] = {}
        self._watches: dict[Place, PortWatch] = {}
        self._waiting: dict[Place, list[Change]] = {}  # of ports that have no row yet
        self._stepped_us = 0

    def facts(self, facts: StationFacts) -> None:
        """A station is known: its grid and its rules are."""
        self._facts[facts.name] = facts

    def setting(self, row: SettingRow) -> None:
        """A setting was read, or written and read back: before sampling; later changes are events."""
        if row.setting in WATCHED and row.port is not None and row.readback is not None:
            self._change((row.station, row.port), Change(BEFORE_ALL, row.setting, row.readback))

    def event(self, event: EventRow) -> None:
        """A setting was found changed, a tool was changed, the wall clock was stepped."""
        if event.kind == "clock.step" and event.value:
            self._step(round(event.value * 1e6))
        elif event.station is not None and event.port is not None:
            change = change_of(event.kind, event.time - self._stepped_us, event.raw)
            if change is not None:
                self._change((event.station, event.port), change)

    def sample(self, row: SampleRow) -> None:
        """The next row of any port."""
        watch = self._watches.get((row[_STATION], row[_PORT]))  # type: ignore[arg-type]  # a row is a list of anything
        if watch is None:
            watch = self._begin(str(row[_STATION]), int(str(row[_PORT])))
        news = watch.row(row[_TIME], row[_TICK], row[_TEMPERATURE], row[_STATUS], row[_SET])  # type: ignore[arg-type]
        if news:
            self._tell_all(news, row[_TIME])  # type: ignore[arg-type]

    def _begin(self, station: str, port: int) -> PortWatch:
        facts = self._facts.get(station)
        watch = PortWatch(station, port, facts.period_s if facts else None, rules_of(facts), [Detector.SAMPLES])
        watch.step(self._stepped_us)
        for change in self._waiting.pop((station, port), []):
            watch.change(change)
        self._watches[station, port] = watch
        return watch

    def _change(self, place: Place, change: Change) -> None:
        watch = self._watches.get(place)
        if watch is None:
            self._waiting.setdefault(place, []).append(change)
        else:
            watch.change(change)

    def _step(self, size_us: int) -> None:
        self._stepped_us += size_us
        for watch in self._watches.values():
            watch.step(size_us)

    def _tell_all(self, news: Sequence[Told], time_us: int) -> None:
        for what, episode in news:
            self._tell(told(what, episode, time_us))


def rules_of(facts: StationFacts | None) -> Rules:
    """The rules by which a station's samples are evaluated: those of its recipe, as its facts have them."""
    told = {} if facts is None else {name: facts.alarm_rules[name] for name in RULES if name in facts.alarm_rules}
    return Rules(**told)


def change_of(kind: str, at_us: int, raw: str | None) -> Change | None:
    """What an event of one port changes for its alarms, or None."""
    if kind == "tool.changed":
        return Change(at_us, TOOL)
    name, equals, text = (raw or "").partition("=")
    return Change(at_us, name, text) if kind == "setting.changed" and equals and name in WATCHED else None


def told(what: News, episode: Episode, time_us: int) -> EventRow:
    """The event that says what is new of an episode; its `raw` is the episode's name."""
    earliest = episode.end_earliest_us if what is News.CLEARED else episode.onset_earliest_us
    text = f"Port {episode.port}: {_sentence(what, episode)}."
    return EventRow(
        time_us,
        f"{KIND}.{what.value}",
        _SEVERITY[what],
        text,
        episode.station,
        episode.port,
        earliest,
        value=episode.peak_c,
        limit=episode.limit_c,
        raw=episode.id,
    )


def _sentence(what: News, episode: Episode) -> str:
    beyond = "above" if episode.side is Side.HIGH else "below"
    if what is News.RAISED:
        return f"{episode.peak_c:g} °C read, {beyond} {episode.limit_c:g} °C for {episode.on_delay_s:g} s"
    if what is News.CLEARED:
        extreme = "hottest" if episode.side is Side.HIGH else "coldest"
        return f"the {episode.side}-temperature episode is over ({episode.end_reason}); {extreme} {episode.peak_c:g} °C"
    return f"whether it is still {beyond} {episode.limit_c:g} °C is not known: nothing was read of it for too long"
