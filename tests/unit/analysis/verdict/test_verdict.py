"""The verdict: what makes a run accepted, and that missing evidence never does."""

from __future__ import annotations

import json
import subprocess
import sys
import zoneinfo
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from jbclog.analysis.verdict import Result, Rule, Verdict, evidence, judge
from jbclog.analysis.verdict.verdict import verdict_of
from jbclog.config.recipe_sections import Acceptance

ALL = Acceptance(coverage_percent=99.5, longest_gap_s=5, idle_error_c=15, idle_sd_c=5, alarms_max=0)
SECONDS = 303.0


@pytest.fixture
def tip(tip: Callable[..., Any]) -> Callable[..., Any]:
    """One that rests long enough for a bound of its idle error."""
    return partial(tip, SECONDS)


def rule(judgement: Any, name: str, port: int | None = 1) -> Rule:
    return next(one for one in judgement.rules if one.name == name and one.port == port)


def test_a_clean_run_is_accepted_and_every_rule_is_written_down(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip())
    case.setting("a", "confirmed")
    case.setting("a", "unchanged")
    judgement = judge(case.evidence(), {"a": ALL})
    assert judgement.verdict == "ACCEPT"
    names = [one.name for one in judgement.rules]
    assert names == [
        "record",
        "station",
        "settings",
        "alarms",
        "coverage",
        "longest_gap",
        "idle_error",
        "idle_sd",
    ]
    assert rule(judgement, "coverage").observed == 100
    assert rule(judgement, "settings", None).observed == "2 of 2"
    assert all(one.text.endswith(".") for one in judgement.rules)
    again = json.loads(json.dumps(judgement.rules_as_dicts()))
    assert again[4] == {
        "name": "coverage",
        "station": "a",
        "port": 1,
        "limit_value": 99.5,
        "observed": 100.0,
        "uom": "%",
        "result": "pass",
        "text": "Tip temperature coverage 100 % (3030 of 3030), required 99.5 %.",
        "bound": None,
    }


@pytest.mark.parametrize("acceptance", [{}, {"a": None}, {"a": Acceptance()}])
def test_without_limits_nothing_is_judged(
    case: Any, tip: Callable[..., Any], acceptance: dict[str, Acceptance | None]
) -> None:
    case.station("a", tip().lose(10, 40))
    judgement = judge(case.evidence(), acceptance)
    assert judgement.verdict == "NOT JUDGED"
    assert judgement.rules == ()


def test_a_broken_limit_rejects_and_outweighs_missing_evidence(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip().lose(10, 6))
    case.exit_status = "lost"
    judgement = judge(case.evidence(), {"a": ALL})
    assert judgement.verdict == "REJECT"
    assert rule(judgement, "coverage").result is Result.FAIL
    assert rule(judgement, "longest_gap").observed == 6.1
    assert rule(judgement, "record", None).result is Result.MISSING


@pytest.mark.parametrize(
    ("results", "verdict"),
    [
        ([], Verdict.INCONCLUSIVE),
        ([Result.DEVIATION], Verdict.INCONCLUSIVE),
        ([Result.PASS], Verdict.ACCEPT),
        ([Result.PASS, Result.DEVIATION], Verdict.WITH_DEVIATIONS),
        ([Result.PASS, Result.DEVIATION, Result.MISSING], Verdict.INCONCLUSIVE),
        ([Result.PASS, Result.MISSING, Result.FAIL], Verdict.REJECT),
    ],
)
def test_truth_table(results: list[Result], verdict: Verdict) -> None:
    assert (
        verdict_of([Rule("x", None, None, None, None, "", result, "") for result in results])
        is verdict
    )


@pytest.mark.parametrize(
    ("exit_status", "verdict"),
    [
        ("success", "ACCEPT"),
        ("aborted", "ACCEPT WITH DEVIATIONS"),
        ("failed", "ACCEPT WITH DEVIATIONS"),
        ("lost", "INCONCLUSIVE"),
        (None, "INCONCLUSIVE"),
    ],
)
def test_how_the_run_ended(
    case: Any, tip: Callable[..., Any], exit_status: str | None, verdict: str
) -> None:
    case.station("a", tip())
    case.exit_status = exit_status
    assert judge(case.evidence(), {"a": ALL}).verdict == verdict


