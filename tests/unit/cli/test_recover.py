"""`jbclog recover` on a folder of runs: a line for each that it finished, and a number for those that were finished already."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from jbclog.cli.app import app
from support.records.few_rows import abandoned


def shown(folder: Path) -> list[str]:
    ended = CliRunner().invoke(app, ["recover", str(folder)])
    assert ended.exit_code == 0, ended.output
    return ended.stdout.splitlines()


def test_runs_that_were_finished_are_only_counted(tmp_path: Path) -> None:
    first = abandoned(tmp_path)
    assert shown(tmp_path)[0].startswith(f"{first.name}: recovered")
    second = abandoned(tmp_path)
    assert [line.partition(", ")[0] for line in shown(tmp_path)] == [
        f"{second.name}: recovered",
        f"{tmp_path}: 1 run already finished; nothing was changed.",
    ]
    assert shown(tmp_path) == [f"{tmp_path}: 2 runs already finished; nothing was changed."]
    assert shown(first) == [f"{first.name}: already finished; nothing was changed."]
