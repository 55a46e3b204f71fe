"""Memory that is refused at any step of taking rows in: each row is in one batch, the events' chain
holds, facts arrive.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType

import pytest

from jbclog.record import batches, chains, live
from jbclog.record.batches import decode
from jbclog.record.chains import breaks
from jbclog.record.guard_actions import plain_events
from jbclog.record.live import RowBuffer
from support.records import few_rows

RUN, ROWS = "run", 2
OURS = {module.__file__ for module in (batches, chains, live)}
NEED_NONE = {"clear", "__exit__"}  # calls that need no memory


class Refusing:
    """Memory is refused at the `nth` call that the code of taking in makes, and at the next ones,
    `many` in all.
    """

    def __init__(self, nth: int, many: int) -> None:
        self.calls, self.nth, self.many = 0, nth, many

    def __call__(self, frame: FrameType, what: str, called: object) -> None:
        asks = what == "c_call" and getattr(called, "__name__", "") not in NEED_NONE
        if frame.f_code.co_filename in OURS and (
            asks or (what == "call" and self._is_function(frame.f_code))
        ):
            self.calls += 1
            if self.nth <= self.calls < self.nth + self.many:
                raise MemoryError

    @staticmethod
    def _is_function(code: CodeType) -> bool:
        return not code.co_name.startswith("<")


@contextmanager
def refused(nth: int, many: int) -> Iterator[Refusing]:
    refusing, before = Refusing(nth, many), sys.getprofile()
    sys.setprofile(refusing)
    try:
        yield refusing
    finally:
        sys.setprofile(before)


def handed_to(buffer: RowBuffer, first: int) -> None:
    for number in range(first, first + ROWS):
        buffer.sample(few_rows.sample(number))
        buffer.event(few_rows.event(number))
        buffer.counter(few_rows.counter(number))
        buffer.setting(few_rows.setting(number))
    buffer.facts(few_rows.facts(due=first))


def told_of(table: str, row: dict[str, object]) -> int:
    return int(
        str(
            row["raw"]
            if table == "counters"
            else row["tick"]
            if table == "samples"
            else str(row["setting"])[8:]
        )
    )


def held_in(buffer: RowBuffer) -> None:
    """Every row once, in its order."""
    numbers = [batch.number for batch in buffer.backlog]
    assert numbers == list(range(1, len(numbers) + 1))
    assert buffer.number == len(numbers)
    rows: dict[str, list[dict[str, object]]] = {}
    for batch in buffer.backlog:
        table = decode(batch, batch.crc)
        rows.setdefault(batch.table, []).extend(
            (plain_events(table) if batch.table == "events" else table).to_pylist()
        )
    for name in ("samples", "counters", "settings"):
        assert [told_of(name, row) for row in rows[name]] == list(range(2 * ROWS)), name
    assert [row["code"] for row in rows["events"]] == list(range(2 * ROWS))
    assert list(breaks(RUN, rows["events"])) == []
    assert json.loads(buffer.changed_facts["a"])["due"] == json.loads(
        json.dumps(few_rows.facts(due=ROWS).due)
    )
    assert buffer.dropped_rows == 0


def calls_of_a_turn() -> int:
    buffer = RowBuffer(RUN, lambda table, error: None)
    handed_to(buffer, 0)
    with refused(1 << 30, 0) as refusing:
        buffer.take()
    return refusing.calls


@pytest.mark.parametrize(
    ("many", "every"),
    [
        (1, 1),
        (2, 3),
        (100, 3),
        *(pytest.param(many, 1, marks=pytest.mark.campaign) for many in (2, 100)),
    ],
)
def test_nothing_is_lost_and_nothing_doubled_wherever_memory_is_refused(
    tmp_path: Path, many: int, every: int
) -> None:
    bad: list[Exception] = []
    calls = calls_of_a_turn()
    assert calls > 100
    for nth in range(1, calls + 1, every):
        buffer = RowBuffer(RUN, lambda table, error: bad.append(error))
        handed_to(buffer, 0)
        with refused(nth, many), pytest.raises(MemoryError):
            buffer.take()
        handed_to(buffer, ROWS)
        buffer.take()
        held_in(buffer)
    assert bad == []
