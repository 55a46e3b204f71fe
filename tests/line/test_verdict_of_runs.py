"""Runs from recipe to verdict: a cold tip is not accepted, and a busy computer does not make a bad
product.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from support.product import VERDICT_RULES, RunPlan, RunResult, check_verdict, open_run
from support.records.verdict_corpus import ONLY_COVERAGE, SOLDERING, STATION, WORKING, StallingClock
from support.virtual.lines import fault
from support.virtual.recorded_run import RecordedRun, plan_in

STAND = '\n[run]\nstatus = "stand"\n'
NEVER = "\n[acceptance]\ncoverage_percent = 99.5\nat_work_percent = 0\n"


def planned(
    home: Path, *parts: str, family: str = "dde", sim: str = "tool = 2", seconds: float = 48.5
) -> RunPlan:
    line = '[line]\nname = "bench"\n' + STATION.format(family=family, sim=sim)
    recipe = "".join([SOLDERING, *parts]).format(name="test")
    return plan_in(home, line, recipe, seconds, rate=4.0)


def run(home: Path, *parts: str, stalls_s: tuple[float, ...] = (), **more: str) -> RunResult:
    return RecordedRun(
        planned(home, *parts, **more), home / "runs", StallingClock(stalls_s, 0.6)
    ).result  # type: ignore[arg-type]


def result_of(result: RunResult, name: str) -> set[object]:
    return {rule["result"] for rule in result.manifest.verdict_rules if rule["name"] == name}


@pytest.mark.parametrize("order", ["", STAND])
def test_a_run_that_never_puts_its_tools_to_work_is_inconclusive(
    tmp_path: Path, order: str
) -> None:
    result = run(tmp_path, order, ONLY_COVERAGE)
    assert (result.manifest.verdict, result.exit_code) == ("INCONCLUSIVE", 1)
    assert result_of(result, "reached") == {"missing"}
    assert result.manifest.rules == VERDICT_RULES
    assert check_verdict(result.folder, result.manifest).differing == []


def test_one_that_does_is_accepted(tmp_path: Path) -> None:
    result = run(tmp_path, WORKING, ONLY_COVERAGE)
    assert (result.manifest.verdict, result.exit_code) == ("ACCEPT", 0)
    assert result_of(result, "reached") == {"pass"}


def test_a_tip_that_stays_cold_although_it_was_told_to_work_is_rejected(tmp_path: Path) -> None:
    result = run(
        tmp_path, WORKING, ONLY_COVERAGE, sim="tool = 2\n" + fault("stuck", at_s=0.0, port=1)
    )
    assert (result.manifest.verdict, result.exit_code) == ("REJECT", 1)
    found = {
        rule["port"]: rule["result"]
        for rule in result.manifest.verdict_rules
        if rule["name"] == "reached"
    }
    assert found == {1: "fail", 2: "pass"}


def test_a_recipe_without_limits_is_not_judged_by_it(tmp_path: Path) -> None:
    result = run(tmp_path)
    assert (result.manifest.verdict, result.exit_code) == ("NOT JUDGED", 0)


def test_what_the_computer_skipped_is_inconclusive_and_told(tmp_path: Path) -> None:
    result = run(tmp_path, WORKING, ONLY_COVERAGE, stalls_s=(15.0, 25.0, 35.0), family="ucr")
    assert (result.manifest.verdict, result.exit_code) == ("INCONCLUSIVE", 1)
    (rule,) = [one for one in result.manifest.verdict_rules if one["name"] == "coverage"]
    assert "The recorder was too late for 3 of them (busy or stopped)" in str(rule["text"])
    events = open_run(result.folder).events()
    assert events[events["kind"] == "host.busy"]["value"].sum() == 3
    assert result.manifest.stations[0].skipped_by_host == 3


def test_one_tick_of_194_is_accepted(tmp_path: Path) -> None:
    result = run(tmp_path, WORKING, ONLY_COVERAGE, stalls_s=(15.0,), family="ucr")
    assert result.manifest.ledger["ucr-1"]["1"]["temperature_c"]["skipped"] == 1
    assert (result.manifest.verdict, result.exit_code) == ("ACCEPT", 0)


# -- what the plan says of it ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (
            (ONLY_COVERAGE,),
            (
                "no [run] status: the run heats no tool, and if nobody else does, the verdict is"
                " INCONCLUSIVE"
            ),
        ),
        ((STAND, ONLY_COVERAGE), '[run] status = "stand": the run heats no tool'),
        ((), "a cold tool is recorded"),
        ((STAND,), None),
        ((WORKING, ONLY_COVERAGE), None),
        ((STAND, NEVER), None),
    ],
)
def test_the_plan_says_when_nothing_is_heated(
    tmp_path: Path, parts: tuple[str, ...], said: str | None
) -> None:
    notes = [text for text in planned(tmp_path, *parts).notes if "heats no tool" in text]
    assert len(notes) == (said is not None)
    assert said is None or said in notes[0]
