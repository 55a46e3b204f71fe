"""Tasks: what was used since they were done, how they stand, and when they will be due."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.config.tasks_file import Task
from jbclog.maintenance.counter_totals.observed import Fact
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.due import (
    DAY,
    WEEK,
    Pace,
    State,
    Step,
    TaskState,
    forecast,
    pace_of,
    states_of,
    used_since,
)
from support.fleets.looks import at, seen, series, told, traced

TIP = Task("tip-change", "Change the tip", "work_h", 100.0)
CHECK = Task("check", "Verify", "days", 30.0)
EVEN = (1.0,) * 7


def worked(*hours: float, every: float = 24.0) -> Trace:
    """Working hours that a station with many plugged hours showed."""
    return series(
        every, plugged_h=[5000 + 8 * place for place in range(len(hours))], work_h=list(hours)
    )["work_h"]


def state(trace: Trace, *facts: Fact, task: Task = TIP, now: float = 24.0 * 9) -> TaskState:
    return next(states_of(task, [trace], facts, at(now)))


# -- what was used ---------------------------------------------------------------------------------


def test_what_was_used_since_a_fact_between_two_looks_is_bounded_by_both() -> None:
    trace = worked(1000, 1006, 1012, 1018)
    assert used_since(trace, at(30)) == Interval(5, 7 + 7)
    assert used_since(trace, at(47.5)) == Interval(5, 7 + 0.5)
    assert used_since(trace, at(24)) == Interval(11, 13)
    assert used_since(trace, None) == Interval(17, 19)
    assert used_since(trace, at(100)) == Interval(0, 0)


def test_done_begins_anew_with_its_part() -> None:
    trace = worked(1000, 1040, 1080, 1120, every=168)
    assert state(trace).used == Interval(119, 121)
    done = state(trace, told(168, "tip-change", 1, "T-7"))
    assert (done.used, done.is_told, done.since, done.part) == (
        Interval(79, 81),
        True,
        at(168),
        "T-7",
    )
    assert state(trace, told(168, "tip-change", 2)).used == Interval(119, 121)  # of another port
    assert state(trace, told(168, "other-task")).used == Interval(119, 121)
    assert state(trace, told(168, "tip-change")).used == Interval(79, 81)  # of all ports


@pytest.mark.parametrize(
    ("used", "expected"),
    [
        (50, State.FINE),
        (78, State.FINE),
        (79, State.SOON),
        (99, State.SOON),
        (101, State.DUE),
        (120, State.DUE),
        (121, State.OVERDUE),
    ],
)
def test_states_go_by_what_was_used_at_least_and_warn_by_what_can_have_been(
    used: int, expected: State
) -> None:
    assert state(worked(1000, 1000 + used, every=400)).state is expected


def test_what_cannot_be_told_is_unknown() -> None:
    trace = series(4380, plugged_h=[100, 3000], work_h=[50, 60])["work_h"]
    assert state(trace).state is State.UNKNOWN


def test_ports_together() -> None:
    one, other = worked(1000, 1030, every=400), worked(2000, 2040, every=400)
    both = Task("filter", "Filter", "work_h", 100.0, of_station=True)
    (found,) = states_of(both, [one, other], [], at(400))
    assert (found.port, found.used) == (None, Interval(68, 72))
    assert len(list(states_of(TIP, [one, other], [], at(400)))) == 2


def test_days_are_of_the_calendar() -> None:
    assert state(worked(1), task=CHECK).state is State.UNKNOWN
    found = state(worked(1), told(0, "check"), task=CHECK, now=24.0 * 25)
    assert (found.used, found.state) == (Interval(25, 25), State.SOON)
    assert found.due is not None
    assert {found.due.p10, found.due.p50, found.due.p90} == {"2026-02-04"}


# -- when it will be due ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("days", "expected", "percent"),
    [
        (0, State.UNKNOWN, None),
        (23, State.UNKNOWN, None),
        (24, State.SOON, 80),
        (30, State.DUE, 100),
        (36, State.OVERDUE, 120),
    ],
)
def test_what_was_never_done_waits_since_the_first_audit(
    days: int, expected: State, percent: float | None
) -> None:
    found = state(worked(1, 1), task=CHECK, now=24.0 * days)
    assert (found.state, found.percent and found.percent.low, found.due) == (
        expected,
        percent,
        None,
    )
    assert found.why.startswith("last service date unknown")


def test_a_station_is_done_when_all_of_it_is() -> None:
    ports = [one for _, one in sorted(traced([seen(0, {"work_h": 1, "2.work_h": 1})]).now.items())]
    days = [
        (told(0, "check"), 10),
        (told(24, "check", 1), 10),
        (told(48, "check", 2), 9),
        (told(72, "check"), 7),
    ]
    for count in range(1, len(days) + 1):
        (found,) = states_of(CHECK, ports, [fact for fact, _ in days[:count]], at(240))
        assert found.used == Interval(days[count - 1][1], days[count - 1][1])
    (found,) = states_of(CHECK, ports, [told(24, "check", 1)], at(240))
    assert found.since == at(24)  # of the other port nobody told


def test_facts_from_beside_the_ledger_come_where_they_were_told() -> None:
    # put right later
    in_ledger = [replace(told(48, "check"), seq=1), replace(told(24, "check"), seq=2, told=at(72))]
    beside = replace(told(60, "check", 1), text="line 4 of verifications.jsonl")
    assert state(worked(1), *in_ledger, beside, task=CHECK).since == at(24)
    found = state(worked(1), *in_ledger, replace(beside, time=at(80), told=at(80)), task=CHECK)
    assert (found.since, found.told_by) == (at(80), "line 4 of verifications.jsonl")


def test_from_four_audits_on_there_is_a_range() -> None:
    three = state(worked(1000, 1010, 1020, every=168))
    assert (three.due, three.why.partition(";")[0]) == (None, "not enough data: 3 of 4 audits")
    four = state(worked(1000, 1010, 1020, 1030, every=168))
    assert four.due is not None
    assert four.due.p10 is not None
    assert four.due.p50 == "2026-03-16"  # seventy hours more at ten a week
    assert four.due.p10 < four.due.p50 < (four.due.p90 or "9999")


def test_four_audits_within_a_minute_are_not_enough() -> None:
    assert "not enough data" in state(worked(1000, 1000, 1000, 1000, every=1 / 240)).why


def test_what_is_never_used_has_no_date() -> None:
    assert state(worked(1000, 1000, 1000, 1000, 1000, every=168)).due is None


def test_what_is_due_has_no_range() -> None:
    assert state(worked(1000, 1050, 1100, 1150, 1200, every=168)).due is None


def weeks_of(amounts: Sequence[float]) -> list[Step]:
    return [Step(place * WEEK, (place + 1) * WEEK, amount) for place, amount in enumerate(amounts)]


def test_an_even_pace_is_told_more_narrowly_than_an_uneven_one() -> None:
    even, uneven = (
        pace_of(weeks_of(amounts * 12)) for amounts in ([10.0] * 8, [0.0] * 4 + [20.0] * 4)
    )
    assert even is not None
    assert uneven is not None
    assert (even.a_week, uneven.a_week) == (10.0, 10.0)
    assert even.variance < 0.2 < uneven.variance


def test_weekdays_are_learned_from_daily_looks() -> None:
    days = [
        Step(place * DAY, (place + 1) * DAY, 0.0 if (place + 3) % 7 > 4 else 8.0)
        for place in range(70)
    ]
    pace = pace_of(days)
    assert pace is not None
    assert pace.weekdays == pytest.approx((1.4,) * 5 + (0.0,) * 2)
    friday_noon = 1 * DAY + DAY / 2  # 1970-01-02
    found = forecast(friday_noon, 8.0, pace).p50
    assert found == pytest.approx(4 * DAY + DAY / 2)  # Monday noon


def test_the_dates_of_one_ledger_are_always_the_same() -> None:
    trace = worked(1000, 1009, 1022, 1030, every=168)
    assert state(trace).due == state(trace).due


@given(
    st.floats(0.01, 1000),
    st.floats(0, 1e5),
    st.floats(0.001, 5),
    st.floats(0.3, 500),
    st.floats(0, 1e6),
)
def test_ranges_are_in_order_and_after_now(
    a_week: float, left: float, variance: float, weeks: float, now: float
) -> None:
    found = forecast(now, left, Pace(a_week, variance, weeks, EVEN))
    ends = [one if one is not None else float("inf") for one in (found.p10, found.p50, found.p90)]
    assert ends == sorted(ends)
    assert ends[0] >= now - 1e-3


@given(st.floats(0.1, 5), st.floats(4, 100), st.floats(1, 60))
def test_what_is_further_off_or_less_known_is_wider(
    variance: float, weeks: float, left: float
) -> None:
    def width(variance: float, weeks: float, left: float) -> float:
        found = forecast(0.0, left, Pace(1.0, variance, weeks, EVEN))
        return float("inf") if found.p90 is None or found.p10 is None else found.p90 - found.p10

    assert width(variance, weeks, left) <= width(variance * 1.5, weeks, left) + 1
    assert width(variance, weeks, left) <= width(variance, weeks / 2, left) + 1
    assert width(variance, weeks, left) <= width(variance, weeks, left * 1.5) + 1