@pytest.mark.parametrize(
    ("outcome", "verdict"),
    [
        ("completed", "ACCEPT"),
        ("stopped", "REJECT"),
        ("refused", "INCONCLUSIVE"),
        ("gone", "INCONCLUSIVE"),
        ("failed", "INCONCLUSIVE"),
        ("running", "INCONCLUSIVE"),
    ],
)
def test_how_the_station_ended(
    case: Any, tip: Callable[..., Any], outcome: str, verdict: str
) -> None:
    case.station("a", tip(), outcome=outcome)
    assert judge(case.evidence(), {"a": ALL}).verdict == verdict


def test_the_rule_of_a_station_has_the_reason_of_its_end(
    case: Any, tip: Callable[..., Any]
) -> None:
    facts = case.station("a", tip(), outcome="gone")
    facts.reason = "a: no answer within 3 s"
    found = rule(judge(case.evidence(), {"a": ALL}), "station", None)
    assert found.text == "No answer at the end. No answer within 3 s."
    facts.first_tick = None
    found = rule(judge(case.evidence(), {"a": ALL}), "station", None)
    assert found.text == "The station never answered. No answer within 3 s."


@pytest.mark.parametrize(
    ("outcome", "result"),
    [("gone", "missing"), ("refused", "missing"), ("running", "missing"), ("completed", "pass")],
)
def test_a_station_never_reached_says_nothing_of_the_recipes_settings(
    case: Any, tip: Callable[..., Any], outcome: str, result: str
) -> None:
    case.station("a", tip(), outcome=outcome).first_tick = None
    assert rule(judge(case.evidence(), {"a": ALL}), "settings", None).result == result


