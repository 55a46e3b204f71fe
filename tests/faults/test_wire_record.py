"""Trouble with the serial capture is reported and changes nothing in the run."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.product import Exit, RunResult, check_run, conduct_run, open_run, patch
from support.virtual.recorded_run import Nobody, plan_in

LINE = (
    '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "nowhere"\nfamily = "dde"\nports ='
    " [1]\n"
)
RECIPE = '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n'


def run(place: Path) -> RunResult:
    """A run on a port that does not exist."""
    plan = plan_in(place, LINE, RECIPE, 1.0, wire=True, guard=False)
    return conduct_run(plan, place / "runs", Nobody())


def test_a_port_that_is_not_there_is_in_the_wire_too(tmp_path: Path) -> None:
    result = run(tmp_path)
    wire = open_run(result.folder).wire("dde-1")
    assert wire["what"].to_list() == ["failed"]
    assert "nowhere" in wire["text"].iloc[0]
    assert result.manifest.wire == "whole"
    assert check_run(result.folder) == []


def test_where_it_cannot_be_written_the_run_is_what_it_would_have_been(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patch(monkeypatch, "capture_recorder.LEAST_FREE", 1 << 60)
    result = run(tmp_path)
    assert result.exit_code is Exit.STATION
    assert [finding.code for finding in result.findings] == [Exit.STATION]
    (event,) = open_run(result.folder).events().query("kind == 'wire.failed'").itertuples()
    assert event.severity == "warning"
    assert "The run continues without it." in event.text
    assert result.manifest.wire == event.text
    assert check_run(result.folder) == []


def test_without_the_option_nothing_is_kept(tmp_path: Path) -> None:
    plan = plan_in(tmp_path, LINE, RECIPE, 1.0, guard=False)
    result = conduct_run(plan, tmp_path / "runs", Nobody())
    assert result.manifest.wire is None
    assert not (result.folder / "wire").exists()
