"""Gaps from rows made by hand: from the last reading before to the first one after, by signal."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.analysis.gaps import Gap, PortClock, SignalGaps
from jbclog.analysis.port_data import port_data
from jbclog.core.rows import StationFacts
from jbclog.record.samples_by_port import SamplesByPort
from jbclog.record.schema import RUN, SCHEMAS, SEQ

PERIOD_MS = 100
TEMPERATURE, SETPOINT, TOOL = "temperature_c", "setpoint_c", "tool"
SIGNALS = (TEMPERATURE, SETPOINT, TOOL)


class Row(NamedTuple):
    """A row: its tick, its time in ms (when its tick is due, unless given), and for each signal a
    value, a reason, or None where it was not due.
    """

    tick: int
    temperature: int | str | None = 350
    setpoint: int | str | None = None
    tool: int | str | None = None
    time_ms: int | None = None

    @property
    def cells(self) -> tuple[int | str | None, ...]:
        return self.temperature, self.setpoint, self.tool


def table(rows: list[Row]) -> pa.Table:
    reasons = [
        ";".join(
            f"{signal}={cell}"
            for signal, cell in zip(SIGNALS, row.cells, strict=True)
            if isinstance(cell, str)
        )
        or None
        for row in rows
    ]
    values: dict[str, Any] = {
        signal: pa.array(
            [row.cells[place] if isinstance(row.cells[place], int) else None for row in rows],
            pa.int64(),
        )
        for place, signal in enumerate(SIGNALS)
    }
    count = len(rows)
    values |= {
        "time": times_us(rows),
        "tick": [row.tick for row in rows],
        "station": ["dde-1"] * count,
        "port": [1] * count,
        "quality": ["ok"] * count,
        "reasons": reasons,
    }
    schema = SCHEMAS["samples"]
    names = [name for name in schema.names if name not in (RUN, SEQ)]
    columns = [
        pa.array(values[name], schema.field(name).type)
        if name in values
        else pa.nulls(count, schema.field(name).type)
        for name in names
    ]
    return pa.table(columns, names=names)


def times_us(rows: list[Row]) -> np.ndarray[Any, np.dtype[np.int64]]:
    times = [row.tick * PERIOD_MS if row.time_ms is None else row.time_ms for row in rows]
    return np.array(times, np.int64) * 1000


def port_gaps(
    rows: list[Row],
    *,
    cuts: tuple[int, ...] = (),
    first_tick: int | None = None,
    last_tick: int | None = None,
    has_grid: bool = True,
) -> dict[str, SignalGaps]:
    """The gaps of each signal in these rows, which are in tables that begin at `cuts`."""
    edges = [0, *cuts, len(rows)]
    parts = [table(rows[first:stop]) for first, stop in pairwise(edges) if stop > first]
    facts = StationFacts("dde-1", "", "dde", period_s=PERIOD_MS / 1e3 if has_grid else None)
    facts.first_tick = first_tick
    samples = SamplesByPort(parts[0].column_names, [], parts)
    data = port_data(
        samples, facts, 1, 0, columns=SIGNALS, every_tick={TEMPERATURE}, last_tick=last_tick
    )
    return {signal: data.gaps(signal) for signal in SIGNALS}


def gaps(rows: list[Row], signal: str = TEMPERATURE, **how: Any) -> list[tuple[Any, ...]]:
    """Each gap: start and stop in ms, readings missing, reasons, and + where it is longer."""
    return [
        (gap.start_us // 1000, gap.stop_us // 1000, gap.missing, gap.reasons_text)
        + (("+",) if gap.at_least else ())
        for gap in port_gaps(rows, **how)[signal]
    ]


def rows(*temperatures: int | str | None) -> list[Row]:
    return [Row(tick, temperature) for tick, temperature in enumerate(temperatures)]


LOST, LATE, AWAY, EMPTY = "timeout", "skipped", "disconnected", "no_tool"


@pytest.mark.parametrize(
    ("temperatures", "expected"),
    [
        ([350, 350, 350], []),
        ([350, LOST, 350], [(0, 200, 1, LOST)]),
        ([350, LOST, LOST, 350], [(0, 300, 2, LOST)]),
        ([350, LOST, 350, LOST, 350], [(0, 200, 1, LOST), (200, 400, 1, LOST)]),
        ([350, LOST, LATE, AWAY, 350], [(0, 400, 3, "timeout;skipped;disconnected")]),
        ([350, AWAY, LOST, AWAY, 350], [(0, 400, 3, "disconnected;timeout")]),
        ([350, LOST, EMPTY, EMPTY, LOST, 350], [(0, 500, 4, "timeout;no_tool")]),
        ([LOST, LOST, 350], [(0, 200, 2, LOST, "+")]),
        ([350, LOST, LOST], [(0, 200, 2, LOST, "+")]),
        ([350, LOST], [(0, 100, 1, LOST, "+")]),
        ([LOST, LOST, LOST], [(0, 200, 3, LOST, "+")]),
        ([LOST], [(0, 0, 1, LOST, "+")]),
        ([350, None, 350], []),  # it was not due
        ([LOST, 350, LOST], [(0, 100, 1, LOST, "+"), (100, 200, 1, LOST, "+")]),
    ],
)
def test_gaps_of_a_signal(temperatures: list[int | str | None], expected: list[Any]) -> None:
    assert gaps(rows(*temperatures)) == expected


@pytest.mark.parametrize("cut", range(1, 9))
def test_pieces_have_the_same_gaps(cut: int) -> None:
    some = rows(350, LOST, LATE, 350, 350, AWAY, AWAY, 350, LOST)
    assert gaps(some, cuts=(cut,)) == gaps(some)


def test_a_slow_signal_was_due_where_it_has_a_value_or_a_reason() -> None:
    """The setpoint is due every fifth tick; once it was lost. The tool was never answered."""
    slow = [
        Row(tick, 350, (LOST if tick == 5 else 350) if tick % 5 == 0 else None, AWAY)
        for tick in range(12)
    ]
    assert gaps(slow, SETPOINT) == [(0, 1000, 1, LOST)]
    assert gaps(slow, TOOL) == [(0, 1100, 12, AWAY, "+")]
    assert gaps(slow) == []


def test_ticks_without_rows_are_missing_readings_of_what_is_read_at_every_tick() -> None:
    some = [Row(0), Row(1, 350, 350), Row(5, 350, 350), Row(6)]
    assert gaps(some) == [(100, 500, 3, "no_rows")]
    assert gaps(some, SETPOINT) == []
    assert gaps([Row(0), Row(1, LOST), Row(4, AWAY), Row(5)]) == [
        (0, 500, 4, "timeout;no_rows;disconnected")
    ]


def test_ticks_without_rows_at_both_ends() -> None:
    assert gaps([Row(3), Row(4)], first_tick=1, last_tick=6) == [
        (100, 300, 2, "no_rows", "+"),
        (400, 600, 2, "no_rows", "+"),
    ]
    assert gaps([Row(3, LOST), Row(4)], first_tick=1) == [(100, 400, 3, "no_rows;timeout", "+")]
    assert gaps([Row(0), Row(1, LOST)], last_tick=2) == [(0, 200, 2, "timeout;no_rows", "+")]


def test_what_a_late_answer_left_no_time_for_was_due_before_it() -> None:
    """Tick 2 was answered at 640 ms: rows 3 to 6 follow it, and were due before. A run of 0.1.0 has
    them at the times at which they were due.
    """
    for stamped_ms in (640, None):
        late = [Row(tick, LATE, time_ms=stamped_ms) for tick in (3, 4, 5, 6)]
        some = [Row(0), Row(1), Row(2, time_ms=640), *late, Row(7), Row(8)]
        for cut in range(1, 9):
            assert gaps(some, cuts=(cut,)) == [(100, 640, 4, LATE)]


def test_ticks_without_rows_before_a_late_answer() -> None:
    """The host stood still while it waited for tick 2, and came back at 640 ms."""
    some = [Row(0), Row(1), Row(2, time_ms=640), Row(7), Row(8)]
    assert gaps(some) == [(100, 640, 4, "no_rows")]
    longer = [Row(0), Row(1), Row(2, time_ms=440), Row(7), Row(8)]  # and stood still once more
    assert gaps(longer) == [(100, 440, 2, "no_rows"), (440, 700, 2, "no_rows")]


def test_times_of_rows_never_step_back() -> None:
    """In a run of 0.1.0 the row after a late answer has the time at which it was due."""
    clock = PortClock(PERIOD_MS * 1e3)
    first = clock.never_back(np.array([10, 640, 300], np.int64))
    assert first.tolist() == [10, 640, 640]
    clock.without_rows(first, np.array([0, 1, 2], np.int64))
    assert clock.never_back(np.array([400, 700], np.int64)).tolist() == [640, 700]


def test_times_are_those_of_the_rows() -> None:
    some = [Row(0, time_ms=12), Row(1, LOST), Row(2, time_ms=231)]
    assert gaps(some) == [(12, 231, 1, LOST)]
    (gap,) = port_gaps(some)[TEMPERATURE]
    assert gap.seconds == 0.219


def test_without_a_grid_a_pause_between_rows_is_a_gap() -> None:
    some = [Row(0, time_ms=0), Row(1, LOST, time_ms=30), Row(2, time_ms=60), Row(3, time_ms=2060)]
    assert gaps(some, has_grid=False) == [(0, 60, 1, LOST), (60, 2060, 0, "no_rows")]
    assert gaps([Row(0, time_ms=0), Row(1, time_ms=500)], has_grid=False) == []


CELLS = st.sampled_from([350, 350, 350, None, LOST, LATE, EMPTY, AWAY])


@st.composite
def histories(draw: st.DrawFn) -> tuple[list[Row], tuple[int, ...]]:
    """Rows with ticks that have none; late answers, whose next rows are stamped not before them, or
    in a run of 0.1.0 when they were due.
    """
    made: list[Row] = []
    is_old = draw(st.booleans())
    tick = time_ms = 0
    for _ in range(draw(st.integers(1, 25))):
        is_late = draw(st.integers(0, 9)) == 0
        due_ms = tick * PERIOD_MS
        temperature: int | str | None = LATE if time_ms > due_ms + PERIOD_MS else draw(CELLS)
        if temperature is None:
            temperature = 350
        if temperature == 350:
            time_ms = max(due_ms + draw(st.integers(5, 40)) + 700 * is_late, time_ms + 1)
        else:
            time_ms = max(due_ms, time_ms)
        row_ms = due_ms if is_old and temperature != 350 else time_ms
        made.append(Row(tick, temperature, draw(CELLS), draw(CELLS), row_ms))
        tick += 1 + draw(st.sampled_from([0, 0, 0, 0, 3]))
    cuts = draw(st.sets(st.integers(1, len(made)), max_size=4))
    return made, tuple(sorted(cuts))


@given(histories(), st.integers(0, 3))
def test_each_missing_reading_lies_in_one_gap(
    history: tuple[list[Row], tuple[int, ...]], more: int
) -> None:
    """Gaps are in order and share no time; no reading lies within one; what is missing in them is
    what was due and was not obtained.
    """
    made, cuts = history
    last_tick = made[-1].tick + more
    found = port_gaps(made, cuts=cuts, first_tick=0, last_tick=last_tick)
    whole = port_gaps(made, first_tick=0, last_tick=last_tick)
    times = np.maximum.accumulate(times_us(made))
    for place, signal in enumerate(SIGNALS):
        own = [*found[signal]]
        assert own == [*whole[signal]]
        cells = [row.cells[place] for row in made]
        lost = sum(isinstance(cell, str) for cell in cells)
        if signal == TEMPERATURE:
            lost += last_tick + 1 - len(made)
        assert sum(gap.missing for gap in own) == lost
        assert all(one.stop_us <= other.start_us for one, other in pairwise(own))
        readings = {int(time) for time, cell in zip(times, cells, strict=True) if cell == 350}
        for gap in own:
            assert_bounded(gap, readings)


def assert_bounded(gap: Gap, readings: set[int]) -> None:
    """A gap lies between two readings, or has none before or after it and says so."""
    assert gap.missing > 0
    if gap.start_us == gap.stop_us:  # the first answer of all was late, and left out what follows
        assert gap.at_least
        return
    assert not [time for time in readings if gap.start_us < time < gap.stop_us]
    has_start, has_stop = gap.start_us in readings, gap.stop_us in readings
    before = any(time <= gap.start_us for time in readings)
    after = any(time >= gap.stop_us for time in readings)
    assert gap.at_least == (not before or not after)
    assert has_start == before
    assert has_stop == after
