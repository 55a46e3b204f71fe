"""Runs that end with a number of units or joints, on real terminals."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import pytest

from support.campaigns.awaited import ON_THE_BENCH
from support.command import is_sampling, jbclog, recipe_text, until
from support.product import MAIN, Goal, Manifest, SimProcess, check_run, open_run, read_manifest

STATION = """
[[station]]
name = "{name}"
url = "{name}"
family = "dde"
ports = [1]
[station.sim]
joints_per_minute = 30
joint_seconds = 0.9
"""
RECIPE = recipe_text("joints", "dde")


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Path]:
    """Serve two stations that solder quickly; beside their line file is a recipe without limits."""
    path = tmp_path / "two.toml"
    path.write_text(
        '[line]\nname = "two"\n' + "".join(STATION.format(name=name) for name in ("a", "b"))
    )
    (tmp_path / "job.toml").write_text(RECIPE)
    with SimProcess(path, tmp_path / "bench") as stations:
        yield stations.line_path


def arguments(line: Path, *more: str) -> list[str]:
    home = line.parents[1]
    return ["run", str(home / "job.toml"), "--line", str(line), "--out", str(home / "runs"), *more]


def left(line: Path) -> tuple[Path, Manifest]:
    (folder,) = (line.parents[1] / "runs").iterdir()
    return folder, read_manifest(folder)


def test_a_run_ends_with_as_many_joints_as_its_record_then_has(line: Path) -> None:
    # a busy machine may answer too late for 10 Hz
    words = arguments(line, "--until-joints", "6", "-d", "200s", "--rate", "auto")
    done = jbclog(*words, timeout=200)
    folder, manifest = left(line)
    (goal,) = manifest.goals
    assert done.returncode == 0, done.stderr
    assert goal == Goal("joints", 6, len(open_run(folder).joints()), goal.text)
    assert goal.reached >= 6  # type: ignore[operator]  # of both stations; on a busy machine more, until it is found out
    assert [facts.safe_state for facts in manifest.stations] == [{1: "verified"}] * 2
    assert check_run(folder) == []
    assert open_run(folder).events()["kind"].tolist().count("run.goal") == 1


def typed(stdin: IO[str], text: str) -> None:
    stdin.write(text)
    stdin.flush()
    time.sleep(1.2)  # longer than a unit takes at the least


def units(line: Path, *more: str, lines: list[str]) -> subprocess.CompletedProcess[str]:
    words = [
        sys.executable,
        "-c",
        MAIN,
        *arguments(line, "--units", "-", *more),
    ]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdin is not None
        assert until(lambda: is_sampling(line.parents[1] / "runs"))
        for text in lines:
            typed(run.stdin, text)
        out, err = run.communicate(timeout=200)
        return subprocess.CompletedProcess(words, run.returncode, out, err)


@pytest.mark.campaign
def test_a_run_ends_when_the_last_unit_is_finished(line: Path) -> None:
    done = units(line, "--until-units", "2", lines=["SN-1\n", "SN-2\n", "SN-3\n"])
    folder, manifest = left(line)
    assert done.returncode == 0, done.stderr
    assert manifest.goals == [Goal("units", 2, 2, "Units finished: 2, wanted: 2.")]
    assert [unit.unit for unit in manifest.units] == ["SN-1", "SN-2"]
    events = open_run(folder).events()
    assert events[events["kind"] == "unit.next"]["raw"].tolist() == ["SN-3"]


@pytest.mark.campaign
def test_a_run_that_its_duration_ends_short_of_both_numbers_is_not_fine(line: Path) -> None:
    done = units(line, "--until-units", "2", "--until-joints", "900", "-d", "6s", lines=["SN-1\n"])
    _, manifest = left(line)
    assert done.returncode == manifest.exit_code == 1
    assert manifest.exit_status == "success"
    assert f"exit 1: Units finished: 0, wanted: 2. Unit SN-1 {ON_THE_BENCH}" in done.stderr
    assert [goal.is_met for goal in manifest.goals] == [False, False]


@pytest.mark.campaign
def test_a_signal_cuts_a_run_short_that_was_to_end_with_a_number(line: Path) -> None:
    words = [
        sys.executable,
        "-c",
        MAIN,
        *arguments(line, "--until-joints", "900"),
    ]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert until(lambda: is_sampling(line.parents[1] / "runs"))
        run.terminate()
        run.communicate(timeout=200)
    assert run.returncode == 143
    assert left(line)[1].goals[0].reached is not None
