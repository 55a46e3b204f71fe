"""A stream that was closed, or cannot write every character, keeps no run from its record."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from support.product import MAIN

LINE = (
    '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\nports ='
    " [1]\n"
)
RECIPE = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n'
CALL = f"{{python}} -c '{MAIN}' {{arguments}}"


def shell(folder: Path, arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    (folder / "line.toml").write_text(LINE)
    (folder / "job.toml").write_text(RECIPE)
    script = CALL.format(python=sys.executable, arguments=arguments)
    return subprocess.run(
        ["sh", "-c", script],
        cwd=folder,
        capture_output=True,
        text=True,
        errors="replace",
        env=environment,
        timeout=200,
        check=False,
    )


@pytest.mark.parametrize("closed", ["2>&-", ">&-", "<&- >&- 2>&-", ">/dev/full 2>/dev/full"])
def test_a_run_is_recorded_all_the_same(tmp_path: Path, closed: str) -> None:
    ended = shell(tmp_path, f"run job.toml --line line.toml --duration 1s {closed}")
    (run,) = (tmp_path / "runs").iterdir()
    assert ended.returncode == 3  # the station is not there, which is what is to be told
    assert json.loads((run / "manifest.json").read_text())["state"] == "sealed"
    if closed == "2>&-":
        assert ended.stdout == f"runs/{run.name}\n"
    if closed == ">&-":
        assert "no such port" in ended.stderr


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_stream_that_cannot_write_a_character_gets_an_escape(
    tmp_path: Path, encoding: str
) -> None:
    (tmp_path / "Prüfstück Ω").mkdir()
    ended = shell(
        tmp_path / "Prüfstück Ω", "plan job.toml --line line.toml --json", PYTHONIOENCODING=encoding
    )
    assert ended.returncode == 0, ended.stderr
    (station,) = json.loads(ended.stdout)["stations"]
    assert station["url"].endswith("Prüfstück Ω/nowhere")
    ended = shell(
        tmp_path / "Prüfstück Ω",
        "plan job.toml --line line.toml --verbose",
        PYTHONIOENCODING=encoding,
    )
    assert ended.returncode == 0, ended.stderr
    assert "/nowhere" in ended.stdout


RUNS = Path(__file__).parents[2] / "notebooks/data/alarm"
FULL = "No space left on device"


@pytest.mark.parametrize(
    "arguments",
    [
        "--help",
        "--version",
        "run --help",
        "plan job.toml --line line.toml",
        "plan job.toml --line line.toml --json",
        "runs {folder}",
        "runs {folder} --json",
        "check {run} --json",
        "check {run}",
    ],
)
def test_output_on_a_full_disk_is_no_success(tmp_path: Path, arguments: str) -> None:
    words = arguments.format(folder=RUNS, run=next(RUNS.iterdir()))
    fine = shell(tmp_path, words)
    full = shell(tmp_path, f"{words} >/dev/full")
    assert fine.returncode in (0, 1)
    assert full.returncode == 6
    lines = full.stderr.removeprefix(fine.stderr).splitlines()
    assert lines == [f"error: standard output is incomplete: {FULL}; free space there"]


def test_a_worse_end_keeps_its_code_on_a_full_disk(tmp_path: Path) -> None:
    assert shell(tmp_path, "check nowhere --json >/dev/full").returncode == 2
    assert shell(tmp_path, "run job.toml --line line.toml --json >/dev/full").returncode == 3


def test_a_pipe_that_its_reader_closes_is_no_failure(tmp_path: Path) -> None:
    ended = shell(tmp_path, f"runs {RUNS} --json | head -c 1")
    assert (ended.returncode, ended.stderr) == (0, "")
