"""Many rules in a few lines: who was worst, and that no failure hides behind those who passed."""

from __future__ import annotations

from jbclog.analysis.verdict import Result, Rule
from jbclog.report.verdict import FEW, summary


def rules(
    name: str, observed: list[float | None], limit: float = 99.5, unit: str = "%"
) -> list[dict[str, object]]:
    results = [
        Result.MISSING if one is None else Result.PASS if one >= limit else Result.FAIL
        for one in observed
    ]
    return [
        Rule(name, f"dde-{i}", 1, limit, one, unit, result, "x.").as_dict()
        for i, (one, result) in enumerate(zip(observed, results, strict=True))
    ]


def test_few_rules_need_no_summary() -> None:
    assert summary(rules("coverage", [100.0] * FEW)) == []


def test_the_worst_is_named_and_a_failure_is_the_result() -> None:
    lines = summary(rules("coverage", [100.0, 98.0, *[99.9] * 20]))
    assert lines == [
        {
            "name": "coverage",
            "limit_value": 99.5,
            "uom": "%",
            "kept": 21,
            "of": 22,
            "worst": 98.0,
            "bound": None,
            "station": "dde-1",
            "port": 1,
            "result": "fail",
        }
    ]


def test_the_worst_of_a_distance_is_the_furthest_either_way() -> None:
    lines = summary(
        [
            rule | {"result": "pass"}
            for rule in rules("idle_error", [1.0, -14.0, *[3.0] * 20], 15, "°C")
        ]
    )
    assert (lines[0]["worst"], lines[0]["station"], lines[0]["result"]) == (-14, "dde-1", "pass")


def test_what_is_missing_is_neither_passed_nor_worst() -> None:
    lines = summary(rules("coverage", [None, *[100.0] * 20]))
    assert (lines[0]["kept"], lines[0]["worst"], lines[0]["result"]) == (20, 100, "missing")
    assert summary(rules("coverage", [None] * 20))[0]["worst"] is None


def test_other_limits_are_other_lines() -> None:
    assert [
        line["of"]
        for line in summary([*rules("coverage", [100.0] * 10), *rules("coverage", [100.0] * 5, 90)])
    ] == [10, 5]


def test_nobody_is_named_where_all_are_alike() -> None:
    lines = summary(rules("coverage", [100.0] * 20))
    assert (lines[0]["worst"], lines[0]["station"], lines[0]["port"]) == (100, None, None)
