"""From a ledger to the value that page, CSV, JSON and terminal are made from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from jbclog.config.tasks_file import parse_tasks
from jbclog.maintenance.counter_totals.observed import Entry, Observation, Standing
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import DifferenceKind
from jbclog.maintenance.due import State
from jbclog.maintenance.fleet import Finding, FleetAudit, StationAudit, findings
from jbclog.maintenance.fleet_of_ledger import fleet_of
from jbclog.maintenance.ledger import add, read_book
from support.fleets.looks import at, seen, told

WEEK = 168.0
TASKS = parse_tasks(
    '[[task]]\nname = "tip-change"\ncounter = "work_h"\nlife_h = 100\n[[task]]\nname ='
    ' "check"\nlife_days = 30\n'
)
LOOKS = [
    seen(week * WEEK, {"plugged_h": 5000 + 40 * week, "work_h": 3000 + 20 * week})
    for week in range(4)
]
SILENT = replace(seen(4 * WEEK, {}), seen=False, why="no answer", identity=None)


@pytest.fixture
def ledger(tmp_path: Path) -> Path:
    return tmp_path / "counters.jsonl"


def gathered(ledger: Path, entries: list[Entry], now: Observation) -> FleetAudit:
    add(ledger, entries)
    return fleet_of(read_book(ledger), [now], now.time, TASKS)


def row(ledger: Path, entries: list[Entry], now: Observation) -> StationAudit:
    return gathered(ledger, entries, now).stations[0]


def test_a_row_has_what_follows_from_the_ledger(ledger: Path) -> None:
    audit = gathered(ledger, [*LOOKS, told(WEEK, "tip-change", 1, "T-7")], LOOKS[-1])
    one = audit.stations[0]
    assert (audit.line, audit.wrong, audit.is_whole, len(audit.facts)) == ("line", (), True, 1)
    assert (one.station, one.audits, one.last_seen, one.notes, one.doubts) == (
        "dde-1",
        4,
        LOOKS[-1].time,
        (),
        (),
    )
    meters = {meter.counter: meter for meter in one.meters}
    assert meters["work_h"].counter_total.total == Interval(59, 61)
    assert meters["work_h"].per_day == Interval(59 / 21, 61 / 21)
    tip, check = one.tasks
    assert (tip.used, tip.part, tip.state, check.state) == (
        Interval(39, 41),
        "T-7",
        State.FINE,
        State.UNKNOWN,
    )
    assert tip.due is not None


def test_a_station_that_did_not_answer_keeps_what_is_known(ledger: Path) -> None:
    one = row(ledger, [*LOOKS, SILENT], SILENT)
    assert (one.seen, one.why, one.last_seen, one.audits) == (False, "no answer", LOOKS[-1].time, 4)
    assert [meter.read for meter in one.meters] == [None, None]
    assert one.tasks[0].used == Interval(59, 61)
    assert one.identity == LOOKS[-1].identity


def test_one_that_was_never_seen_has_a_row(ledger: Path) -> None:
    one = row(ledger, [SILENT], SILENT)
    assert (one.audits, one.meters, one.identity) == (0, (), None)


def test_a_counter_that_was_never_read_is_not_known(ledger: Path) -> None:
    now = seen(4 * WEEK, {"plugged_h": 5160, "work_h": 3080, "sleep_cycles": None})
    unread = row(ledger, [*LOOKS, now], now).meters[2]
    assert unread.read is not None
    assert (unread.read.standing, unread.counter_total.is_known, unread.last) == (
        Standing.UNREAD,
        False,
        None,
    )


FALL = seen(4 * WEEK, {"plugged_h": 30, "work_h": 20})
AFTER = seen(4 * WEEK + 26, {"plugged_h": 55, "work_h": 40})  # more than since a reset
QUESTION = (
    "port 1 plugged_h 5120, now 30; port 1 work_h 3060, now 20: reset, exchanged, or rolled over"
    " between 2026-01-26 05:00 and 2026-02-02 05:00. Record which: `jbclog maintenance done"
    f" --station dde-1 --at {FALL.time} --task` counters-reset, station-replaced or"
    " counters-rolled-over"
)


def test_a_fall_is_one_question_and_asked_once(ledger: Path) -> None:
    one = row(ledger, [*LOOKS, FALL], FALL)
    assert (one.question, one.notes, one.doubts) == (QUESTION, (), ())
    assert Finding.SUSPECT in findings(one)
    after = row(ledger, [AFTER], AFTER)
    assert (after.question, after.notes, after.doubts) == ("", (), ())
    totals = {meter.counter: meter.counter_total for meter in after.meters}
    assert totals["work_h"].total == Interval(59 + 19, pytest.approx(61 + WEEK * 1.01 + 21))
    assert [mark.kind for mark in totals["work_h"].marks] == [DifferenceKind.FELL]


@pytest.mark.parametrize(
    ("task", "used"),
    [
        ("counters-reset", Interval(59 + 40, pytest.approx(61 + 41 + WEEK * 1.01 - 30))),
        ("station-replaced", Interval(19, 21)),
    ],
)
def test_the_answer_narrows_the_bounds(ledger: Path, task: str, used: Interval) -> None:
    one = row(ledger, [*LOOKS, FALL, told(4 * WEEK, task), AFTER], AFTER)
    assert {meter.counter: meter.counter_total.total for meter in one.meters}["work_h"] == used


def test_a_question_names_three_counters(ledger: Path) -> None:
    names = ("plugged_h", "work_h", "sleep_h", "hibernation_h", "no_tool_h")
    looks = [seen(week * WEEK, dict.fromkeys(names, shown)) for week, shown in ((0, 900), (1, 5))]
    one = row(ledger, looks, looks[-1])
    assert one.question.count(", now 5") == 3
    assert "; and 2 more: reset, exchanged, or rolled over" in one.question


def test_what_is_in_doubt_is_a_doubt_of_this_audit_only(ledger: Path) -> None:
    strange = seen(4 * WEEK, {"plugged_h": 5160, "work_h": 3080, "sleep_cycles": 99_999})
    first = seen(3.5 * WEEK, {"plugged_h": 5140, "work_h": 3070, "sleep_cycles": 99_990})
    one = row(ledger, [*LOOKS, first, strange], strange)
    assert [doubt.rule for doubt in one.doubts] == ["stands_at_top"]
    after = seen(5 * WEEK, {"plugged_h": 5200, "work_h": 3100, "sleep_cycles": None})
    later = row(ledger, [after], after)
    assert later.question == ""
    totals = {meter.counter: meter.counter_total.total for meter in later.meters}
    assert totals["work_h"] == Interval(99, 101)


def test_stations_of_one_name_on_two_lines_are_two(ledger: Path) -> None:
    others = [replace(one, line="other", counts=LOOKS[0].counts) for one in LOOKS]
    add(ledger, [*LOOKS, *others])
    audit = fleet_of(read_book(ledger), [LOOKS[-1], others[-1]], LOOKS[-1].time)
    assert audit.line == "line, other"
    assert [one.meters[1].counter_total.total for one in audit.stations] == [
        Interval(59, 61),
        Interval(0, 1),
    ]


def test_what_could_not_be_written_counts_all_the_same(ledger: Path) -> None:
    add(ledger, LOOKS[:3])
    audit = fleet_of(read_book(ledger), [LOOKS[3]], at(0), beside=[LOOKS[3]])
    assert audit.stations[0].audits == 4


def test_a_damaged_ledger_is_told_and_its_other_lines_count(ledger: Path) -> None:
    add(ledger, list(LOOKS))
    ledger.write_bytes(ledger.read_bytes().replace(b'"work_h": 3020', b'"work_h": 9020'))
    audit = fleet_of(read_book(ledger), [LOOKS[-1]], at(0))
    assert audit.wrong
    assert audit.stations[0].meters[1].counter_total.total == Interval(59, 61)
