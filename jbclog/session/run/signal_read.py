"""A reading of a run, with all that its answer needs: its columns, what it means, and whether it is
read again before it is accepted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from jbclog.core.quantities import Value
from jbclog.core.rows import COLUMN
from jbclog.protocol.client.interface import PreparedRead
from jbclog.session.run.alarms import AlarmWatch
from jbclog.session.run.context import SessionContext
from jbclog.session.run.counters import counter_row
from jbclog.session.run.identity import expect_identity, expect_same
from jbclog.session.run.readings import SecondLook, doubt_of, may_be_unusable, possible_of
from jbclog.session.run.row_values import Fill, fill_of
from jbclog.session.run.state import PortState, StationState
from jbclog.session.run.watch import OBSERVERS, Observe
from jbclog.session.scheduler import ScheduledRead


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
        name, port, columns = reading.name, context.state.ports[reading.port], reading.columns
        question = context.station.question(reading.command, reading.asks_port)
        possible = possible_of(context.state, reading)
        return cls(
            reading=reading,
            question=question,
            port=port,
            fill=fill_of(reading, context.state) if columns else None,
            observe=_observer(reading, alarms),
            look=SecondLook(reading, port, question, doubt_of(reading), possible),
            place=COLUMN[columns[0]] if columns else None,
            may_be_unusable=may_be_unusable(reading, context.state.family),
            dates_row=name == "temperature_c",
            shows_tool=name in ("tool", "port_error"),
            is_tip=name == "temperature_c" and context.state.family.hot_part == "tip",
            expect=_expectation(context.state, reading),
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


def _expectation(state: StationState, reading: ScheduledRead) -> Expect | None:
    if reading.command.name == state.family.hours:
        return lambda context, signal, value: expect_same(context, signal.port.number, value)
    if reading.is_identity:
        return lambda context, signal, value: expect_identity(context, signal.reading.name, value)
    return None
