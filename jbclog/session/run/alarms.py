"""Alarm flags: latched in the station, cleared by reading, one bit each without redundancy.

The flags are read once and never again for the same answer (manual 000, 4.8.27;
docs/reference/faults.md, F-39). A set flag is an alarm only if a temperature beyond the limit, read
since the last reading of the flags, confirms it; until then it is `alarm.unconfirmed`. A lost
answer makes the flag unknown, not off. Flags count while the tool is working, once it has reached
setpoint ±10 °C; those of the first reading were raised before the run.

A flag that stays set, or is set again, is reported once, and again when more is known about it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from jbclog.core.quantities import Value
from jbclog.core.rows import Severity
from jbclog.session.run.context import SessionContext
from jbclog.session.run.state import PortState


@dataclass(frozen=True, slots=True)
class _Side:
    """One of the two flags: its names, its digit, and the temperature that confirms it."""

    word: str
    digit: int
    limit: str
    extreme: Callable[[PortState], int | None]
    beyond: Callable[[float, float], bool]


SIDES = (
    _Side(
        "high", 4, "alarm_high_limit", lambda port: port.hottest_c, lambda seen, limit: seen > limit
    ),
    _Side(
        "low", 3, "alarm_low_limit", lambda port: port.coolest_c, lambda seen, limit: seen < limit
    ),
)


def bears_out(context: SessionContext, port: PortState, value: int) -> bool:
    """Return True if `value` is the first beyond a limit while alarms count, so that it turns a set
    flag into an alarm.
    """
    before = port.temperature_c
    if value == before:
        return False
    for side in SIDES:
        if _is_beyond(side, port, value) and not _is_beyond(side, port, before):
            return context.state.alarms_count(port)
    return False


def _is_beyond(side: _Side, port: PortState, value: int | None) -> bool:
    limit = port.celsius(side.limit)
    return value is not None and limit is not None and side.beyond(value, limit)


class FlagState(IntEnum):
    """What is known about a set flag, in increasing order."""

    BEFORE_RUN = 0
    NOT_COUNTING = 1
    UNCONFIRMED = 2
    ALARM = 3


class AlarmWatch:
    """The flags of one port over a run."""

    def __init__(self, context: SessionContext, port: PortState) -> None:
        self._context = context
        self._port = port
        self._last_read: float | None = None
        self._reported: dict[str, FlagState] = {}  # set flags, as reported

    def observe(self, word: Value) -> None:
        """Process the flags just read as `word`."""
        if isinstance(word, tuple):
            self.read(word, self._context.station.heard)

    def read(self, word: tuple[int, ...], now: float) -> None:
        for side in SIDES:
            reported = self._reported.get(side.word)
            if word[side.digit] == 1:
                known = self._known_of(side)
                if reported is None or known > reported:
                    self._reported[side.word] = known
                    self._report(side, known, reported)
            elif reported is not None:
                del self._reported[side.word]
                self._note(side, f"alarm.{side.word}.ended", Severity.INFO, "is no longer set")
        self._start_period(now)

    def lost(self, now: float, why: str) -> None:
        """Handle a lost answer: the station has cleared the flags that it sent."""
        self._reported.clear()
        text = (
            f"Port {self._port.number}: the answer to the alarm flags was lost ({why}); whether an"
            " alarm was raised is not known."
        )
        self._context.log.note(
            "alarm.unknown", Severity.WARNING, text, port=self._port.number, since=self._last_read
        )
        self._start_period(now)

    def _start_period(self, now: float) -> None:
        self._last_read = now
        self._port.hottest_c = self._port.coolest_c = None
        self._port.has_counted = self._context.state.alarms_count(self._port)

    def _known_of(self, side: _Side) -> FlagState:
        """Classify a set flag by the temperatures since the last reading; only those that count
        were kept.
        """
        if self._last_read is None:
            return FlagState.BEFORE_RUN
        seen, limit = side.extreme(self._port), self._port.celsius(side.limit)
        if seen is not None and limit is not None and side.beyond(seen, limit):
            return FlagState.ALARM
        return FlagState.UNCONFIRMED if self._port.has_counted else FlagState.NOT_COUNTING

    def _report(self, side: _Side, known: FlagState, reported: FlagState | None) -> None:
        seen, limit = side.extreme(self._port), self._port.celsius(side.limit)
        if known is FlagState.BEFORE_RUN:
            self._note(
                side,
                "alarm.before_run",
                Severity.INFO,
                "was set before this run began; it does not count",
            )
        elif known is FlagState.NOT_COUNTING:
            self._note(
                side,
                f"alarm.{side.word}.not_working",
                Severity.INFO,
                "was raised while heating up or not working",
            )
        elif known is FlagState.UNCONFIRMED:
            self._context.state.facts.unconfirmed_alarms += 1
            self._note(
                side,
                "alarm.unconfirmed",
                Severity.WARNING,
                self._not_confirmed(seen, limit),
                seen,
                limit,
            )
        else:
            self._context.state.facts.alarms += 1
            self._context.state.facts.unconfirmed_alarms -= reported is FlagState.UNCONFIRMED
            text = f"alarm: {seen} °C was seen, the limit is {limit:g} °C"
            self._note(side, f"alarm.{side.word}", Severity.ERROR, text, seen, limit)

    @staticmethod
    def _not_confirmed(seen: int | None, limit: float | None) -> str:
        if limit is None:
            return "flag is set, its limit is not known"
        return f"flag is set, no temperature beyond {limit:g} °C was read" + (
            "" if seen is None else f" (nearest {seen} °C)"
        )

    def _note(
        self,
        side: _Side,
        kind: str,
        severity: Severity,
        text: str,
        value: float | None = None,
        limit: float | None = None,
    ) -> None:
        sentence = f"Port {self._port.number}: {side.word}-temperature {text}."
        self._context.log.note(
            kind,
            severity,
            sentence,
            port=self._port.number,
            since=self._last_read,
            value=value,
            limit=limit,
            raw=side.word,
            at_once=True,  # the station has cleared the flag
        )
