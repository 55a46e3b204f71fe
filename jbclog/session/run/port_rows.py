"""The rows of a tick, one for each port: read a signal into its row, and account for every due
reading.

A missing value is null with a reason. A value that would stop a run, a counter, and an implausible
value are read again before they are accepted (`readings.py`).

An answer may be an old one that the link repeats directly before the true one. So it counts, for
alarms, tools, counters and everything else that the session concludes from it, once the next
exchange has ended with an answer, or `HELD_S` after it. If the client has met another answer to the
same question by then, the value is withdrawn. Rows are written in their order, each once all its
values count.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf

from jbclog.core.errors import (
    AnswerContradicted,
    ImplausibleAnswer,
    LinkError,
    NotSupported,
    Refusal,
    RobotModeOff,
    StationError,
    StationSilent,
)
from jbclog.core.quantities import Value
from jbclog.core.rows import COLUMN, SAMPLE_COLUMNS, SampleRow, Severity, quality_of, reasons_text
from jbclog.core.text import count_text
from jbclog.protocol.client.interface import Contradiction
from jbclog.protocol.commands.family import NEEDS_A_TOOL, NO_TOOL
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.context import SessionContext
from jbclog.session.run.countdown import note_zero_countdown
from jbclog.session.run.counters import counter_row
from jbclog.session.run.identity import expect_still_same
from jbclog.session.run.readings import (
    NO_DIGIT,
    PULLED,
    fell_too_fast,
    unusable,
    void,
)
from jbclog.session.run.signal_read import SignalRead
from jbclog.session.run.state import PortState
from jbclog.session.run.watch import would_change

WIDTH = len(SAMPLE_COLUMNS)
SKIPPED = "skipped"
CONTRADICTED = AnswerContradicted.reason
HELD_S = 0.25  # a row waits no longer than this for another answer to its last question
EXPECTED = frozenset(  # reported by other events, or not at all
    {
        NO_TOOL,
        "no_thermocouple",
        "not_counting",
        NO_DIGIT,
        SKIPPED,
        LinkError.reason,
        "robot_off",
        CONTRADICTED,
    }
)

_TIME, _TICK, _STATION, _PORT = (COLUMN[name] for name in ("time", "tick", "station", "port"))
_LATE, _SCAN, _QUALITY, _REASONS = (
    COLUMN[name] for name in ("late_us", "scan_us", "quality", "reasons")
)


@dataclass(slots=True)
class PortRow:
    """One port in one tick, with its row."""

    port: PortState
    fast: list[SignalRead]
    alarms: AlarmWatch
    needs_tool: list[SignalRead]  # has no meaning without one
    row: SampleRow = field(default_factory=list)
    reasons: dict[str, str] = field(default_factory=dict)
    first_sent: float | None = None
    last_heard: float | None = None
    temperature_at: float | None = None
    no_tool: bool = False


# plain tuples: an answer is one for every exchange, a row one for every tick

FinishedRow = tuple[PortRow, SampleRow, dict[str, str]]
"""A row with the reasons of its missing values."""

LastAnswer = tuple[SignalRead, Value, PortRow, SampleRow, dict[str, str]]
"""An answer that does not count yet: signal and value, and the row that has it, with its reasons.
"""


class RowReader:
    """Reads into rows. `due` is when the tick was due; None without a grid."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self._station = context.station
        self._station.ended = self._end_exchange
        # rows do not wait longer for the end of an exchange, except for that of an OMEGA
        self._station.interrupt = self.hand_over
        self._name = context.name
        self._family = context.state.family
        self._last: LastAnswer | None = None
        self._has_acted = False  # on the last answer, before it counts
        # rows with their reasons that wait for the last answer to count
        self.finished: list[FinishedRow] = []
        self._contradicted = 0  # withdrawn values
        self.failure: Exception | None = None  # raised by what an answer means; not raised yet

    @property
    def held_until(self) -> float | None:
        """When the last answer has to count (monotonic seconds); None if it does already."""
        if self._last is None:
            return None
        signal, *_ = self._last
        heard_at = signal.look.heard_at
        return None if heard_at is None else heard_at + HELD_S

    def _end_exchange(self, is_answered: bool) -> None:  # positional: the client calls it
        """Hand over within the client, which has to finish its exchange whatever that raises.

        If nothing came, the true answer to the question before may be late as well.
        """
        if not is_answered and self._station.now < (self.held_until or 0.0):
            return
        try:
            self.hand_over()
        except Exception as error:
            self.failure = self.failure or error

    def raise_failure(self) -> None:
        """Raise what handing over within an exchange raised."""
        failure, self.failure = self.failure, None
        if failure is not None:
            raise failure

    def hand_over(self) -> None:
        """Let the last answer count, or withdraw it, and write the rows that wait for it."""
        last = self._last
        if last is None:
            return
        self._last = None
        station = self._station
        station.interrupt_at = inf
        signal, value, port_row, row, reasons = last
        contradicted = station.contradicted
        log = self._context.log
        log.answered_at = signal.look.heard_at
        try:
            if contradicted is not None and _is_same(contradicted, signal):
                self._withdraw(signal, port_row, row, reasons)
            elif signal.observe is not None and not self._has_acted:
                self._observe(signal, value, port_row)
        finally:
            log.answered_at = None
            self._has_acted = False
            if self.finished:
                self._write_rows()

    def act_at_end(self) -> None:
        """Act on the last answer although it may be contradicted yet: hot tools do not wait for
        that, only its row does.
        """
        if self._last is not None:
            signal, value, port_row, _, _ = self._last
            if signal.observe is not None:
                self._has_acted = True
                self._observe(signal, value, port_row)
        self.raise_failure()

    def _observe(self, signal: SignalRead, value: Value, port_row: PortRow) -> None:
        assert signal.observe is not None
        try:
            signal.observe(self._context, signal.port, value)
        except Exception:  # a bug: without a value in the row it does not count as read
            signal.due -= signal.place is None
            raise
        if signal.shows_tool:
            port_row.no_tool = self._is_empty(signal.port)

    def _withdraw(
        self, signal: SignalRead, port_row: PortRow, row: SampleRow, reasons: dict[str, str]
    ) -> None:
        if signal.place is None and self._has_acted:
            return  # it has no row that could take it back
        for column in signal.reading.columns:
            row[COLUMN[column]] = None
        self._account(signal, CONTRADICTED, reasons, port_row.alarms, sent=not self._has_acted)

    def _count_contradicted(self, signal: SignalRead) -> None:
        self._contradicted += 1
        if self._contradicted == 1:
            text = (
                f"The {signal.question.title()} came twice and differed: the link or the station"
                " repeats old answers. Such values are not recorded; the end of the run gives"
                " their number."
            )
            self._context.log.note(
                "read.contradicted",
                Severity.WARNING,
                text,
                port=signal.port.number,
            )

    def report_contradicted(self) -> None:
        """Report at the end how many values were withdrawn."""
        count = self._contradicted
        if not count:
            return
        text = (
            f"{count_text(count, 'value')} {'was' if count == 1 else 'were'} not recorded, because"
            " another answer to the same question differed."
        )
        self._context.log.note(
            "read.contradicted", Severity.WARNING, text, value=count, raw="total"
        )

    def _void(self, port_row: PortRow, row: SampleRow, reasons: dict[str, str]) -> None:
        """Remove from a row what has no meaning because its last readings show no tool."""
        for signal in port_row.needs_tool:
            (column,) = signal.reading.columns
            if reasons.get(column) == PULLED:
                signal.missed[PULLED] -= 1
            elif row[COLUMN[column]] is None:
                continue
            row[COLUMN[column]] = None
            reasons[column] = NO_TOOL
            signal.missed[NO_TOOL] = signal.missed.get(NO_TOOL, 0) + 1

    def _is_empty(self, port: PortState) -> bool:
        """As `StationState.is_empty`, with the family at hand."""
        return self._family.is_empty(port.tool, port.error)

    def _write_rows(self) -> None:
        finished, self.finished = self.finished, []
        for port_row, row, reasons in finished:
            if self._is_empty(port_row.port):
                self._void(port_row, row, reasons)
            row[_QUALITY] = quality_of(reasons) if reasons else "ok"
            if reasons:
                row[_REASONS] = reasons_text(reasons)
            self._context.log.journal.sample(row)
        if self._station.anomalies.pending:
            self._context.log.report_anomalies()

    def begin(self, port_row: PortRow, tick: int) -> None:
        row: SampleRow = [None] * WIDTH
        row[_TICK], row[_STATION], row[_PORT] = tick, self._name, port_row.port.number
        port_row.row, port_row.reasons = row, {}
        port_row.first_sent = port_row.last_heard = port_row.temperature_at = None
        port_row.no_tool = self._is_empty(port_row.port)

    async def read(self, signal: SignalRead, port_row: PortRow) -> None:
        """Read one value; store it, or the reason why there is none.

        Raises whatever makes further requests impossible: `LinkError`, `StationSilent`,
        `RobotModeOff`, and the run's end.
        """
        context = self._context
        station = self._station
        signal.due += 1
        if self.finished:
            held_until = self.held_until
            if held_until is not None:
                station.interrupt_at = held_until
        try:
            value = await station.ask(signal.question)
            if signal.look.is_due(context, value):
                value = await signal.look.settle(context, value)
                if self._is_change(signal, port_row, value):
                    await expect_still_same(context)
            if signal.expect is not None:
                signal.expect(context, signal, value)
        except NotSupported as error:
            self._lacks(signal, port_row, error)
        except (StationError, LinkError) as error:
            why = self._why_unread(signal, port_row, error)
            self.unread(
                signal,
                port_row,
                why,
                sent=not isinstance(error, Refusal),
                error_text=str(error) if why == error.reason else "",
            )
            if isinstance(error, LinkError | StationSilent | RobotModeOff):
                raise
        except Exception:
            # the run's end, or a bug: the request may be sent again, except for flags
            if signal.reading.command.sent_once:
                self.unread(signal, port_row, SKIPPED, sent=True)
            else:
                signal.due -= 1
            raise
        else:
            self.keep(signal, port_row, value)
        finally:
            station.interrupt_at = inf

    def _is_change(self, signal: SignalRead, port_row: PortRow, value: Value) -> bool:
        """Return True if `value` would be recorded as a change of this station."""
        changes = would_change(self._context, signal.port, signal.reading.name, value)
        return changes and self._why_unusable(signal, port_row, value) is None

    def _lacks(self, signal: SignalRead, port_row: PortRow, error: NotSupported) -> None:
        """Handle NotSupported: a signal that was never answered does not exist, so it is not due
        and not read again.
        """
        why = self._why_unread(signal, port_row, error)
        if signal.is_known or port_row.no_tool or why != error.reason:
            self.unread(signal, port_row, why)
            return
        signal.due -= 1
        signal.is_lacking = True
        port_row.fast = [one for one in port_row.fast if one is not signal]
        self._context.state.not_supported.add(signal.reading.name)

    def _why_unread(
        self, signal: SignalRead, port_row: PortRow, error: StationError | LinkError
    ) -> str:
        """Return the reason; a station may refuse or garble a value that has no meaning at the
        moment.
        """
        meaningless = isinstance(error, Refusal | ImplausibleAnswer) and void(
            signal.reading.name, port_row.port, self._context.state
        )
        return meaningless or error.reason

    def keep(self, signal: SignalRead, port_row: PortRow, value: Value) -> None:
        """Store an accepted value, unless it has no meaning at the moment."""
        port_row.last_heard = signal.look.heard_at = self._station.heard
        if signal.dates_row:
            port_row.temperature_at = port_row.last_heard
        try:
            if port_row.no_tool or signal.may_be_unusable or signal.is_tip:
                why = self._why_unusable(signal, port_row, value)
                if why is not None:
                    self._leave_empty(signal, port_row, value, why)
                    return
            signal.failing, signal.is_known = False, True
            if signal.fill is not None:
                signal.fill(port_row.row, value)
            self._last = (signal, value, port_row, port_row.row, port_row.reasons)
        # a bug: without a value in the row it does not count as read
        except Exception:
            signal.due -= signal.place is None or port_row.row[signal.place] is None
            raise

    def _leave_empty(self, signal: SignalRead, port_row: PortRow, value: Value, why: str) -> None:
        self.unread(signal, port_row, why)
        if why == PULLED and isinstance(value, int):
            signal.port.pulled_c = value
        if signal.reading.name == "delay_s":
            note_zero_countdown(self._context, signal.port, value)

    def _why_unusable(self, signal: SignalRead, port_row: PortRow, value: Value) -> str | None:
        if port_row.no_tool and signal.reading.name in NEEDS_A_TOOL:
            return NO_TOOL
        if signal.is_tip and fell_too_fast(signal.port, value, self._station.heard):
            return PULLED
        return (
            unusable(signal.reading, value, port_row.port, self._context.state)
            if signal.may_be_unusable
            else None
        )

    def unread(
        self,
        signal: SignalRead,
        port_row: PortRow,
        why: str,
        *,
        sent: bool = False,
        error_text: str = "",
    ) -> None:
        """Account for a due reading without a value; `sent`: the station may have sent an answer
        that was lost.

        `error_text` is the error's text, for the event.
        """
        self._account(signal, why, port_row.reasons, port_row.alarms, sent=sent)
        if why not in EXPECTED and not signal.failing:
            signal.failing = True  # one event for a series of failures; each row has its own reason
            self._context.log.note(
                f"read.{why}",
                Severity.WARNING,
                _sentence(signal, why),
                port=signal.port.number,
                raw=error_text or None,
            )

    def _account(
        self,
        signal: SignalRead,
        why: str,
        reasons: dict[str, str],
        alarms: AlarmWatch,
        *,
        sent: bool,
    ) -> None:
        signal.missed[why] = signal.missed.get(why, 0) + 1
        for column in signal.reading.columns:
            reasons[column] = why
        if why == CONTRADICTED:
            self._count_contradicted(signal)
        counter = signal.reading.counter
        if counter is not None:
            counter_row(self._context, signal.port, counter, None, f"<{why}>")
        if signal.reading.name == "alarm_high" and sent:
            alarms.lost(self._context.now, why)

    def finish(self, port_row: PortRow, unasked: str, due: float | None) -> None:
        """Finish the row: reasons of readings not requested, the times. Write it unless an answer
        does not count yet.

        A row without a temperature has the time at which it was due, but none before that of its
        port's last row, which an answer may have delayed.
        """
        row, reasons = port_row.row, port_row.reasons
        for signal in port_row.fast:
            if row[signal.place or 0] is None and signal.reading.name not in reasons:
                signal.due += 1
                self.unread(signal, port_row, unasked)
        first, last = port_row.first_sent, port_row.last_heard
        moment = due if port_row.temperature_at is None else port_row.temperature_at
        time = self._context.log.utc.micros(self._context.now if moment is None else moment)
        port_row.port.row_time = max(port_row.port.row_time, time)
        row[_TIME] = port_row.port.row_time
        if first is not None:
            if due is not None:
                row[_LATE] = round((first - due) * 1e6)
            if last is not None:
                row[_SCAN] = round((last - first) * 1e6)
        self.finished.append((port_row, row, reasons))
        if self._last is not None:
            _, _, _, awaited, _ = self._last
            if any(waiting is awaited for _, waiting, _ in self.finished):
                return
        self._write_rows()


def _is_same(contradicted: Contradiction, signal: SignalRead) -> bool:
    """Return True if the contradicted answer is the last one to `signal`."""
    is_its_command = contradicted.command is signal.reading.command
    return is_its_command and contradicted.heard == signal.look.heard_at


def _sentence(signal: SignalRead, why: str) -> str:
    texts = {
        "timeout": "no answer came in time",
        "bcc": "the check byte of every answer was wrong",
        "format": "the reply does not fit the question",
        PULLED: "it fell faster than any tip cools, as when the tool is pulled out of its port",
        "implausible": "the value is impossible, or changed when it was read again",
    }
    refused = f"the station refused it ({why})" if why.startswith("nak") else why
    return f"The {signal.question.title()} could not be read: {texts.get(why, refused)}."
