"""The derived tables that `jbclog run` leaves in its run's folder after its end."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.app.run.derive import OFF, WAIT_S
from jbclog.record.check import check
from jbclog.record.folder import DERIVED, DERIVED_TABLES, derived_file
from support.command import RECIPE, WireLog, jbclog, until
from support.records.derived import known_metrics

HELD_BACK = """
import os, pathlib, sys, time
if "jbclog.app.run.derive" in sys.orig_argv:
    pathlib.Path({began!r}).touch()
    while not pathlib.Path({go!r}).exists():
        time.sleep(0.05)
    os.nice = lambda _: 0  # lowest priority gets next to no time on a machine that tests keep busy
"""


def test_a_run_leaves_its_tables_and_does_not_wait_for_them(
    bench: tuple[Path, WireLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    began, go, site = (tmp_path / name for name in ("began", "go", "site"))
    site.mkdir()
    held_back = HELD_BACK.format(began=str(began), go=str(go))
    (site / "sitecustomize.py").write_text(held_back)
    path = os.pathsep.join(filter(None, (str(site), os.environ.get("PYTHONPATH"))))
    monkeypatch.setenv("PYTHONPATH", path)
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
        "2",
    )
    assert ended.stdout, ended.stderr
    folder = Path(ended.stdout.splitlines()[-1])
    assert not began.exists() or time.time() - began.stat().st_mtime < WAIT_S / 2
    assert not (folder / DERIVED).exists()
    assert check(folder) == []
    go.touch()
    assert until((folder / derived_file(DERIVED_TABLES[-1])).exists, 120)
    assert known_metrics(folder) == computed_metrics(open_run(folder))
    assert check(folder) == []
