"""One tick of one station: request and account for every due reading, one row for each port.

A missing value is null with a reason. A value that would stop a run, a counter, and an implausible
value are read again before they are accepted (`readings.py`).

An answer may be an old one that the link repeats directly before the true one. So it counts, for
alarms, tools, counters and everything else that the session concludes from it, once the next
exchange has ended with an answer, or `HELD_S` after it. If the client has met another answer to the
same question by then, the value is withdrawn. Rows are written in their order, each once all its
values count.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

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
from jbclog.core.io_requests import IoResult, Steps
from jbclog.core.quantities import Value, permille_of
from jbclog.core.rows import COLUMN, SAMPLE_COLUMNS, SampleRow, Severity, quality_of, reasons_text
from jbclog.core.text import count_text
from jbclog.protocol.client.interface import Contradiction, PreparedRead
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.family import NEEDS_A_TOOL, NO_TOOL, Family
from jbclog.protocol.commands.feeder import FeederState
from jbclog.protocol.commands.omega import OMEGA_SIGNALS, TRUE_ANSWERS
from jbclog.protocol.commands.signals import STATUS_COLUMNS
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.context import PortState, SessionContext
from jbclog.session.run.countdown import note_zero_countdown
from jbclog.session.run.counters import counter_row
from jbclog.session.run.identity import expect_identity, expect_same, expect_still_same
from jbclog.session.run.readings import (
    NO_DIGIT,
    PULLED,
    SecondLook,
    doubt_of,
    fell_too_fast,
    may_be_unusable,
    possible_of,
    unusable,
    void,
    whole_of,
)
from jbclog.session.run.watch import OBSERVERS, Observe, is_no_tool, would_change
from jbclog.session.scheduler import ScheduledRead

WIDTH = len(SAMPLE_COLUMNS)
_new = tuple.__new__
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
_STATUS, _COOLING, _DESOLDERING, _MOTOR = (COLUMN[name] for name in STATUS_COLUMNS)
_HIGH, _LOW, _FEEDING = COLUMN["alarm_high"], COLUMN["alarm_low"], COLUMN["feeding"]
MOTOR = ("off", "forward", "backward")

Fill = Callable[[SampleRow, Value], None]
"""Writes the values of an answer into the columns of a row."""


def _status(family: Family) -> Fill:
    """Return the filler for ``0MDES``: motor, desoldering, tens, status
    (docs/reference/protocol.md, Status word).
    """
    names, has_motor = family.status.names, family.has_feeder

    def fill(row: SampleRow, word: Value) -> None:
        assert isinstance(word, tuple)
        row[_STATUS] = names[word[4]]
        row[_COOLING] = word[3] == 1
        row[_DESOLDERING] = word[2] == 1
        if has_motor:
            row[_MOTOR] = MOTOR[word[1]]

    return fill


def _alarm_flags(row: SampleRow, word: Value) -> None:
    """Fill the flags: units high, tens low (manual 002, R-TAx)."""
    assert isinstance(word, tuple)
    row[_HIGH] = word[4] == 1
    row[_LOW] = word[3] == 1


def _feeding(row: SampleRow, mode: Value) -> None:
    row[_FEEDING] = mode == FeederState.RUNNING


def _flags(*columns: str) -> Fill:
    """Return the filler for OMEGA's states: each answer sets one column or more."""
    places = [(COLUMN[column], TRUE_ANSWERS[column]) for column in columns]

    def fill(row: SampleRow, value: Value) -> None:
        for place, yes in places:
            row[place] = value in yes

    return fill


def _plain(column: str) -> Fill:
    place = COLUMN[column]

    def fill(row: SampleRow, value: Value) -> None:
        row[place] = value

    return fill


def _share(column: str, command: Command, context: SessionContext) -> Fill:
    """Return the filler for a share of the station's maximum; the raw number is a row of `settings`
    (B-33).
    """
    place = COLUMN[column]

    def fill(row: SampleRow, value: Value) -> None:
        whole = whole_of(command, context)
        row[place] = (
            permille_of(value, whole) if isinstance(value, int) and whole is not None else None
        )

    return fill


