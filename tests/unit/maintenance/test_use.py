"""Figures of use: what counters tell, how well, and what they cannot tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

import pytest

from jbclog.maintenance.counter_totals.observed import Observation
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import Join, Trace
from jbclog.maintenance.fleet import UseFigure
from jbclog.maintenance.station_errors import poisson_bounds
from jbclog.maintenance.stretch import whole, within
from jbclog.maintenance.use import NO_JOINTS, Past, use_of
from jbclog.maintenance.weeks import weeks_of
from support.fleets.counters import ago, look, then, went

WEEKLY = [7.0 * week for week in range(60, -1, -1)]


def figures(
    *series: Trace,
    looks: Sequence[Observation] = (),
    rated_power_w: float | None = None,
    port: int | None = None,
) -> Mapping[str, UseFigure]:
    known = {(one.port, one.counter): one for one in series}
    found = use_of(Past(known, looks, ago(0), rated_power_w))
    return {one.name: one for one in found if one.port == port}


def steady(
    counter: str, a_day: float, port: int = 1, days: Sequence[float] = tuple(WEEKLY)
) -> Trace:
    return went(counter, [(day, round((420 - day) * a_day)) for day in days], port)


def test_hours_that_just_go_on_are_as_narrow_over_a_year_as_over_a_day() -> None:
    year = within(whole(steady("work_h", 6.0)), ago(0), 365)
    assert year is not None
    assert (year.n, year.total) == (52, Interval(6 * 364 - 1, 6 * 364 + 1))


def test_how_much_it_worked_says_on_what_it_rests() -> None:
    found = figures(steady("work_h", 6.0), steady("plugged_h", 10.0))
    assert found["work_h_last"].range == Interval(41, 43)
    thirty = found["work_h_a_day_30"]
    assert (thirty.n, thirty.days) == (4, 28)
    assert thirty.range is not None
    assert 6.0 in thirty.range
    assert thirty.range.width < 0.1
    assert found["work_h_a_day_365"].value == pytest.approx(6.0, abs=0.02)
    assert found["use_percent"].value == pytest.approx(60, abs=0.2)


def test_no_reading_near_is_no_figure_and_never_zero() -> None:
    rare = figures(went("work_h", [(200, 100), (100, 700)]))
    assert rare["work_h_last"].value == 600
    assert (rare["work_h_a_day_30"].value, rare["work_h_a_day_30"].why) == (
        None,
        "no reading about 30 days ago",
    )
    assert rare["use_percent"].value is None
    assert figures()["work_h_last"].why == "not counted here, or not read twice yet"
    assert all(one.value is None and one.why for one in figures().values())


def test_a_year_of_a_station_that_has_been_known_for_a_month_is_not_known() -> None:
    found = figures(went("work_h", [(31, 0), (15, 90), (0, 186)]))
    assert found["work_h_a_day_30"].value == 6
    assert found["work_h_a_day_365"].value is None


def test_two_looks_at_the_same_time_are_no_pace() -> None:
    """Of a clock that stands, or of a ledger that is not ours."""
    fed = went("dispensed_cycles", [(5, 10), (5, 20)])
    assert figures(fed)["joints_a_day"].value is None
    first, last = [(195.5, 0), (195.5, 5), (0, 10)], [(9, 0), (0, 5), (0, 9)]
    for readings in (first, last):
        assert len(weeks_of([went("work_h", readings)], ago(0))) == 53


def test_shares_are_never_more_than_all() -> None:
    found = figures(went("plugged_h", [(30, 0), (0, 10)]), went("work_h", [(30, 0), (0, 10)]))
    assert found["use_percent"].range == Interval(pytest.approx(100 * 9 / 11), 100)
    off = figures(went("plugged_h", [(30, 5), (0, 5)]), went("work_h", [(30, 5), (0, 5)]))
    assert off["use_percent"].why == "not plugged in long enough"


def test_hours_that_were_lost_to_a_reset_have_a_range_or_no_middle_at_all() -> None:
    reset = then(went("work_h", [(30, 500)]), 0, 3, Join.FROM_ZERO, Interval(0, 50))
    assert figures(reset)["work_h_last"].range == Interval(3, 54)
    lost = then(went("work_h", [(30, 500)]), 0, 3, Join.LOOSE, Interval(0, inf))
    assert figures(lost)["work_h_last"].range == Interval(0, 720)  # no more than went by
    feeds = then(went("dispensed_cycles", [(30, 500)]), 0, 3, Join.LOOSE, Interval(0, inf))
    found = figures(feeds)["joints_a_day"]
    assert (found.value, found.range, found.why) == (
        None,
        Interval(0, inf),
        "no upper bound is known",
    )


def test_a_reading_with_a_wrong_clock_is_read_over() -> None:
    right = {(1, "work_h"): went("work_h", [(30, 500), (-160, 560), (0, 680)])}
    found = {
        one.name: one for one in use_of(Past(right, (), ago(0), believed=lambda look: look != 1))
    }
    assert found["work_h_last"].range == Interval(179, 181)
    assert found["work_h_last"].days == 30
    assert found["work_h_a_day_30"].value == 6
    weeks = weeks_of(list(right.values()), ago(0), lambda look: look != 1)
    assert weeks[-1].per_day is not None
    assert 6.0 in weeks[-1].per_day


def test_ports_stand_together_and_alone() -> None:
    two = [
        steady(name, pace, port)
        for name, pace in (("work_h", 4.0), ("plugged_h", 8.0))
        for port in (1, 2)
    ]
    assert figures(*two)["work_h_last"].range == Interval(54, 58)
    assert figures(*two, port=2)["work_h_last"].range == Interval(27, 29)
    assert figures(*two, port=2)["use_percent"].value == pytest.approx(50, abs=0.2)


def test_a_port_that_was_never_read_is_not_left_out_of_the_sum() -> None:
    found = figures(steady("work_h", 4.0), steady("plugged_h", 4.0), steady("plugged_h", 8.0, 2))
    assert found["work_h_last"].value is None


# -- hot for nothing -------------------------------------------------------------------------------


def busy_and_lazy() -> tuple[Trace, Trace]:
    """Thirty weeks with 2000 joints in 20 h, and thirty with 500 in 20 h."""
    hours = [(day, 20.0 * at) for at, day in enumerate(WEEKLY)]
    joints = [
        (day, 2000.0 * min(at, 30) + 500.0 * max(at - 30, 0)) for at, day in enumerate(WEEKLY)
    ]
    return went("work_h", hours), went("dispensed_cycles", joints)


def test_idle_while_hot_is_what_exceeds_the_best_weekly_rate() -> None:
    work, joints = busy_and_lazy()
    found = figures(work, joints, rated_power_w=130)
    idle = found["idle_hot_h"]
    truth = 30 * 20 * 0.75  # in the lazy weeks of which all are within the year
    assert idle.range is not None
    assert truth * 0.8 < idle.range.low <= truth
    assert idle.value == idle.range.low
    assert found["idle_hot_kwh"].value == pytest.approx(idle.range.low * 0.13)
    assert "best weekly rate" in idle.by


def test_without_a_rated_power_there_are_hours_only() -> None:
    assert (
        figures(*busy_and_lazy())["idle_hot_kwh"].why
        == "the line file declares no rated_power_w: hours only"
    )


def test_where_nothing_counts_joints_no_idle_time_is_claimed() -> None:
    found = figures(steady("work_h", 5.0), steady("sleep_cycles", 20), rated_power_w=130)
    for name in ("idle_hot_h", "idle_hot_percent", "idle_hot_kwh", "joints_a_day"):
        assert found[name].value is None
        assert NO_JOINTS in found[name].why
    never = figures(steady("work_h", 5.0), steady("desolder_cycles", 0))
    assert never["idle_hot_h"].value is None  # it has the counter, and no desoldering tool


def test_a_few_weeks_are_no_pace() -> None:
    work, joints = (
        went(one.counter, [(7.0 * week, 900.0 - 100 * week) for week in (3, 2, 1, 0)])
        for one in busy_and_lazy()
    )
    assert figures(work, joints)["idle_hot_h"].why == "not enough data: 3 of 4 weeks with joints"


def test_wire_a_joint_and_what_it_was_before() -> None:
    wire = went("dispensed_mm", [(90, 0), (60, 5000), (28, 10_000), (14, 13_000), (0, 16_000)])
    feeds = went("dispensed_cycles", [(90, 0), (60, 1000), (28, 2000), (14, 2500), (0, 3000)])
    found = figures(wire, feeds)
    assert (found["mm_a_joint"].value, found["mm_a_joint_before"].value) == (6, 5)
    assert found["mm_a_joint"].n == 2
    assert figures(steady("work_h", 5.0))["mm_a_joint"].why == "this station feeds no solder wire"
    short = figures(
        went("dispensed_mm", [(9, 0), (0, 60)]), went("dispensed_cycles", [(9, 0), (0, 10)])
    )
    assert (short["mm_a_joint"].value, short["mm_a_joint_before"].value) == (6, None)


# -- errors ----------------------------------------------------------------------------------------


def test_errors_are_those_that_runs_saw() -> None:
    looks = [
        look(days_ago=20, counts={(1, "plugged_h"): 100}),
        look(counts={(1, "plugged_h"): 400}, events={"port.error": 4, "x": 9}),
    ]
    found = figures(looks=looks)
    assert found["errors_last"].value == 4
    apart = found["error_mtbf_h"]
    assert apart.value == 75
    assert apart.range is not None
    assert apart.range.low < 75 < apart.range.high


@pytest.mark.parametrize(
    ("events", "why"), [(None, "no run was recorded"), ({}, "not enough data: 0 of 3 errors")]
)
def test_few_errors_or_no_record_give_no_mean(events: dict[str, int] | None, why: str) -> None:
    looks = [
        look(days_ago=20, counts={(1, "plugged_h"): 100}),
        look(counts={(1, "plugged_h"): 400}, events=events),
    ]
    assert figures(looks=looks)["error_mtbf_h"].why.startswith(why)


@pytest.mark.parametrize(
    ("count", "exact"), [(3, (0.8177, 7.7537)), (10, (5.4254, 16.9622)), (100, (84.139, 118.079))]
)
def test_bounds_of_a_count_are_those_of_the_tables(count: int, exact: tuple[float, float]) -> None:
    # half the chi-square quantiles of 2n and 2n + 2
    assert poisson_bounds(count, 0.05) == pytest.approx(exact, rel=0.01)


# -- week by week ----------------------------------------------------------------------------------


def test_each_week_of_the_last_year_has_its_hours() -> None:
    weeks = weeks_of([steady("work_h", 6.0)], ago(0))
    assert len(weeks) == 53
    assert weeks[-1].start == "2026-11-14"
    assert all(
        week.per_day is not None and 6.0 in week.per_day and not week.is_spread for week in weeks
    )


def test_between_audits_hours_are_spread_and_before_the_first_nothing_is_known() -> None:
    weeks = weeks_of(
        [went("work_h", [(100, 0), (93, 42), (23, 42 + 140), (9, 200), (2, 210)])], ago(0)
    )
    assert [week.per_day for week in weeks[:38]] == [None] * 38
    long = weeks[42]
    assert long.is_spread
    assert long.per_day is not None
    assert 2.0 in long.per_day
    assert weeks[-1].per_day is None  # it was not seen for two days


def test_two_ports_are_added_and_one_that_is_not_known_makes_the_week_unknown() -> None:
    both = weeks_of([steady("work_h", 6.0), steady("work_h", 3.0, 2)], ago(0))
    assert both[-1].per_day is not None
    assert 9.0 in both[-1].per_day
    late = went("work_h", [(10, 0), (0, 20)], 2)
    assert weeks_of([steady("work_h", 6.0), late], ago(0))[-3].per_day is None
    assert weeks_of([], ago(0)) == ()


def test_a_reset_makes_its_own_week_wide_and_no_other() -> None:
    work = then(
        went("work_h", [(21, 500), (14, 530), (7, 560)]), 0, 12, Join.FROM_ZERO, Interval(0, 60)
    )
    weeks = weeks_of([work], ago(0))
    assert weeks[-1].per_day == Interval((12 - 1) / 7, (12 + 60 + 1) / 7)
    assert weeks[-2].per_day == Interval(29 / 7, 31 / 7)
