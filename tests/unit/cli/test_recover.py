"""`jbclog recover` on a folder of runs: a line for each that it finished, and silence about those
that were finished already.
"""

from __future__ import annotations

from pathlib import Path

from support.invoked import invoked
from support.records.few_rows import abandoned


def shown(folder: Path) -> list[str]:
    ended = invoked("recover", folder)
    assert ended.exit_code == 0, ended.output
    return ended.stdout.splitlines()


def test_finished_runs_are_not_mentioned(tmp_path: Path) -> None:
    assert shown(tmp_path) == [f"{tmp_path}: no runs"]
    first = abandoned(tmp_path)
    (line,) = shown(tmp_path)
    assert line.startswith(f"{first.name}: recovered")
    second = abandoned(tmp_path)
    (line,) = shown(tmp_path)
    assert line.startswith(f"{second.name}: recovered")
    assert shown(tmp_path) == [f"{tmp_path}: nothing to recover"]
    assert shown(first) == [f"{first}: nothing to recover"]