SPECIAL: dict[str, Fill] = {
    "alarm_high": _alarm_flags,
    "feeding": _feeding,
    **{signal.name: _flags(*signal.columns) for signal in OMEGA_SIGNALS},
}


def fill_of(reading: ScheduledRead, context: SessionContext) -> Fill:
    """Return the filler for the columns of a reading."""
    signal = reading.name
    if signal == "status":
        return _status(context.family)
    if reading.command.share_of is not None:
        return _share(signal, reading.command, context)
    return SPECIAL.get(signal) or _plain(signal)


@dataclass(slots=True)
class SignalRead:
    """A reading, with everything needed to process its answer, and its statistics."""

    reading: ScheduledRead
    question: PreparedRead
    port: PortState
    fill: Fill | None
    observe: Observe | None
    look: SecondLook
    place: int | None  # of its first column
    may_be_unusable: bool
    dates_row: bool  # the row has the time of its answer
    shows_tool: bool  # shows whether the port has a tool
    is_tip: bool  # the temperature of a tip, which cools only so fast
    expect: Expect | None = None
    due: int = 0
    missed: dict[str, int] = field(default_factory=dict)
    failing: bool = False
    is_known: bool = False  # answered at least once
    is_lacking: bool = False  # the station lacks it

    @classmethod
    def of(cls, context: SessionContext, reading: ScheduledRead, alarms: AlarmWatch) -> SignalRead:
        question = context.station.question(reading.command, reading.asks_port)
        fill = fill_of(reading, context) if reading.columns else None
        place = COLUMN[reading.columns[0]] if reading.columns else None
        name, port = reading.name, context.ports[reading.port]
        possible = possible_of(context, reading)
        look = SecondLook(reading, port, question, doubt_of(reading), possible)
        is_doubtful = may_be_unusable(reading, context.family)
        return cls(
            reading,
            question,
            port,
            fill,
            _observer(reading, alarms),
            look,
            place,
            is_doubtful,
            name == "temperature_c",
            name in ("tool", "port_error"),
            name == "temperature_c" and context.family.hot_part == "tip",
            _expectation(context, reading),
        )


def _observer(reading: ScheduledRead, alarms: AlarmWatch) -> Observe | None:
    if reading.name == "alarm_high":
        return lambda context, port, value: alarms.observe(value)
    if reading.counter is not None:
        return lambda context, port, value: _count(context, port, reading, value)
    return OBSERVERS.get(reading.name)


def _count(context: SessionContext, port: PortState, reading: ScheduledRead, value: Value) -> None:
    if isinstance(value, int | float) and reading.counter is not None:
        port.counted[reading.counter.name] = value
        raw = reading.command.raw_text(context.station.data, value)
        counter_row(context, port, reading.counter, float(value), raw)


Expect = Callable[[SessionContext, SignalRead, Value], None]
"""Raises if an answer shows that another station, or another tool, is connected."""


def _expectation(context: SessionContext, reading: ScheduledRead) -> Expect | None:
    if reading.command.name == context.family.hours:
        return lambda context, probe, value: expect_same(context, probe.port.number, value)
    if reading.is_identity:
        return lambda context, probe, value: expect_identity(context, probe.reading.name, value)
    return None


@dataclass(slots=True)
class PortScan:
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


class LastAnswer(NamedTuple):
    """An answer that does not count yet: its value, and the row that has it."""

    probe: SignalRead
    value: Value
    scan: PortScan
    row: SampleRow
    reasons: dict[str, str]


