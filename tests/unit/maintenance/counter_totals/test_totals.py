"""Counter totals on histories made by hand: every kind of difference, and its rule."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from weakref import WeakSet

import pytest

from jbclog.config.task_names import REPLACED, RESET, ROLLED_OVER
from jbclog.maintenance.counter_totals import tracing
from jbclog.maintenance.counter_totals.judging import RULES
from jbclog.maintenance.counter_totals.observed import Fact
from jbclog.maintenance.counter_totals.span import Elapsed, Interval
from jbclog.maintenance.counter_totals.totals import Difference, DifferenceKind
from support.fleets.looks import WHO, at, last, rules, seen, series, told, traced

DAY, WEEK = 24.0, 168.0


def test_whole_hours_are_one_hour_wide_over_however_many_looks() -> None:
    trace = series(DAY, plugged_h=range(5000, 5240, 8), work_h=range(3000, 3120, 4))["work_h"]
    assert trace.counter_total.total == Interval(115, 117)
    assert trace.between(0, 1) == Interval(3, 5)
    assert (trace.counter_total.is_known, trace.counter_total.marks, trace.counter_total.first) == (
        True,
        (),
        3000,
    )


def test_counts_are_exact() -> None:
    trace = series(DAY, plugged_h=[5000, 5008, 5016], sleep_cycles=[700, 731, 731])["sleep_cycles"]
    assert trace.counter_total.total == Interval(31, 31)
    assert [one.kind for one in trace.differences] == [DifferenceKind.NORMAL, DifferenceKind.ZERO]


def test_differences_without_an_event_are_not_kept_but_made() -> None:
    """A long ledger has millions of them. A counter that has rolled over shows less than its
    points.
    """
    shown = [(one * 8.0) % 100_000 for one in range(12_480, 12_520)]
    rolled = shown.index(0) - 1
    answer = told((rolled + 0.5) * DAY, ROLLED_OVER)
    traces = series(DAY, answer, plugged_h=shown, work_h=range(3000, 3160, 4))
    work, plugged = traces["work_h"], traces["plugged_h"]
    assert work.kept == [None] * 39
    assert [place for place, one in enumerate(plugged.kept) if one] == list(range(rolled, 39))
    assert work.difference(3) == Difference(
        port=1,
        counter="work_h",
        start=at(3 * DAY),
        stop=at(4 * DAY),
        before=3012,
        after=3016,
        kind=DifferenceKind.NORMAL,
        rule="went_on",
        text=RULES["went_on"],
        delta=Interval(3, 5),
        is_known=True,
    )
    assert work.difference(-36) == work.difference(3) == work.differences[3]
    assert [(one.before, one.after) for one in plugged.differences] == [*pairwise(shown)]
    assert rules(plugged) == [
        "rolled_over" if place == rolled else "went_on" for place in range(39)
    ]


def test_two_audits_within_a_minute_differ_in_nothing() -> None:
    traces = series(1 / 60, plugged_h=[5000, 5000], work_h=[3000, 3001], sleep_cycles=[700, 700])
    assert [one.differences[0].kind for one in traces.values()] == [
        DifferenceKind.ZERO,
        DifferenceKind.NORMAL,
        DifferenceKind.ZERO,
    ]
    assert traces["plugged_h"].counter_total.total == Interval(0, 1)
    assert all(one.counter_total.is_known for one in traces.values())


def test_a_fall_bounds_every_counter_by_the_elapsed_time_until_somebody_records_what_it_was() -> (
    None
):
    shown = {
        "plugged_h": [5000, 5008, 5016],
        "work_h": [3000, 3006, 3012],
        "sleep_cycles": [99_990, 12, 30],
    }
    traces = series(DAY, **shown)
    assert rules(traces["sleep_cycles"]) == ["fell", "went_on"]
    assert rules(traces["work_h"]) == ["beside_what_cannot_be", "went_on"]
    assert traces["sleep_cycles"].counter_total.total == Interval(18, DAY * 1.01 * 60 + 18)
    assert traces["work_h"].differences[0].delta == Interval(0, DAY * 1.01)
    assert not traces["work_h"].counter_total.is_known
    traces = series(DAY, told(20, ROLLED_OVER, port=1), **shown)
    assert rules(traces["sleep_cycles"]) == ["rolled_over", "went_on"]
    assert traces["sleep_cycles"].counter_total.total == Interval(40, 40)
    assert traces["sleep_cycles"].counter_total.is_known
    assert [one.kind for one in traces["sleep_cycles"].counter_total.marks] == [
        DifferenceKind.ROLL_OVER
    ]
    assert rules(traces["work_h"]) == ["went_on", "went_on"]


@pytest.mark.parametrize("answer", [told(20, ROLLED_OVER, port=2), told(-1, ROLLED_OVER)])
def test_an_answer_for_another_port_or_time_is_none(answer: Fact) -> None:
    trace = series(DAY, answer, plugged_h=[5000, 5008], sleep_cycles=[99_990, 12])["sleep_cycles"]
    assert rules(trace) == ["fell"]


def test_a_roll_over_that_cannot_be_is_not_believed() -> None:
    trace = series(
        DAY, told(20, ROLLED_OVER), plugged_h=[5000, 5008], work_h=[3000, 3006], sleep_cycles=[9, 3]
    )["sleep_cycles"]
    assert rules(trace) == ["fell"]


def test_hours_roll_over_after_99999() -> None:
    trace = series(WEEK, told(WEEK, ROLLED_OVER), plugged_h=[99_950, 70], work_h=[50_000, 50_080])[
        "plugged_h"
    ]
    assert (last(trace).kind, last(trace).delta) == (DifferenceKind.ROLL_OVER, Interval(119, 121))


def test_a_length_that_falls_alone_rolled_over_after_five_hexadecimal_digits() -> None:
    """It does every 105 m: nobody would record each."""
    shown = [104_000.0, 6_000.0, 14_000.0]
    trace = series(
        DAY, plugged_h=[5000, 5008, 5016], work_h=[3000, 3006, 3012], dispensed_mm=shown
    )["dispensed_mm"]
    assert rules(trace) == ["rolled_over", "went_on"]
    assert trace.counter_total.total.middle == pytest.approx(104_857.6 - 104_000 + 14_000)
    assert trace.counter_total.is_known


@pytest.mark.parametrize(
    "others", [{"plugged_h": [5000, 4000]}, {"plugged_h": [2, 10]}, {"sleep_cycles": [700, 3]}]
)
def test_a_length_that_falls_beside_another_or_may_be_reset_is_a_question(
    others: dict[str, list[float]],
) -> None:
    trace = series(DAY, **others, dispensed_mm=[104_000.0, 6_000.0])["dispensed_mm"]
    assert rules(trace) == ["fell"]


def test_a_length_wider_than_five_digits_rolls_over_later() -> None:
    trace = series(
        DAY, plugged_h=[5000, 5008], work_h=[3000, 3006], dispensed_mm=[104_000.0, 112_000.0]
    )["dispensed_mm"]
    assert (last(trace).kind, last(trace).is_known) == (DifferenceKind.NORMAL, True)


def test_several_that_fall_together_were_reset_or_are_a_hardly_used_unit() -> None:
    """A unit that had worked 15 h elsewhere shows the same: so what it shows is no lower bound."""
    traces = series(
        WEEK, plugged_h=[5000, 5040, 30], work_h=[3000, 3020, 20], sleep_cycles=[700, 800, 9]
    )
    assert {last(one).kind for one in traces.values()} == {DifferenceKind.FELL}
    work = last(traces["work_h"])
    assert (work.rule, work.is_known, work.delta) == ("fell", False, Interval(0, WEEK * 1.01))
    assert last(traces["sleep_cycles"]).delta == Interval(0, WEEK * 1.01 * 60)
    assert traces["work_h"].counter_total.total.low == 20 - 1
    assert "reset" in work.text.lower()


def test_what_is_lost_by_a_stated_reset_is_bounded() -> None:
    traces = series(
        WEEK,
        told(WEEK + 1, RESET),
        plugged_h=[5000, 5040, 30],
        work_h=[3000, 3020, 20],
        sleep_cycles=[2, 2, 40],
    )
    assert (last(traces["work_h"]).rule, last(traces["work_h"]).delta) == (
        "stated_reset",
        Interval(20, pytest.approx(21 + 1.01)),
    )
    assert last(traces["sleep_cycles"]).delta.low == 40


@pytest.mark.parametrize("port", [1, None])
def test_a_recorded_reset_of_a_port_leaves_its_neighbour_known(port: int | None) -> None:
    before = {"plugged_h": 5000, "work_h": 3000, "sleep_cycles": 2}
    after = {"plugged_h": 30, "work_h": 20, "sleep_cycles": 40}
    looks = [
        seen(0, {**before, "2.plugged_h": 9000, "2.work_h": 8000}),
        seen(WEEK, {**after, "2.plugged_h": 9040, "2.work_h": 8020}),
    ]
    assert last(traced(looks).now[2, "work_h"]).rule == "beside_what_cannot_be"
    now = traced(looks, [told(WEEK, RESET, port=port)]).now
    assert (last(now[1, "work_h"]).rule, last(now[1, "work_h"]).delta) == (
        "stated_reset",
        Interval(20, pytest.approx(21 + WEEK * 1.01 - 30)),
    )
    assert (last(now[1, "sleep_cycles"]).rule, last(now[1, "sleep_cycles"]).delta.low) == (
        "stated_reset",
        40,
    )
    assert last(now[2, "work_h"]).is_known


def test_a_recorded_reset_that_other_counters_rule_out_is_not_believed() -> None:
    traces = series(WEEK, told(2, RESET), plugged_h=[5000, 5040], work_h=[3000, 20])
    assert (last(traces["work_h"]).kind, last(traces["work_h"]).rule) == (
        DifferenceKind.FELL,
        "fell",
    )
    assert last(traces["plugged_h"]).rule == "beside_what_cannot_be"  # it may be another unit's


@pytest.mark.parametrize("unread", [False, True])
def test_a_possible_roll_over_beside_hours_that_cannot_be_is_no_lower_bound(unread: bool) -> None:
    """A feeder's box was exchanged without a record: the hours fell to what cannot be, the feeds to
    what a roll-over could be.
    """
    cycles = [60_000.0, None if unread else 16_105.0, 16_300.0]
    trace = series(
        WEEK, plugged_h=[9000, 6000, 6040], work_h=[3000, 3050, 3090], dispensed_cycles=cycles
    )["dispensed_cycles"]
    found = trace.differences[0]
    assert (found.rule, found.is_known, found.delta.low) == (
        "beside_what_cannot_be" if unread else "fell",
        False,
        0,
    )
    assert found.delta.high == pytest.approx((2 if unread else 1) * WEEK * 1.01 * 2000)


def test_an_exchange_seen_later_casts_doubt_on_the_looks_since_the_hours_were_read() -> None:
    """At the second look the hours that tell were not read, and the cycles happen to fit."""
    trace = series(WEEK, plugged_h=[9000, None, 6040], sleep_cycles=[700, 900, 950])["sleep_cycles"]
    assert [one.delta.low for one in trace.differences] == [0, 0]
    assert rules(trace) == ["beside_what_cannot_be"] * 2


def test_another_unit_that_answers_for_once_may_have_worked() -> None:
    """On loan for a week: the unit that comes back went on, but not all that was worked here is on
    it.
    """
    traces = series(
        WEEK, plugged_h=[5000, 9000, 5040], work_h=[3000, 7000, 3020], sleep_cycles=[700, 750, 800]
    )
    assert rules(traces["work_h"]) == ["faster_than_time", "fell"]
    assert [one.delta.low for one in traces["work_h"].differences] == [0, 0]
    assert [one.is_known for one in traces["sleep_cycles"].differences] == [False, False]


def test_a_reset_that_nothing_shows_is_not_ruled_out_and_bounds_both() -> None:
    """Nobody looked for half a year: all that is shown can have been counted since a reset."""
    trace = series(4380, plugged_h=[100, 900], work_h=[50, 450])["work_h"]
    assert (last(trace).kind, last(trace).rule, last(trace).is_known) == (
        DifferenceKind.NORMAL,
        "can_hide_reset",
        False,
    )
    assert last(trace).delta.low == 399
    assert last(trace).delta.high > 450


def test_half_a_year_unseen_is_known_where_hours_rule_a_reset_out() -> None:
    trace = series(4380, plugged_h=[9000, 9800], work_h=[5000, 5400], sleep_cycles=[2000, 6000])[
        "sleep_cycles"
    ]
    assert (last(trace).is_known, last(trace).delta) == (True, Interval(4000, 4000))


def test_unknown_roll_overs_between_audits_are_bounded() -> None:
    trace = series(
        4380, plugged_h=[9000, 12_000], work_h=[5000, 7400], dispensed_mm=[100_000.0, 20_000.0]
    )["dispensed_mm"]
    assert (last(trace).kind, last(trace).rule, last(trace).is_known) == (
        DifferenceKind.ROLL_OVER,
        "rolled_over_unknown_times",
        False,
    )
    assert last(trace).delta.low == pytest.approx(24_857.5)
    assert math.isfinite(last(trace).delta.high)


def test_of_a_history_that_is_traced_twice_the_first_pass_is_not_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    passes, alive, run = WeakSet[tracing._Pass](), list[int](), tracing._Pass.run

    def noted(one: tracing._Pass) -> None:
        alive.append(len(passes))
        passes.add(one)
        run(one)

    monkeypatch.setattr(tracing._Pass, "run", noted)
    series(4380, plugged_h=[9000, 12_000], work_h=[5000, 7400], dispensed_mm=[100_000.0, 20_000.0])
    assert alive == [0, 0]


def test_hours_that_are_more_than_time_are_impossible() -> None:
    traces = series(DAY, plugged_h=[5000, 5026], work_h=[3000, 3008])
    assert (last(traces["plugged_h"]).kind, last(traces["plugged_h"]).rule) == (
        DifferenceKind.IMPOSSIBLE,
        "faster_than_time",
    )
    assert last(traces["plugged_h"]).delta.low == 0
    assert last(traces["work_h"]).rule == "beside_what_cannot_be"


def test_one_hour_more_than_time_is_what_whole_hours_allow() -> None:
    assert last(series(DAY, plugged_h=[5000, 5025], work_h=[3000, 3008])["plugged_h"]).is_known


def test_at_its_last_number_it_may_have_stopped() -> None:
    trace = series(
        DAY,
        plugged_h=[5000, 5008, 5016],
        work_h=[3000, 3006, 3012],
        sleep_cycles=[99_990, 99_999, 99_999],
    )["sleep_cycles"]
    assert rules(trace) == ["stands_at_top", "stands_at_top"]
    assert {one.kind for one in trace.differences} == {DifferenceKind.SUSPECT}


def test_a_moving_counter_is_an_interval_and_the_next_reading_ends_it() -> None:
    trace = series(DAY, plugged_h=[5000, 5008, 5016], sleep_cycles=[700, (731, 732, 733), 760])[
        "sleep_cycles"
    ]
    assert trace.between(0, 1) == Interval(31, 33)
    assert (trace.counter_total.total, trace.counter_total.is_known) == (Interval(60, 60), True)


def test_an_unread_counter_is_skipped() -> None:
    trace = series(DAY, plugged_h=[5000, 5008, 5016], work_h=[3000, None, 3012])["work_h"]
    assert (len(trace.points), trace.counter_total.total, trace.counter_total.is_known) == (
        2,
        Interval(11, 13),
        True,
    )


def test_a_reset_while_a_counter_was_not_read_is_not_missed() -> None:
    shown = {"plugged_h": [5000, 30, 60], "work_h": [3000, 20, 40], "sleep_cycles": [3, None, 90]}
    sleep = last(series(WEEK, **shown)["sleep_cycles"])
    assert (sleep.rule, sleep.delta.low) == ("beside_what_cannot_be", 0)
    sleep = last(series(WEEK, told(2, RESET), **shown)["sleep_cycles"])
    assert (sleep.kind, sleep.delta.low) == (DifferenceKind.RESET, 90)


def test_a_jump_and_the_fall_after_it_are_bounded() -> None:
    trace = series(DAY, plugged_h=[5000, 5008, 5016, 5024], work_h=[3000, 3006, 3900, 3018])[
        "work_h"
    ]
    assert rules(trace) == ["went_on", "faster_than_time", "fell"]
    assert trace.counter_total.total.low <= 18 <= trace.counter_total.total.high
    assert not trace.counter_total.is_known


# -- another station -------------------------------------------------------------------------------

ONE = {"plugged_h": 5000, "work_h": 3000}
OTHER = {"plugged_h": 4100, "work_h": 2500}
LATER = {"plugged_h": 5008, "work_h": 3006}


@pytest.mark.parametrize(
    ("who", "shown", "rule"),
    [
        (replace(WHO, model="NAE"), LATER, "other_model"),
        (replace(WHO, software="9990000"), LATER, None),
        (WHO, LATER, None),
        (replace(WHO, software=None), LATER, None),
    ],
)
def test_another_station_begins_anew(
    who: object, shown: dict[str, float], rule: str | None
) -> None:
    looks = [
        seen(0, ONE),
        seen(DAY, shown, who),
        seen(2 * DAY, {name: value + 6 for name, value in shown.items()}, who),
    ]  # type: ignore[arg-type]
    found = traced(looks)
    odometer = found.now[1, "work_h"].counter_total
    assert [one.rule for one in odometer.marks] == ([rule] if rule else [])
    assert (odometer.since, odometer.first) == (
        (at(DAY), shown["work_h"]) if rule else (at(0), 3000)
    )


def test_other_software_with_counters_that_do_not_continue_is_a_question() -> None:
    """An update may reset the counters: it is no proof of another unit."""
    looks = [seen(0, ONE), seen(DAY, OTHER, replace(WHO, software="9990000"))]
    assert rules(traced(looks).now[1, "work_h"]) == ["fell"]


def test_a_number_of_its_own_tells_two_stations_apart() -> None:
    looks = [seen(0, ONE, replace(WHO, uid="a")), seen(DAY, LATER, replace(WHO, uid="b"))]
    assert [one.rule for one in traced(looks).now[1, "work_h"].counter_total.marks] == ["other_uid"]


# -- what people told ------------------------------------------------------------------------------


def test_a_stated_replacement_begins_anew() -> None:
    found = traced([seen(0, ONE), seen(DAY, LATER)], [told(5, REPLACED)])
    assert [one.rule for one in found.now[1, "work_h"].counter_total.marks] == ["stated_replaced"]


def test_a_stated_reset_narrows_what_is_lost() -> None:
    traces = series(WEEK, told(2, RESET), plugged_h=[5000, 90], work_h=[3000, 50])
    assert (last(traces["work_h"]).rule, last(traces["work_h"]).delta) == (
        "stated_reset",
        Interval(50, pytest.approx(53.02)),
    )


def test_a_stated_reset_is_not_believed_against_the_counters() -> None:
    traces = series(WEEK, told(2, RESET), plugged_h=[5000, 5040], work_h=[3000, 3020])
    assert last(traces["work_h"]).is_known


# -- clocks ----------------------------------------------------------------------------------------


def test_a_clock_that_was_set_back_is_in_doubt_until_a_later_audit() -> None:
    looks = [
        seen(hour, {"plugged_h": shown, "work_h": 3000})
        for hour, shown in ((0, 5000), (24, 5008), (-400, 5016))
    ]
    last_one = last(traced(looks).now[1, "plugged_h"])
    assert (last_one.kind, last_one.rule, last_one.delta.low) == (
        DifferenceKind.SUSPECT,
        "clock_ran_back",
        0,
    )
    looks.append(seen(72, {"plugged_h": 5024, "work_h": 3000}))
    trace = traced(looks).now[1, "plugged_h"]
    assert (trace.counter_total.total, trace.counter_total.is_known) == (Interval(23, 25), True)


def test_looks_whose_clock_was_wrong_are_bounded_by_those_beside() -> None:
    elapsed = Elapsed([0.0, 3600.0, 900_000.0, 7200.0, 10_800.0])
    assert [elapsed.is_right(look) for look in range(5)] == [True, True, False, True, True]
    assert (elapsed.at_most_h(1, 2), elapsed.at_most_h(2, 3), elapsed.at_most_h(0, 4)) == (
        1.0,
        1.0,
        3.0,
    )


def test_every_rule_has_a_sentence_that_is_no_longer_than_a_line() -> None:
    assert all(text.endswith(".") and len(text) < 130 for text in RULES.values())
