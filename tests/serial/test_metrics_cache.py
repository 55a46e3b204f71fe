"""The metrics that `jbclog run` leaves beside its run after its end."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.analysis.stored_tables import cached_metrics
from jbclog.app.run.metrics_cache import OFF
from jbclog.record.check import check
from jbclog.record.manifest import manifest_sha256
from support.command import RECIPE, WireLog, jbclog, until


def test_a_run_leaves_its_metrics_and_does_not_wait_for_them(
    bench: tuple[Path, WireLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(OFF)
    line, _ = bench
    ended = jbclog(
        "run",
        RECIPE,
        "--line",
        line,
        "--out",
        tmp_path / "runs",
        "-d",
        "3s",
        "-s",
        "ale-1",
        "--rate",
        "5",
    )
    folder = Path(ended.stdout.splitlines()[-1])
    assert not (folder / "metrics.parquet").exists()
    assert check(folder) == []
    assert until((folder / "metrics.parquet").exists, 120)
    assert cached_metrics(folder, manifest_sha256(folder)) == computed_metrics(open_run(folder))
    assert check(folder) == []
