"""Derived tables in a run's folder: written and read as jbclog does, some with values of a test."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jbclog.analysis.derived_files import (
    MetricRow,
    Origin,
    derived_files,
    derived_table,
    metric_rows_in,
    metrics_table,
    write_derived,
)
from jbclog.analysis.run import open_run
from jbclog.analysis.run_derived import derived_tables
from jbclog.analysis.run_metrics import joints_and_metrics
from jbclog.record.manifest import manifest_sha256


def derive(folder: Path) -> None:
    """Write all derived tables of a sealed run."""
    run = open_run(folder)
    tables = derived_tables(run, joints_and_metrics(run), run.alarm_findings())
    write_derived(folder, derived_files(tables, Origin.of(folder)))


def write_metrics(folder: Path, rows: Sequence[MetricRow]) -> None:
    """Write these rows as the run's table of metrics."""
    table = metrics_table(rows, folder.name)
    write_derived(folder, derived_files({"metrics": table}, Origin.of(folder)))


def known_metrics(folder: Path) -> list[MetricRow] | None:
    """Return the rows of the run's table of metrics; None if it does not count."""
    table = derived_table(folder, "metrics", manifest_sha256(folder))
    return None if table is None else metric_rows_in(table)