def test_a_record_that_lacks_something_is_inconclusive(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    evidence = replace(case.evidence(), lost="The disk was full for 4 s.")
    judgement = judge(evidence, {"a": ALL})
    assert judgement.verdict == "INCONCLUSIVE"
    assert rule(judgement, "record", None).text == "The disk was full for 4 s."


@pytest.mark.parametrize(
    ("outcome", "result"),
    [
        ("mismatch", "fail"),
        ("refused", "fail"),
        ("unconfirmed", "missing"),
        ("unsupported", "deviation"),
        ("read", "pass"),
    ],
)
def test_settings_must_be_read_back(
    case: Any, tip: Callable[..., Any], outcome: str, result: str
) -> None:
    case.station("a", tip())
    case.setting("a", "confirmed")
    case.setting("a", outcome)
    assert rule(judge(case.evidence(), {"a": ALL}), "settings", None).result == result


def test_what_the_station_does_not_know_is_named_and_is_a_deviation(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip())
    case.setting("a", "confirmed")
    for _port in (1, 2):
        case.setting("a", "unsupported", "selected_temperature", "300")
    judgement = judge(case.evidence(), {"a": ALL})
    settings = rule(judgement, "settings", None)
    assert judgement.verdict == "ACCEPT WITH DEVIATIONS"
    assert settings.observed == "1 of 3"
    assert settings.text.count("selected temperature") == 1
    assert "Every setting" not in settings.text


def test_what_the_recipe_asks_of_other_families_is_no_deviation(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip())
    case.setting("a", "confirmed")
    case.setting("a", "unsupported", "feeder_length", None)
    judgement = judge(case.evidence(), {"a": ALL})
    assert judgement.verdict == "ACCEPT"
    assert rule(judgement, "settings", None).observed == "1 of 1"


def test_a_station_that_never_answered_is_inconclusive(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    facts = case.station("b", tip(), outcome="gone")
    facts.ports.clear()
    case.ledger.pop("b")
    judgement = judge(case.evidence(), {"a": ALL, "b": ALL, "c": ALL})
    assert judgement.verdict == "INCONCLUSIVE"
    assert {one.station for one in judgement.rules if one.result is Result.MISSING} == {"b", "c"}


def test_a_run_without_tables_is_inconclusive(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    evidence = case.evidence()
    for part in case.folder.glob("*/*.parquet"):
        part.unlink()
    assert judge(evidence, {"a": ALL}).verdict == "INCONCLUSIVE"


def test_samples_that_disagree_with_the_ledger_are_no_evidence(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip())
    case.ledger["a"]["1"]["temperature_c"]["ok"] -= 1
    found = rule(judge(case.evidence(), {"a": ALL}), "coverage")
    assert found.result is Result.MISSING
    assert "3029" in found.text
    assert "3030" in found.text


def test_counted_alarms(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    case.event("alarm.high", "error", "a", 1)
    case.event("alarm.low", "error", "a", 1)
    case.event("alarm.before_run", "info", "a", 1)
    case.event("alarm.high.not_working", "info", "a", 1)
    case.event("alarm.high", "error", "b", 1)
    assert rule(judge(case.evidence(), {"a": ALL}), "alarms", None).observed == 2
    assert judge(case.evidence(), {"a": ALL}).verdict == "REJECT"
    assert judge(case.evidence(), {"a": Acceptance(alarms_max=2)}).verdict == "ACCEPT"


def test_flags_that_were_never_read_are_no_evidence_of_no_alarm(
    case: Any, tip: Callable[..., Any]
) -> None:
    case.station("a", tip())
    case.ledger["a"]["1"]["alarm_high"] = {"due": 30, "ok": 0, "timeout": 30}
    found = rule(judge(case.evidence(), {"a": ALL}), "alarms", None)
    assert found.result is Result.MISSING
    assert found.observed is None


@pytest.mark.parametrize(
    ("kind", "severity", "verdict"),
    [
        ("alarm.unconfirmed", "warning", "ACCEPT WITH DEVIATIONS"),
        ("alarm.unknown", "warning", "ACCEPT WITH DEVIATIONS"),
        ("link.lost", "critical", "ACCEPT WITH DEVIATIONS"),
        ("setting.changed", "error", "ACCEPT WITH DEVIATIONS"),
        ("safety.no_cooldown", "warning", "ACCEPT WITH DEVIATIONS"),
        ("station.error", "error", "ACCEPT WITH DEVIATIONS"),
        ("something.new", "critical", "ACCEPT WITH DEVIATIONS"),
        ("station.error", "warning", "ACCEPT"),
        ("link.back", "info", "ACCEPT"),
        ("run.end", "error", "ACCEPT"),
    ],
)
def test_the_verdict_lists_what_is_not_as_planned(
    case: Any, tip: Callable[..., Any], kind: str, severity: str, verdict: str
) -> None:
    case.station("a", tip())
    for _ in range(3):
        case.event(kind, severity, "a", 1, "As it was.")
    judgement = judge(case.evidence(), {"a": ALL})
    assert judgement.verdict == verdict
    if verdict != "ACCEPT":
        assert rule(judgement, kind).observed == 3
        assert rule(judgement, kind).text.startswith("As it was.")


def at(seconds: int) -> dict[str, object]:
    """The time of an event: that many seconds after the start of the run."""
    return {"time": 1_000_000 * (1_790_000_000 + seconds)}


@pytest.mark.parametrize(
    ("after", "text"),
    [
        ([], "This was at 2026-09-21 14:13:25 UTC; the station was not back when sampling ended."),
        (
            [("link.back", 9, 4.25)],
            "This was at 2026-09-21 14:13:25 UTC; the station was back after 4.2 s.",
        ),
        (
            [("link.back", 9, 4.25), ("link.lost", 20, None), ("link.back", 30, 10.0)],
            "This was first at 2026-09-21 14:13:25 UTC; the station was back after 14.2 s in all.",
        ),
        (
            [("link.back", 9, 4.25), ("link.lost", 20, None)],
            "This was first at 2026-09-21 14:13:25 UTC; the station was back after 4.2 s, but not"
            " when sampling ended.",
        ),
        (
            [
                *[("link.back", 9, 4.0), ("link.lost", 20, None), ("link.back", 30, 10.0)],
                ("link.lost", 40, None),
            ],
            "This was first at 2026-09-21 14:13:25 UTC; the station was back after 14.0 s in all,"
            " but not when sampling ended.",
        ),
    ],
    ids=["never", "once", "twice", "not-the-second-time", "not-the-third-time"],
)
def test_an_outage_says_when_it_was_and_whether_the_station_came_back(
    case: Any, tip: Callable[..., Any], after: list[tuple[str, int, float | None]], text: str
) -> None:
    """The events of another station do not count: `b` comes back, whatever `a` does."""
    case.station("a", tip())
    case.station("b", tip())
    case.event("link.lost", "error", "a", text="It cannot be reached.", **at(5))
    case.event("link.back", "info", "b", value=1.0, **at(6))
    for kind, second, value in after:
        severity = "info" if value else "error"
        case.event(kind, severity, "a", text="As it was.", value=value, **at(second))
    found = rule(judge(case.evidence(), {"a": ALL, "b": ALL}), "link.lost", None)
    assert found.text == f"It cannot be reached. {text}"
    assert found.observed == 1 + sum(kind == "link.lost" for kind, *_ in after)


@pytest.mark.parametrize(
    ("kind", "back"), [("link.flooded", "link.back"), ("robot.off", "robot.on")]
)
def test_each_kind_of_outage_says_that_the_station_came_back(
    case: Any, tip: Callable[..., Any], kind: str, back: str
) -> None:
    case.station("a", tip())
    case.event(kind, "error", "a", text="As it was.", **at(5))
    case.event(back, "info", "a", value=2.0, **at(7))
    text = rule(judge(case.evidence(), {"a": ALL}), kind, None).text
    assert text.endswith("; the station was back after 2.0 s.")


def test_a_computer_without_time_zones_judges_too(
    case: Any, tip: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a small container; pyarrow looks for UTC among them before it makes a datetime."""

    def missing(name: str) -> None:
        raise zoneinfo.ZoneInfoNotFoundError(name)

    monkeypatch.setattr(zoneinfo, "ZoneInfo", missing)
    case.station("a", tip())
    case.event("link.lost", "error", "a", **at(5))
    text = rule(judge(case.evidence(), {"a": ALL}), "link.lost", None).text
    assert "at 2026-09-21 14:13:25 UTC" in text


def test_a_port_without_a_tool_is_named_and_not_judged(case: Any, tip: Callable[..., Any]) -> None:
    facts = case.station("a", tip(), tip().lose(0, SECONDS))
    facts.touched = [1]
    case.ledger["a"]["2"] = {"temperature_c": {"due": 600, "ok": 0, "no_tool": 600}}
    judgement = judge(case.evidence(), {"a": ALL})
    assert judgement.verdict == "ACCEPT WITH DEVIATIONS"
    assert [one.name for one in judgement.rules if one.port == 2] == ["no_tool"]
    facts.ports = [2]
    assert judge(case.evidence(), {"a": ALL}).verdict == "INCONCLUSIVE"


def test_a_station_without_limits_beside_one_with(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip())
    case.station("b", tip().lose(0, 30))
    judgement = judge(case.evidence(), {"a": ALL, "b": None})
    assert judgement.verdict == "ACCEPT WITH DEVIATIONS"
    assert rule(judgement, "no_acceptance", None).station == "b"


def test_only_what_is_asked_is_judged(case: Any, tip: Callable[..., Any]) -> None:
    case.station("a", tip().lose(10, 40))
    judgement = judge(case.evidence(), {"a": Acceptance(alarms_max=0)})
    assert judgement.verdict == "ACCEPT"
    assert {one.name for one in judgement.rules} == {"record", "station", "settings", "alarms"}


def test_the_settings_are_read_for_all_stations_together(
    case: Any, tip: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once each for outcomes, orders and adjustments, however many stations and ports."""
    read, rows = list[str](), evidence._rows

    def noted(table: Path, columns: list[str]) -> Iterator[dict[str, object]]:
        read.append(table.name)
        return rows(table, columns)

    monkeypatch.setattr(evidence, "_rows", noted)
    limits = Acceptance(idle_error_c=15, verification_days=30)
    for name in "abc":
        case.station(name, tip(), tip())
        case.setting(name, "confirmed")
    judgement = judge(case.evidence(), dict.fromkeys("abc", limits))
    assert sum(one.name == "verification" for one in judgement.rules) == 6
    assert read.count("settings") == 3


def test_the_recorder_can_judge_without_pandas_and_matplotlib() -> None:
    code = (
        "import jbclog.analysis.verdict, sys; sys.exit(bool({'pandas', 'matplotlib', 'jinja2'} &"
        " set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
