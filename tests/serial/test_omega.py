"""An OMEGA on real pseudo-terminals, as a user works with it: plan, run, a joint by hand."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest

from support.command import PROFILES, jbclog
from support.product import SimProcess, check_run

LINE = """
[line]
name = "omega"
[[station]]
name = "omega-1"
url = "omega-1"
family = "omega"
[station.sim]
turnaround_ms = 20
joints_per_minute = 0
"""
RECIPE = PROFILES / "recipes" / "omega-point.toml"


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Path]:
    """Serve a virtual OMEGA with condition 101 of the recipe; return the line file for a run."""
    (tmp_path / "line.toml").write_text(LINE)
    with SimProcess(tmp_path / "line.toml", tmp_path / "virtual") as stations:
        yield stations.line_path


def test_a_run_that_proves_a_condition(line: Path, tmp_path: Path) -> None:
    planned = jbclog("plan", "--verbose", RECIPE, "--line", line)
    assert (
        "78.4 % of the link at 250 ms, the manual's maximum; highest rate 1.2 Hz" in planned.stdout
    )
    assert "note: omega-1 has no safe state that can be set" in planned.stderr
    ended = jbclog("run", RECIPE, "--line", line, "--out", tmp_path / "runs", "-d", "2s")
    folder = Path(ended.stdout.split()[-1])
    assert ended.returncode == code_of(folder), ended.stderr
    assert "note: omega-1 has no safe state that can be set" in ended.stderr
    assert check_run(folder) == []
    samples = pd.read_parquet(folder / "samples")
    assert len(samples) == 2
    assert set(samples["solder_shortage"].dropna()) == {False}
    assert set(pd.read_parquet(folder / "settings")["outcome"]) == {"unchanged"}


def code_of(folder: Path) -> int:
    """Return the exit code of an undisturbed run: 1 if a busy machine missed a state, which is
    below the recipe's coverage, otherwise 0.
    """
    samples = pd.read_parquet(folder / "samples")
    return int(samples[["solder_shortage", "clogged"]].isna().any(axis=None))


def test_another_condition_is_written_with_leave(line: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(RECIPE.read_text().replace("rise_s = 0.3", "rise_s = 0.9"))
    written = jbclog(
        "run",
        other,
        "--line",
        line,
        "--out",
        tmp_path / "runs",
        "-d",
        "1s",
        "--allow-omega-write",
        "--json",
    )
    folder = Path(json.loads(written.stdout)["folder"])
    assert written.returncode == code_of(folder), written.stderr
    settings = pd.read_parquet(folder / "settings").set_index("setting")
    assert settings.loc["condition_101.rise_s", "readback"] == "0.9"
    assert set(settings["outcome"]) == {"confirmed"}


def test_a_joint_made_by_hand_is_waited_for(line: Path, tmp_path: Path) -> None:
    asked = jbclog("write", "omega-1", "run_condition", "101", "--line", line)
    assert asked.returncode == 2
    done = jbclog(
        *(
            "write",
            "omega-1",
            "run_condition",
            "101",
            "--yes-i-mean",
            "omega-1",
            "--snapshot",
            tmp_path / "before.json",
        ),
        *("--line", line),
    )
    assert done.returncode == 0, done.stderr
