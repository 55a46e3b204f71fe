"""Alarms, problems and the unit on the bench, from the events, settings and counters of a run."""

from __future__ import annotations

import collections
from typing import Final

import pyarrow as pa

from jbclog.core.rows import EventRow, severity_of
from jbclog.live.states import Counter, NumberedEvent, Setting
from jbclog.record.units import BEGIN, END

MOST_EVENTS: Final = 1000  # kept for display

Place = tuple[str | None, int | None]
"""Station and port. None means the whole run or all ports of the station."""

ALARMS_BEGIN: Final = ("alarm.high", "alarm.low")
ALARMS_END: Final = {"alarm.high.ended": "alarm.high", "alarm.low.ended": "alarm.low"}
EPISODE_BEGINS, EPISODE_ENDS = "alarm.episode.raised", "alarm.episode.cleared"
FLAGS_LOST: Final = "alarm.unknown"
LINK_LOST: Final = "link.lost"
CLOCK_STEP: Final = "clock.step"  # without `raw` (earlier versions) times follow it

PROBLEMS_BEGIN: Final = (
    *(LINK_LOST, "robot.off", "station.error", "port.error", "tool.unknown"),
    *("solder.shortage", "feeder.clogged", "control.preparing", "temperature.out_of_range"),
    *(
        "safety.not_safe",
        "safety.not_known",
        "alarm.episode.failed",
        "identity.changed",
        "setting.changed",
    ),
    *(
        "record.failed",
        "guard.none",
        "guard.weak",
        "guard.lost",
        "guard.failed",
        "guard.took_over",
        "wire.failed",
    ),
)
PROBLEMS_END: Final = {
    "link.back": LINK_LOST,
    "robot.on": "robot.off",
    "station.ok": "station.error",
    "port.ok": "port.error",
    "solder.shortage.ended": "solder.shortage",
    "feeder.clogged.ended": "feeder.clogged",
    "control.ready": "control.preparing",
    "temperature.in_range": "temperature.out_of_range",
    "safety.safe_state": "safety.not_safe",
}
"""Event kind of the end -> event kind of the begin. A problem without an end lasts until the run
ends.
"""


class EventHistory:
    """Collects events; they must be added in order."""

    def __init__(self) -> None:
        self.newest: collections.deque[NumberedEvent] = collections.deque(maxlen=MOST_EVENTS)
        self.unit: str | None = None
        self.has_units = False  # whether serials are read during the run
        self.host_offset_us = 0.0  # the recorder's wall clock less the run's time
        self._alarms: dict[Place, dict[str, str]] = {}
        self._counts: collections.Counter[Place] = collections.Counter()
        self._problems: dict[Place, dict[str, str]] = {}
        self._flags_lost: dict[Place, int] = {}

    def add(self, rows: pa.Table) -> None:
        times = [rows[name].cast(pa.int64()).to_pylist() for name in ("time", "earliest")]
        for row, time, earliest in zip(rows.to_pylist(), *times, strict=True):
            self._add(row["seq"], _event(row, time, earliest))

    def alarms(self, place: Place) -> tuple[str, ...]:
        """Return the texts of the alarms that are active at a place."""
        return tuple(self._alarms.get(place, {}).values())

    def alarms_so_far(self, place: Place) -> int:
        """Return how many alarms the station's flags have raised at a place so far."""
        return self._counts[place]

    def problems(self, place: Place) -> tuple[str, ...]:
        """Return the texts of the problems that persist at a place."""
        return tuple(self._problems.get(place, {}).values())

    def is_link_lost(self, station: str) -> bool:
        """Whether the link to a station was lost and is not back."""
        return LINK_LOST in self._problems.get((station, None), {})

    def flags_lost_at(self, place: Place) -> int | None:
        """Return when an answer with the alarm flags was last lost, UTC in µs."""
        return self._flags_lost.get(place)

    def _add(self, seq: int, event: EventRow) -> None:
        self.newest.append(NumberedEvent(seq, event))
        place, kind = (event.station, event.port), event.kind
        alarms, problems = self._alarms.setdefault(place, {}), self._problems.setdefault(place, {})
        if kind in ALARMS_BEGIN:
            alarms[kind] = event.text
            self._counts[place] += 1
        elif kind == EPISODE_BEGINS:
            alarms[event.raw or kind] = event.text
        elif kind == EPISODE_ENDS:
            alarms.pop(event.raw or EPISODE_BEGINS, None)
        elif kind == CLOCK_STEP and event.raw is not None:
            self.host_offset_us += (event.value or 0.0) * 1e6
        elif kind == FLAGS_LOST:
            self._flags_lost[place] = event.time
        elif kind in PROBLEMS_BEGIN:
            problems[kind] = event.text
        elif kind == BEGIN:
            self.unit, self.has_units = event.raw, True
        elif kind == END:
            self.unit = None
        alarms.pop(ALARMS_END.get(kind, ""), None)
        problems.pop(PROBLEMS_END.get(kind, ""), None)


def _event(row: dict[str, object], time: int, earliest: int | None) -> EventRow:
    names = ("station", "port", "code", "value", "limit_value", "raw")
    more = {name: row[name] for name in names}
    severity = severity_of(str(row["severity"]))
    return EventRow(time, str(row["kind"]), severity, str(row["text"]), earliest=earliest, **more)  # type: ignore[arg-type]


class SettingHistory:
    """The newest readings of each station's settings and counters."""

    def __init__(self) -> None:
        self._settings: dict[str, dict[tuple[int | None, str | None, str], Setting]] = {}
        self._counters: dict[str, dict[tuple[int | None, str], Counter]] = {}

    def add_settings(self, rows: pa.Table) -> None:
        for row in rows.drop_columns(["time"]).to_pylist():
            port, tool, name = row["port"], row["tool_name"], row["setting"]
            one = Setting(port, tool, name, row["readback"], row["uom"], row["outcome"])
            self._settings.setdefault(row["station"], {})[port, tool, name] = one

    def add_counters(self, rows: pa.Table) -> None:
        for row in rows.drop_columns(["time"]).to_pylist():
            one = Counter(row["port"], row["counter"], row["value"], row["uom"], row["raw"])
            self._counters.setdefault(row["station"], {})[one.port, one.name] = one

    def settings(self, station: str) -> tuple[Setting, ...]:
        return tuple(self._settings.get(station, {}).values())

    def counters(self, station: str) -> tuple[Counter, ...]:
        return tuple(self._counters.get(station, {}).values())
