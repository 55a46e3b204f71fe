"""Whose joints are whose: the unit on the bench at a moment, in runs with serials read meanwhile,
named, told late, or none.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from jbclog.analysis.run import open_run
from jbclog.record.annotations import append
from jbclog.record.manifest import Metadata
from support.records import event_run
from support.records.few_rows import T0

READ = [(10, "unit.begin", "SN-1"), (20, "unit.end", "SN-1"), (30, "unit.begin", "SN-2")]


def run_with(
    out: Path, told: list[tuple[int, str, str]], named: list[str], *, is_open: bool = False
) -> Path:
    return event_run.run_with(out, told, Metadata(units=named), crashes=is_open)


def moments(*seconds: float) -> pd.Series:
    return pd.Series(
        pd.to_datetime([T0 + round(second * 1e6) for second in seconds], unit="us", utc=True)
    )


def units(folder: Path, *seconds: float) -> list[str | None]:
    return [None if pd.isna(unit) else unit for unit in open_run(folder).unit_at(moments(*seconds))]


@pytest.mark.parametrize("is_open", [False, True])
def test_the_unit_is_the_one_that_was_on_the_bench_then(tmp_path: Path, is_open: bool) -> None:
    folder = run_with(tmp_path, READ, [], is_open=is_open)
    assert units(folder, 5, 10, 19.9, 20, 29, 30, 99) == [
        None,
        "SN-1",
        "SN-1",
        None,
        None,
        "SN-2",
        "SN-2",
    ]


def test_what_was_read_counts_and_not_what_was_named(tmp_path: Path) -> None:
    assert units(run_with(tmp_path, READ, ["SN-0"]), 5, 15) == [None, "SN-1"]


@pytest.mark.parametrize(
    ("named", "unit"), [(["SN-0"], "SN-0"), (["SN-0", "SN-1"], None), ([], None)]
)
def test_a_run_of_one_unit_is_all_of_it(tmp_path: Path, named: list[str], unit: str | None) -> None:
    assert units(run_with(tmp_path, [], named), 5, 15) == [unit, unit]


def test_a_serial_added_after_the_run(tmp_path: Path) -> None:
    folder = run_with(tmp_path, [], [])
    append(folder, who="A. Rossi", what="SN-7", why="the reader was off", kind="unit.late")
    assert units(folder, 5) == ["SN-7"]


def test_times_keep_their_index_and_may_be_missing_altogether(tmp_path: Path) -> None:
    run = open_run(run_with(tmp_path, READ, []))
    assert run.unit_at(moments(15).set_axis(["a"])).to_dict() == {"a": "SN-1"}
    assert list(run.unit_at(moments())) == []
    assert list(run.unit_at([moments(15)[0].isoformat()])) == ["SN-1"]
