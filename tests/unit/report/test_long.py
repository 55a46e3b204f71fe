"""Rows are read in narrow columns, in pieces: text, figures and numbers of a report are those from
whole rows.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pytest

from jbclog.analysis.figures import curves
from jbclog.analysis.run import Run, open_run
from jbclog.analysis.run_tables import RunTables, select
from jbclog.app.run.plan import RunOptions, make_plan
from jbclog.core.rows import StationFacts
from jbclog.report import gather, ports
from jbclog.report.facts import FigureFacts
from jbclog.report.joints import joints_of
from jbclog.report.write import as_document, figures_of
from support.records import small_run
from support.virtual.lines import AIR
from support.virtual.recorded_run import RecordedRun
from support.virtual.virtual_run import RECIPE, line_text


def small(home: Path) -> Path:
    return small_run.make_run(home, 20.0)


def hot_air(home: Path) -> Path:
    sim = "tool = 1\n[[station.sim.fault]]\nkind = 'silence'\nat_s = 4\nfor_s = 2\n"
    (home / "line.toml").write_text(line_text(sim).replace("dde", "jtse"))
    (home / "recipe.toml").write_text(AIR)
    plan = make_plan(RunOptions(home / "line.toml", home / "recipe.toml", duration_s=10.0))
    return RecordedRun(plan, home / "runs").result.folder


def free(home: Path) -> Path:
    """With ``--rate max`` the rows have no grid, only times."""
    (home / "line.toml").write_text(line_text())
    (home / "recipe.toml").write_text(RECIPE)
    plan = make_plan(
        RunOptions(home / "line.toml", home / "recipe.toml", duration_s=5.0, rate="max")
    )
    return RecordedRun(plan, home / "runs").result.folder


@pytest.mark.parametrize("made", [small, hot_air, free])
def test_a_report_is_the_same_however_its_rows_are_read(
    made: Callable[[Path], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(made(tmp_path))
    joints = joints_of(run)
    whole = gather.gather(run, joints)
    monkeypatch.setattr(gather, "MOST_ROWS", 0)  # a pass for each station
    monkeypatch.setattr(curves, "BLOCK_ROWS", 7)
    monkeypatch.setattr(RunTables, "coded", in_small_groups)
    pieces = gather.gather(run, joints)
    assert as_document(pieces) == as_document(whole)
    assert figures_of(pieces) == figures_of(whole)


def in_small_groups(run: RunTables, table: str, columns: list[str]) -> Iterator[pa.Table]:
    for group in run._groups(select(table, columns)):
        yield from (group.slice(first, 61) for first in range(0, len(group), 61))


@pytest.mark.parametrize("made", [small, hot_air, free])
def test_rows_of_a_port_are_those_of_the_whole_table(
    made: Callable[[Path], Path], tmp_path: Path
) -> None:
    run = open_run(made(tmp_path))
    for facts, of_station in gather._samples(run):
        for port, rows in of_station.items():
            whole = run.samples(facts.name, port)[rows.columns]
            assert len(rows) == len(whole) > 0
            for name in rows.columns:
                assert [None if pd.isna(one) else one for one in rows[name]] == [
                    None if pd.isna(one) else one for one in whole[name]
                ]


def test_the_rows_of_a_port_are_small_and_freed_before_it_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = open_run(small(tmp_path))
    frames: list[weakref.ref[pd.DataFrame]] = []
    by_port, figures = gather._by_port, ports._figures

    def noted(run: Run, stations: Sequence[StationFacts]) -> dict[str, dict[int, pd.DataFrame]]:
        found = by_port(run, stations)
        rows = [one for of_station in found.values() for one in of_station.values()]
        assert all(one.memory_usage(index=False).sum() <= 32 * len(one) for one in rows)
        frames.extend(map(weakref.ref, rows))
        return found

    def alive(*given: Any) -> list[FigureFacts]:
        drawn.append(sum(one() is not None for one in frames))
        return figures(*given)

    drawn = list[int]()
    monkeypatch.setattr(gather, "_by_port", noted)
    monkeypatch.setattr(ports, "_figures", alive)
    gather.gather(run, joints_of(run))
    assert drawn == [*range(len(frames) - 1, -1, -1)]
