"""Options of `jbclog run`, from the command line to what the run is asked for."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from jbclog.app.run.options import RunOptions
from support.invoked import invoked


@pytest.mark.parametrize(
    ("options", "captures"), [([], False), (["--capture"], True), (["--wire"], True)]
)
def test_a_capture_is_asked_for_by_either_name(
    options: list[str], captures: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[RunOptions] = []

    def record(wanted: RunOptions, *_: object, **__: object) -> int:
        asked.append(wanted)
        return 0

    monkeypatch.setattr(import_module("jbclog.cli.run"), "record", record)
    ended = invoked("run", "job.toml", "--line", tmp_path / "line.toml", *options)
    assert ended.exit_code == 0, ended.output
    assert [wanted.wire for wanted in asked] == [captures]


def test_the_older_name_is_not_in_the_help() -> None:
    shown = invoked("run", "--help").stdout
    assert "--capture" in shown
    assert "--wire " not in shown
