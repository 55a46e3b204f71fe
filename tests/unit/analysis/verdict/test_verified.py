"""The rule `verification_days`: what a run stood on when it began."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from jbclog.analysis.verdict import judge
from jbclog.config.recipe_sections import Acceptance
from jbclog.core.rows import TipCheck

DAYS = Acceptance(verification_days=30)


def check(state: str = "pass", days: float = 3.0, port: int = 1) -> TipCheck:
    return TipCheck(
        "a",
        port,
        state,
        "Its own sentence.",
        "2026-11-18T08:00:00.000000Z",
        days,
        "T-17",
        "TC-7",
        2.4,
        15.0,
        3.0,
        1,
        "0",
    )


@pytest.mark.parametrize(
    ("checks", "result", "verdict"),
    [
        ([check()], "pass", "ACCEPT"),
        ([check(days=30.0)], "pass", "ACCEPT"),
        ([check(days=30.01)], "missing", "INCONCLUSIVE"),
        ([check("fail")], "fail", "REJECT"),
        ([check("fail", 99.0)], "fail", "REJECT"),
        ([check("other tip")], "missing", "INCONCLUSIVE"),
        ([TipCheck("a", 1, "none", "None is known.")], "missing", "INCONCLUSIVE"),
        ([TipCheck("a", 1, "unreadable", "It cannot be read.")], "missing", "INCONCLUSIVE"),
        ([check(port=2)], "missing", "INCONCLUSIVE"),
        ([], "missing", "INCONCLUSIVE"),
    ],
)
def test_only_one_that_passed_lately_is_good_enough(
    case: Any, tip: Callable[..., Any], checks: list[TipCheck], result: str, verdict: str
) -> None:
    case.station("a", tip())
    judgement = judge(replace(case.evidence(), verifications=checks), {"a": DAYS})
    (rule,) = [one for one in judgement.rules if one.name == "verification"]
    assert (rule.result, judgement.verdict, rule.limit_value, rule.uom) == (
        result,
        verdict,
        30,
        "d",
    )
    assert rule.text.endswith(".")


def test_who_does_not_ask_for_it_is_not_judged_by_it(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    judgement = judge(
        replace(case.evidence(), verifications=[check("fail")]),
        {"a": Acceptance(alarms_max=0, idle_error_c=15)},
    )
    assert "verification" not in {rule.name for rule in judgement.rules}


@pytest.mark.parametrize(
    ("readback", "result"),
    [("3", "pass"), ("0", "missing"), ("-3", "missing"), (None, "pass"), ("?", "pass")],
)
def test_one_that_was_made_with_another_adjustment_says_nothing_of_the_run(
    case: Any, tip: Callable[..., Any], readback: str | None, result: str
) -> None:
    case.station("a", tip())
    case.setting_rows.append(
        {"station": "a", "port": 1, "setting": "adjust", "readback": readback, "outcome": "read"}
    )
    case.setting_rows.append(
        {"station": "a", "port": 2, "setting": "adjust", "readback": "9", "outcome": "read"}
    )
    judgement = judge(replace(case.evidence(), verifications=[check()]), {"a": DAYS})
    (rule,) = [one for one in judgement.rules if one.name == "verification"]
    assert rule.result == result
