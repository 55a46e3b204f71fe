"""Whether the tool came to its temperature: the rule `reached`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from jbclog.analysis.verdict import Result, Rule, Verdict, judge
from jbclog.config.recipe_sections import Acceptance

LIMITS = Acceptance(coverage_percent=90)


def reached(case: Any, limits: Acceptance = LIMITS, port: int = 1) -> Rule:
    rules = [
        rule
        for rule in judge(case.evidence(), {"a": limits}).rules
        if (rule.name, rule.port) == ("reached", port)
    ]
    assert len(rules) == 1
    return rules[0]


def verdict(case: Any, limits: Acceptance = LIMITS) -> Verdict:
    return judge(case.evidence(), {"a": limits}).verdict


def cold(tip: Any, status: str | None = "stand", seconds: float = 60.0) -> Any:
    one = tip(seconds)
    one.temperature = [23] * len(one.temperature)
    one.status = [status] * len(one.temperature)
    return one


def heating(tip: Any, seconds: float, c_per_s: float) -> Any:
    one = tip(seconds)
    one.temperature = [min(350, round(23 + c_per_s * i / 10)) for i in range(len(one.temperature))]
    return one


def test_a_cold_tip_without_an_order_to_work_is_never_accepted(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", cold(tip))
    case.ask("a", None)
    rule = reached(case)
    assert (rule.result, rule.observed) == (Result.MISSING, "not at work")
    assert (
        rule.text
        == "The recipe sets a temperature but has no [run] status: the tool was not ordered to work"
        " and was not at work; maximum 23 °C."
    )
    assert verdict(case) is Verdict.INCONCLUSIVE


def test_nor_one_that_was_ordered_to_stand(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", cold(tip))
    case.ask("a", "stand", 1)
    assert 'status = "stand"' in reached(case).text
    assert verdict(case) is Verdict.INCONCLUSIVE


def test_one_that_was_ordered_to_work_and_stays_cold_is_rejected(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", cold(tip, "working"))
    case.ask("a", "working", 1)
    rule = reached(case)
    assert (rule.result, rule.observed) == (Result.FAIL, "not reached")
    assert (
        rule.text
        == "In 60.0 s at work, the tool did not come within 10 °C of 350 °C; nearest 23 °C."
    )
    assert verdict(case) is Verdict.REJECT


def test_one_that_was_ordered_to_work_and_sleeps_at_once_is_rejected(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", cold(tip, "sleep"))
    case.ask("a", "working", 1)
    assert verdict(case) is Verdict.REJECT


def test_one_that_arrives_is_accepted_and_says_when(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", heating(tip, 60, 20.0))
    case.ask("a", "working", 1)
    rule = reached(case)
    assert (rule.result, rule.limit_value, rule.observed, rule.uom) == (
        Result.PASS,
        80.0,
        100.0,
        "%",
    )
    assert (
        rule.text
        == "Reached 350 °C after 15.9 s; at work for 100 % of the time since, required 80 %."
    )
    assert verdict(case) is Verdict.ACCEPT


def test_one_that_was_at_work_by_itself_needs_no_order(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    case.ask("a", None)
    assert verdict(case) is Verdict.ACCEPT


def test_nine_degrees_short_is_there_and_eleven_are_not_unless_the_recipe_says_so(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip().at(0, 60, 339, 60))
    case.ask("a", "working", 1)
    assert reached(case).result is Result.FAIL
    assert reached(case, Acceptance(coverage_percent=90, reached_within_c=11)).result is Result.PASS


def test_the_band_is_kept_to_its_edge(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip().at(0, 60, 340, 60))
    case.ask("a", "working", 1)
    assert reached(case).result is Result.PASS


def test_one_that_leaps_over_its_setting_between_two_readings_was_there(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip().at(0, 5, 300, 900).at(5, 55, 375, 0))
    case.ask("a", "working", 1)
    assert reached(case).result is Result.PASS


def test_a_tool_that_is_hot_and_not_at_work_has_not_arrived(
    case: Any, tip: Callable[..., Any]
) -> None:
    one = tip()
    one.status = ["stand"] * len(one.status)
    case.station("a", one)
    case.ask("a", None)
    assert reached(case).result is Result.MISSING


def test_a_tip_in_its_extractor_is_not_at_work(case: Any, tip: Callable[..., Any]) -> None:
    """Status 00010: the state in which tools leave the factory (manual 002, "Tool Operating
    Status").
    """
    one = cold(tip, "working")
    one.extractor = True
    facts = case.station("a", one)
    case.ask("a", None)
    assert (reached(case).result, reached(case).observed) == (Result.MISSING, "not at work")
    facts.family = "jtse"  # whose tens digit is something else
    assert reached(case).result is Result.FAIL


# -- time ------------------------------------------------------------------------------------------


def test_a_run_that_ends_while_the_tool_heats_is_no_reject(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", heating(tip, 30, 5.0))
    case.ask("a", "working", 1)
    rule = reached(case)
    assert rule.result is Result.MISSING
    assert "still approaching" in rule.text


def test_one_that_stopped_on_its_way_is(case: Any, tip: Callable[..., Any]) -> None:
    one = heating(tip, 120, 5.0)
    one.temperature = [min(200, value) for value in one.temperature]
    case.station("a", one)
    case.ask("a", "working", 1)
    assert "nearest 200 °C" in reached(case).text
    assert verdict(case) is Verdict.REJECT


def test_a_run_of_seconds_is_too_short_to_say(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", cold(tip, "working", 5.0))
    case.ask("a", "working", 1)
    assert "too short" in reached(case).text
    assert verdict(case) is Verdict.INCONCLUSIVE


def test_a_run_of_seconds_in_which_it_arrives_is_enough(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", heating(tip, 5, 100.0))
    case.ask("a", "working", 1)
    assert verdict(case) is Verdict.ACCEPT


# -- for how long ----------------------------------------------------------------------------------


def asleep(tip: Any, from_s: float) -> Any:
    one = tip()
    one.status = ["working" if i < from_s * 10 else "sleep" for i in range(len(one.status))]
    return one


@pytest.mark.parametrize(
    ("from_s", "told", "found"), [(49, True, "pass"), (47, True, "fail"), (47, False, "missing")]
)
def test_a_tool_that_the_station_sends_to_sleep_is_not_at_work(
    case: Any, tip: Callable[..., Any], from_s: float, told: bool, found: str
) -> None:
    case.station("a", asleep(tip, from_s))
    case.ask("a", "working" if told else None, *([1] if told else []))
    rule = reached(case)
    assert rule.result == found
    assert rule.observed == pytest.approx(from_s / 0.6)


def test_the_share_is_the_recipes(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", asleep(tip, 30))
    case.ask("a", "working", 1)
    assert reached(case, Acceptance(coverage_percent=90, at_work_percent=50)).result is Result.PASS
    assert reached(case, Acceptance(coverage_percent=90, at_work_percent=52)).result is Result.FAIL


def test_no_tool_has_to_work_if_the_recipe_requires_no_time(
    case: Any, tip: Callable[..., Any]
) -> None:
    """As at a rework place, where the operator's hand decides; a tool that is taken has to arrive
    all the same.
    """
    limits = Acceptance(coverage_percent=90, at_work_percent=0)
    case.station("a", cold(tip), cold(tip, "working"))
    case.ask("a", "stand", 1, 2, heated=(1, 2))
    assert reached(case, limits).result is Result.NOT_APPLICABLE
    assert reached(case, limits, port=2).result is Result.FAIL


def test_what_was_not_read_is_neither_at_work_nor_not(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip().lose(10, 20))
    case.ask("a", "working", 1)
    rule = reached(case, Acceptance(coverage_percent=1))
    assert rule.result is Result.MISSING
    assert "Not known for 33.33 % of it" in rule.text


def test_ticks_without_rows_count_as_not_known(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip(), skipped=300)
    case.ask("a", "working", 1)
    rule = reached(case, Acceptance(coverage_percent=1))
    assert (rule.result, rule.observed) == (Result.MISSING, pytest.approx(100 * 600 / 900))


def test_nothing_read_at_all_is_no_evidence(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip().lose(0, 60))
    case.ask("a", "working", 1)
    assert reached(case).result is Result.MISSING


# -- changes ---------------------------------------------------------------------------------------


def with_tool(one: Any, from_s: float, code: int) -> Any:
    one.tool = [
        code if i >= from_s * 10 and value is not None else value
        for i, value in enumerate(one.tool)
    ]
    return one


def test_another_tool_has_to_arrive_too(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", with_tool(tip().at(30, 30, 23, 900), 30, 4))
    case.ask("a", "working", 1)
    rule = reached(case)
    assert rule.result is Result.FAIL
    assert rule.text.startswith(
        "Tool or setpoint changed; in 30 s at work since then, the tool did not come within 10 °C"
        " of 350 °C"
    )


def test_another_tool_that_arrives_or_is_there_for_seconds_only_is_fine(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station(
        "a",
        with_tool(tip().at(30, 5, 100, 900), 30, 4),
        with_tool(tip().at(55, 5, 100, 900), 55, 4),
    )
    case.ask("a", "working", 1, 2, heated=(1, 2))
    assert [reached(case, port=port).result for port in (1, 2)] == [Result.PASS, Result.PASS]


def test_another_setting_has_to_be_reached_too(case: Any, tip: Callable[..., Any]) -> None:
    """With on_difference = "continue" a setting may change while the run goes on."""
    one = tip()
    one.setting = [
        400 if value is not None and i >= 300 else value for i, value in enumerate(one.setting)
    ]
    case.station("a", one)
    case.ask("a", "working", 1)
    assert "did not come within 10 °C of 400 °C" in reached(case).text


# -- whom it is about ------------------------------------------------------------------------------


def test_a_recipe_that_sets_no_temperature_is_not_asked(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", cold(tip))
    case.ask("a", None, heated=())
    assert [
        rule.name for rule in judge(case.evidence(), {"a": LIMITS}).rules if rule.name == "reached"
    ] == []
    assert verdict(case) is Verdict.ACCEPT
    # it names the limit itself
    assert reached(case, Acceptance(at_work_percent=50)).result is Result.MISSING


def test_no_limits_no_verdict(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", cold(tip))
    case.ask("a", None)
    assert judge(case.evidence(), {"a": None}).verdict is Verdict.NOT_JUDGED


def test_a_port_whose_tool_came_later_was_not_ordered_to_work(
    case: Any, tip: Callable[..., Any]
) -> None:
    """With require_tool = false an empty port is never put to work; a tool that is put in later
    stays as it is.
    """
    case.station("a", tip(), cold(tip))
    case.ask("a", "working", 1, heated=(1, 2))
    assert [reached(case, port=port).result for port in (1, 2)] == [Result.PASS, Result.MISSING]


def test_a_station_without_a_temperature_is_not_asked(case: Any, tip: Callable[..., Any]) -> None:
    facts = case.station("a", tip())
    facts.family, facts.signals = "omega", ["power_permille"]  # anything but a temperature
    case.ask("a", None)
    assert reached(case).result is Result.NOT_APPLICABLE


def test_hot_air_is_at_work_when_it_is_on(case: Any, tip: Callable[..., Any]) -> None:
    one = tip()
    one.status = ["on"] * len(one.status)
    facts = case.station("a", one)
    facts.family = "jtse"
    case.ask("a", "on", 1)
    assert verdict(case) is Verdict.ACCEPT
