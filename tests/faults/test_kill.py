"""Real kills, at every step that reaches the disk and at random moments: nothing acknowledged is
ever lost.

`crash.py` in tests/support kills; the tests here check what must hold afterwards
(docs/reference/faults.md, F-26, F-27, F-30).
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from support import program
from support.faults import crash

SCENARIOS = sorted(crash.SCENARIOS)


def killed(tmp_path: Path, *arguments: str) -> list[Any]:
    """Yield what was left after each kill, and what else the program reports in between."""
    command = program("faults.crash", arguments[0], tmp_path, *arguments[1:])
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def assert_whole(left: dict[str, object], rows: int | None) -> None:
    """Every acknowledged row once and in order, an intact chain, a check without findings, and a
    second recovery without work.
    """
    assert "error" not in left, left
    numbers, events = left["numbers"], left["events"]
    assert isinstance(numbers, list)
    assert isinstance(left["acknowledged"], int)
    assert numbers == list(range(len(numbers)))
    assert len(numbers) >= left["acknowledged"]
    assert events == list(range(0, len(numbers), 7))
    assert (left["findings"], left["leavings"], left["twice the same"]) == ([], [], True)
    if rows is not None:
        assert len(numbers) == rows


def assert_scenario(scenario: str, outcomes: list[dict[str, object]]) -> None:
    for left in outcomes:
        assert_whole(left, None if scenario == "record" else crash.ROWS)
        if scenario == "seal":  # closed normally: only its sealing was cut short
            assert (left["exit status"], left["lost"]) == ("success", None)
        else:
            assert left["exit status"] == "lost"
            assert left["lost"] in (0.0, 1.0)


@pytest.fixture(scope="module")
def slices(
    tmp_path_factory: pytest.TempPathFactory,
) -> dict[tuple[str, bool], list[dict[str, object]]]:
    """What was left after kills at some steps, by scenario and whether the power failed, too; of
    one program.
    """
    found: dict[tuple[str, bool], list[dict[str, object]]] = {}
    for line in killed(tmp_path_factory.mktemp("slices"), "slice", "3", "23"):
        if isinstance(line, list):
            scenario, power = line
            outcomes = found[scenario, power] = []
        else:
            outcomes.append(line)
    return found


@pytest.mark.parametrize("power", [False, True], ids=["kill", "power"])
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_killed_at_some_steps(
    slices: dict[tuple[str, bool], list[dict[str, object]]], scenario: str, power: bool
) -> None:
    outcomes = slices[scenario, power]
    assert len(outcomes) >= 2
    assert_scenario(scenario, outcomes)


def test_a_recorder_killed_at_random_moments(tmp_path: Path) -> None:
    outcomes = killed(tmp_path, "random", "1", "2")
    assert len(outcomes) == 2
    for left in outcomes:
        assert_whole(left, None)


@pytest.mark.campaign
@pytest.mark.timeout(600)
@pytest.mark.parametrize("power", [False, True], ids=["kill", "power"])
@pytest.mark.parametrize("scenario", SCENARIOS)
def test_killed_at_every_step(
    tmp_path: Path, scenario: str, power: bool, counted: Callable[..., None]
) -> None:
    outcomes = killed(tmp_path, scenario, "1", "1", *(["--power"] if power else []))
    assert len(outcomes) >= 30
    assert_scenario(scenario, outcomes)
    counted(kills=len(outcomes), acknowledged_rows_lost=0)


@pytest.mark.campaign
@pytest.mark.timeout(900)
@pytest.mark.parametrize("seed", range(10))
def test_a_recorder_killed_at_a_thousand_random_moments(
    tmp_path: Path, seed: int, counted: Callable[..., None]
) -> None:
    for left in killed(tmp_path, "random", str(seed), "100"):
        assert_whole(left, None)
        counted(kills=1, acknowledged_rows_lost=0)
