"""One record as many runs, as benchmarks use it: each is a run of its own, with its metrics."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics, metric_rows_in, stored_table
from jbclog.analysis.runs import open_runs
from jbclog.report.write import write_report
from support.records.derived import write_metrics
from support.records.same_record import as_another
from support.records.small_run import make_run


@pytest.mark.parametrize("has_report", [False, True])
def test_each_is_a_run_of_its_own_and_keeps_the_metrics(tmp_path: Path, has_report: bool) -> None:
    run = make_run(tmp_path / "first", 5.0)
    if has_report:
        write_report(run)
    else:
        write_metrics(run, computed_metrics(open_run(run)))
    out = tmp_path / "runs"
    for name in ("one", "two"):
        as_another(run, out / name)
    found = [*open_runs(run).found, *open_runs(out).found]
    assert [one.run for one in found] == [run.name, "one", "two"]
    assert [one.changed for one in found] == [None] * 3
    tables = [stored_table(open_run(one.folder), "metrics") for one in found]
    first, *others = [metric_rows_in(table) for table in tables if table is not None]
    assert others == [first, first]
