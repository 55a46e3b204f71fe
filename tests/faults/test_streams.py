"""A stream that was closed, or cannot write every character, keeps no run from its record."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

LINE = (
    '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\nports ='
    " [1]\n"
)
RECIPE = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n'
CALL = "exec {python} -c 'from jbclog.cli import main; main()' {arguments}"


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
        tmp_path / "Prüfstück Ω", "plan job.toml --line line.toml", PYTHONIOENCODING=encoding
    )
    assert ended.returncode == 0, ended.stderr
    assert "/nowhere" in ended.stdout