class Scanner:
    """Reads into rows. `due` is when the tick was due; None without a grid."""

    def __init__(self, context: SessionContext) -> None:
        self._context = context
        self._station = context.station
        self._station.ended = self._end_exchange
        self._name = context.name
        self._last: LastAnswer | None = None
        self._has_acted = False  # on the last answer, before it counts
        # rows with their reasons that wait for the last answer to count
        self.finished: list[tuple[PortScan, SampleRow, dict[str, str]]] = []
        self._contradicted = 0  # withdrawn values
        self.failure: Exception | None = None  # raised by what an answer means; not raised yet

    @property
    def held_until(self) -> float | None:
        """When the last answer has to count (monotonic seconds); None if it does already."""
        if self._last is None:
            return None
        heard_at = self._last.probe.look.heard_at
        return None if heard_at is None else heard_at + HELD_S

    def _end_exchange(self, is_answered: bool) -> None:  # positional: the client calls it
        """Hand over within the client, which has to finish its exchange whatever that raises.

        If nothing came, the true answer to the question before may be late as well.
        """
        if self._last is None:
            return
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
        last, self._last = self._last, None
        if last is None:
            return
        probe, contradicted = last.probe, self._station.contradicted
        context = self._context
        context.answered_at = probe.look.heard_at
        try:
            if contradicted is not None and _is_same(contradicted, probe):
                self._withdraw(last)
            elif probe.observe is not None and not self._has_acted:
                self._observe(last)
        finally:
            context.answered_at = None
            self._has_acted = False
            if self.finished:
                self._write_rows()

    def act_at_end(self) -> None:
        """Act on the last answer although it may be contradicted yet: hot tools do not wait for
        that, only its row does.
        """
        if self._last is not None and self._last.probe.observe is not None:
            self._has_acted = True
            self._observe(self._last)
        self.raise_failure()

    def _observe(self, last: LastAnswer) -> None:
        probe = last.probe
        assert probe.observe is not None
        try:
            probe.observe(self._context, probe.port, last.value)
        except Exception:  # a bug: without a value in the row it does not count as read
            probe.due -= probe.place is None
            raise
        if probe.shows_tool:
            last.scan.no_tool = is_no_tool(self._context, probe.port)

    def _withdraw(self, last: LastAnswer) -> None:
        probe = last.probe
        if probe.place is None and self._has_acted:
            return  # it has no row that could take it back
        for column in probe.reading.columns:
            last.row[COLUMN[column]] = None
        self._account(probe, CONTRADICTED, last.reasons, last.scan.alarms, sent=not self._has_acted)

    def _count_contradicted(self, probe: SignalRead) -> None:
        self._contradicted += 1
        if self._contradicted == 1:
            text = (
                f"The {probe.question.title()} came twice and differed: the link or the station"
                " repeats old answers. Such values are not recorded; the end of the run gives"
                " their number."
            )
            self._context.note(
                "read.contradicted",
                Severity.WARNING,
                text,
                port=probe.port.number,
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
        self._context.note("read.contradicted", Severity.WARNING, text, value=count, raw="total")

    def _void(self, scan: PortScan, row: SampleRow, reasons: dict[str, str]) -> None:
        """Remove from a row what has no meaning because its last readings show no tool."""
        for probe in scan.needs_tool:
            (column,) = probe.reading.columns
            if reasons.get(column) == PULLED:
                probe.missed[PULLED] -= 1
            elif row[COLUMN[column]] is None:
                continue
            row[COLUMN[column]] = None
            reasons[column] = NO_TOOL
            probe.missed[NO_TOOL] = probe.missed.get(NO_TOOL, 0) + 1

    def _write_rows(self) -> None:
        finished, self.finished = self.finished, []
        for scan, row, reasons in finished:
            if is_no_tool(self._context, scan.port):
                self._void(scan, row, reasons)
            row[_QUALITY] = quality_of(reasons) if reasons else "ok"
            if reasons:
                row[_REASONS] = reasons_text(reasons)
            self._context.journal.sample(row)
        if self._station.anomalies.pending:
            self._context.report_anomalies()

    def begin(self, scan: PortScan, tick: int) -> None:
        row: SampleRow = [None] * WIDTH
        row[_TICK], row[_STATION], row[_PORT] = tick, self._name, scan.port.number
        scan.row, scan.reasons = row, {}
        scan.first_sent = scan.last_heard = scan.temperature_at = None
        scan.no_tool = is_no_tool(self._context, scan.port)

    def take(self, probe: SignalRead, scan: PortScan) -> Steps[None]:
        """Read one value from the beginning, as `settle` does."""
        probe.due += 1
        return self.settle(probe, scan)

    def settle(
        self,
        probe: SignalRead,
        scan: PortScan,
        heard: IoResult | BaseException | None = None,
        value: Value | None = None,
    ) -> Steps[None]:
        """Read one value; store it, or the reason why there is none.

        If the request was sent already, `heard` is its result or the exception raised instead, and
        `value` the decoded value, if known. Raises whatever makes further requests impossible:
        `LinkError`, `StationSilent`, `RobotModeOff`, and the run's end.
        """
        station = self._station
        if scan.first_sent is None:
            station.first_sent = heard.sent if isinstance(heard, IoResult) else None
        try:
            if isinstance(heard, BaseException):
                raise heard
            if value is None:
                value = yield from station.ask(probe.question, heard)
            if probe.look.is_due(self._context, value):
                value = yield from probe.look.settle(self._context, value)
                if self._is_change(probe, scan, value):
                    yield from expect_still_same(self._context)
            if probe.expect is not None:
                probe.expect(self._context, probe, value)
        except NotSupported as error:
            self._lacks(probe, scan, error)
        except (StationError, LinkError) as error:
            why = self._why_unread(probe, scan, error)
            self.unread(
                probe,
                scan,
                why,
                sent=not isinstance(error, Refusal),
                error_text=str(error) if why == error.reason else "",
            )
            if isinstance(error, LinkError | StationSilent | RobotModeOff):
                raise
        # the run's end during a request, which may be sent again, except for flags
        except BaseException:
            if probe.reading.command.sent_once:
                self.unread(probe, scan, SKIPPED, sent=True)
            else:
                probe.due -= 1
            raise
        else:
            self.keep(probe, scan, value)
        finally:
            if scan.first_sent is None:
                scan.first_sent = station.first_sent

    def _is_change(self, probe: SignalRead, scan: PortScan, value: Value) -> bool:
        """Return True if `value` would be recorded as a change of this station."""
        changes = would_change(self._context, probe.port, probe.reading.name, value)
        return changes and self._why_unusable(probe, scan, value) is None

    def _lacks(self, probe: SignalRead, scan: PortScan, error: NotSupported) -> None:
        """Handle NotSupported: a signal that was never answered does not exist, so it is not due
        and not read again.
        """
        why = self._why_unread(probe, scan, error)
        if probe.is_known or scan.no_tool or why != error.reason:
            self.unread(probe, scan, why)
            return
        probe.due -= 1
        probe.is_lacking = True
        scan.fast = [one for one in scan.fast if one is not probe]
        self._context.not_supported.add(probe.reading.name)

    def _why_unread(
        self, probe: SignalRead, scan: PortScan, error: StationError | LinkError
    ) -> str:
        """Return the reason; a station may refuse or garble a value that has no meaning at the
        moment.
        """
        meaningless = isinstance(error, Refusal | ImplausibleAnswer) and void(
            probe.reading.name, scan.port, self._context
        )
        return meaningless or error.reason

    def keep(self, probe: SignalRead, scan: PortScan, value: Value) -> None:
        """Store an accepted value, unless it has no meaning at the moment."""
        scan.last_heard = probe.look.heard_at = self._station.heard
        if probe.dates_row:
            scan.temperature_at = scan.last_heard
        try:
            if scan.no_tool or probe.may_be_unusable or probe.is_tip:
                why = self._why_unusable(probe, scan, value)
                if why is not None:
                    self._leave_empty(probe, scan, value, why)
                    return
            probe.failing, probe.is_known = False, True
            if probe.fill is not None:
                probe.fill(scan.row, value)
            # the same as `LastAnswer(...)`, at half its cost
            self._last = _new(LastAnswer, (probe, value, scan, scan.row, scan.reasons))
        # a bug: without a value in the row it does not count as read
        except Exception:
            probe.due -= probe.place is None or scan.row[probe.place] is None
            raise

    def _leave_empty(self, probe: SignalRead, scan: PortScan, value: Value, why: str) -> None:
        self.unread(probe, scan, why)
        if why == PULLED and isinstance(value, int):
            probe.port.pulled_c = value
        if probe.reading.name == "delay_s":
            note_zero_countdown(self._context, probe.port, value)

    def _why_unusable(self, probe: SignalRead, scan: PortScan, value: Value) -> str | None:
        if scan.no_tool and probe.reading.name in NEEDS_A_TOOL:
            return NO_TOOL
        if probe.is_tip and fell_too_fast(probe.port, value, self._station.heard):
            return PULLED
        return (
            unusable(probe.reading, value, scan.port, self._context)
            if probe.may_be_unusable
            else None
        )

    def unread(
        self,
        probe: SignalRead,
        scan: PortScan,
        why: str,
        *,
        sent: bool = False,
        error_text: str = "",
    ) -> None:
        """Account for a due reading without a value; `sent`: the station may have sent an answer
        that was lost.

        `error_text` is the error's text, for the event.
        """
        self._account(probe, why, scan.reasons, scan.alarms, sent=sent)
        if why not in EXPECTED and not probe.failing:
            probe.failing = True  # one event for a series of failures; each row has its own reason
            self._context.note(
                f"read.{why}",
                Severity.WARNING,
                _sentence(probe, why),
                port=probe.port.number,
                raw=error_text or None,
            )

    def _account(
        self,
        probe: SignalRead,
        why: str,
        reasons: dict[str, str],
        alarms: AlarmWatch,
        *,
        sent: bool,
    ) -> None:
        probe.missed[why] = probe.missed.get(why, 0) + 1
        for column in probe.reading.columns:
            reasons[column] = why
        if why == CONTRADICTED:
            self._count_contradicted(probe)
        counter = probe.reading.counter
        if counter is not None:
            counter_row(self._context, probe.port, counter, None, f"<{why}>")
        if probe.reading.name == "alarm_high" and sent:
            alarms.lost(self._context.now, why)

    def finish(self, scan: PortScan, unasked: str, due: float | None) -> None:
        """Finish the row: reasons of readings not requested, the times. Write it unless an answer
        does not count yet.

        A row without a temperature has the time at which it was due, but none before that of its
        port's last row, which an answer may have delayed.
        """
        row, reasons = scan.row, scan.reasons
        for probe in scan.fast:
            if row[probe.place or 0] is None and probe.reading.name not in reasons:
                probe.due += 1
                self.unread(probe, scan, unasked)
        first, last = scan.first_sent, scan.last_heard
        moment = due if scan.temperature_at is None else scan.temperature_at
        time = self._context.utc.micros(self._context.now if moment is None else moment)
        scan.port.row_time = max(scan.port.row_time, time)
        row[_TIME] = scan.port.row_time
        if first is not None:
            if due is not None:
                row[_LATE] = round((first - due) * 1e6)
            if last is not None:
                row[_SCAN] = round((last - first) * 1e6)
        self.finished.append((scan, row, reasons))
        answer = self._last
        if answer is None or all(waiting is not answer.row for _, waiting, _ in self.finished):
            self._write_rows()


def _is_same(contradicted: Contradiction, probe: SignalRead) -> bool:
    """Return True if the contradicted answer is the last one to `probe`."""
    is_its_command = contradicted.command is probe.reading.command
    return is_its_command and contradicted.heard == probe.look.heard_at


def _sentence(probe: SignalRead, why: str) -> str:
    texts = {
        "timeout": "no answer came in time",
        "bcc": "the check byte of every answer was wrong",
        "format": "the reply does not fit the question",
        PULLED: "it fell faster than any tip cools, as when the tool is pulled out of its port",
        "implausible": "the value is impossible, or changed when it was read again",
    }
    refused = f"the station refused it ({why})" if why.startswith("nak") else why
    return f"The {probe.question.title()} could not be read: {texts.get(why, refused)}."
