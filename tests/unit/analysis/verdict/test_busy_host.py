"""What the computer skipped breaks no limit; limits in per cent have the run's resolution."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from jbclog.analysis.verdict import Result, Rule, Verdict, judge
from jbclog.analysis.verdict.rule import allowed_misses
from jbclog.config.recipe_sections import Acceptance


def rule(case: Any, name: str, limits: Acceptance) -> Rule:
    return next(one for one in judge(case.evidence(), {"a": limits}).rules if one.name == name)


def coverage(case: Any, least: float) -> Result:
    return rule(case, "coverage", Acceptance(coverage_percent=least)).result


@pytest.mark.parametrize(
    ("due", "percent", "allowed"),
    [
        (194, 99.5, 1),
        (200, 99.5, 1),
        (201, 99.5, 2),
        (194, 100.0, 0),
        (1000, 99.5, 5),
        (1000, 0.0, 1000),
        (10_000, 99.9, 10),
    ],
)
def test_how_many_may_be_missing(due: int, percent: float, allowed: int) -> None:
    assert allowed_misses(due, percent) == allowed


def test_one_reading_of_194_does_not_fail_99_and_a_half(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(19.4).lose(5, 0.1))
    assert coverage(case, 99.5) is Result.PASS
    assert coverage(case, 100.0) is Result.FAIL
    seen = rule(case, "coverage", Acceptance(coverage_percent=99.5))
    assert (
        seen.text
        == "Tip temperature coverage 99.48 % (193 of 194), required 99.5 %. One reading is 0.52 %:"
        " within the resolution."
    )


def test_two_do(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(19.4).lose(5, 0.2))
    assert coverage(case, 99.5) is Result.FAIL


def test_one_of_a_few_is_too_much_to_let_pass_and_too_little_to_reject(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip(1.9).lose(1, 0.1))
    assert coverage(case, 99.5) is Result.MISSING


def test_what_the_computer_skipped_is_missing_evidence_and_no_reject(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip(60).skip(20, 0.6))
    limits = Acceptance(coverage_percent=99.5)
    seen = rule(case, "coverage", limits)
    assert seen.result is Result.MISSING
    assert (
        seen.text
        == "Tip temperature coverage 99 % (594 of 600), required 99.5 %. The recorder was too late"
        " for 6 of them (busy or stopped). Their values are not known; less load on the"
        " computer, or a lower rate, helps."
    )
    assert judge(case.evidence(), {"a": limits}).verdict is Verdict.INCONCLUSIVE


def test_what_the_link_lost_is_a_reject_whatever_the_computer_skipped(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip(60).skip(20, 0.6).lose(30, 0.4))
    seen = rule(case, "coverage", Acceptance(coverage_percent=99.5))
    assert seen.result is Result.FAIL
    assert "too late for 6 of them" in seen.text


def test_both_together_are_missing_where_each_alone_would_be_kept(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip(60).skip(20, 0.2).lose(30, 0.3))
    assert coverage(case, 99.5) is Result.MISSING


def test_ticks_that_the_station_made_late_are_not_the_computers(
    case: Any, tip: Callable[..., Any]
) -> None:
    facts = case.station("a", tip(60).skip(20, 0.6))
    facts.skipped_by_host = 0
    assert coverage(case, 99.5) is Result.FAIL
    facts.skipped_by_host = 4
    assert coverage(case, 99.5) is Result.MISSING


def test_a_gap_that_the_computer_made_is_no_reject(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(60).skip(20, 4).lose(24, 0.5))
    seen = rule(case, "longest_gap", Acceptance(longest_gap_s=3))
    assert seen.result is Result.MISSING
    assert (
        seen.text
        == "Longest gap in temperature 4.6 s, allowed 3 s and a period of 0.1 s. The recorder was"
        " too late for some readings (busy or stopped); without these it is 0.6 s."
    )
    assert rule(case, "longest_gap", Acceptance(longest_gap_s=0.4)).result is Result.FAIL


def test_nor_one_in_which_it_stood_still_and_left_no_rows(
    case: Any, tip: Callable[..., Any]
) -> None:
    facts = case.station("a", tip(30))
    case.seal([("a", 1, tip(30).lose(0, 1))], first_tick=380)
    facts.skipped, facts.last_tick = 80, 679
    seen = rule(case, "longest_gap", Acceptance(longest_gap_s=5))
    assert (seen.result, seen.observed) == (Result.MISSING, 9.1)
    assert "without these it is 1.1 s" in seen.text
    facts.skipped = 0  # nobody stood still: rows are missing
    assert rule(case, "longest_gap", Acceptance(longest_gap_s=5)).result is Result.FAIL


def test_a_busy_computer_alone_is_no_deviation(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(60).skip(20, 0.2))
    case.event("host.busy", "warning", "a", text="The computer was busy.")
    assert judge(case.evidence(), {"a": Acceptance(coverage_percent=99)}).verdict is Verdict.ACCEPT
