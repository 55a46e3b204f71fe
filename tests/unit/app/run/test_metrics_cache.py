"""The metrics that a recorder leaves beside its run: a cache that only trends read, and that may be
lost, damaged or forged.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from jbclog.analysis.metrics.definitions import METHODS
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.analysis.runs import Records, open_runs
from jbclog.analysis.stored_tables import (
    BY,
    METRICS_SCHEMA,
    MetricRow,
    cache_metrics,
    cached_metrics,
)
from jbclog.analysis.trend import trends
from jbclog.analysis.verdict import RULES
from jbclog.app.run import metrics_cache
from jbclog.app.run.metrics_cache import OFF, start_metrics
from jbclog.record.check import check
from jbclog.record.cross_check import uncovered
from jbclog.record.folder import METRICS_CACHE
from jbclog.record.manifest import RunState, manifest_sha256, read_manifest
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records import release_corpus, small_run

COMMAND = [sys.executable, "-P", "-m", "jbclog.app.run.metrics_cache"]
NICED_S = 240.0  # the process is niced: on a busy machine everything else comes first


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[MetricRow]]:
    """A sealed run and its metrics."""
    run = small_run.make_run(tmp_path_factory.mktemp("made"), 40.0)
    return run, computed_metrics(open_run(run))


@pytest.fixture
def run(made: tuple[Path, list[MetricRow]], tmp_path: Path) -> Path:
    """The run with its cache."""
    folder = Path(shutil.copytree(made[0], tmp_path / "runs" / made[0].name))
    cache_metrics(folder, made[1], manifest_sha256(folder))
    return folder


def known(run: Path) -> list[MetricRow] | None:
    return cached_metrics(run, manifest_sha256(run))


def test_the_process_leaves_what_the_record_gives(
    made: tuple[Path, list[MetricRow]], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(made[0], tmp_path / made[0].name))
    assert subprocess.run([*COMMAND, str(folder)], check=False, timeout=NICED_S).returncode == 0
    assert known(folder) == made[1]
    assert {path.name for path in folder.iterdir()} - {path.name for path in made[0].iterdir()} == {
        METRICS_CACHE
    }
    assert check(folder) == []


def test_check_lists_it_as_a_cache(run: Path) -> None:
    assert check(run) == []
    assert [(file, text.partition(":")[0]) for file, text in uncovered(run, None)] == [
        (METRICS_CACHE, "a cache, never the truth")
    ]
    (run / METRICS_CACHE).rename(run / f".{METRICS_CACHE}.tmp")  # its writer was killed
    assert check(run) == []
    ended = invoked("check", run)
    assert ended.exit_code == 0
    assert f"not covered: .{METRICS_CACHE}.tmp: a cache" in ended.output


def test_a_report_and_its_own_metrics_go_before_it(
    run: Path, made: tuple[Path, list[MetricRow]]
) -> None:
    forged = [replace(row, value=1.0, why=None) for row in made[1]]
    cache_metrics(run, forged, manifest_sha256(run))

    def read(records: Records) -> list[MetricRow]:
        return [
            row for _, rows in open_runs(run.parent).through(records).metric_rows() for row in rows
        ]

    assert read(Records(cache=True)) == forged  # whoever can write the folder can forge it
    assert read(Records()) == read(Records(stored=False)) == made[1]
    assert not (open_run(run).metrics()["value"] == 1.0).fillna(False).all()
    write_report(run)
    assert read(Records(cache=True)) == made[1]
    assert [file for file, _ in uncovered(run, None)] == [METRICS_CACHE]


def stored(table: pa.Table, **metadata: str) -> Callable[[Path], object]:
    made = {name.encode(): text.encode() for name, text in metadata.items()}
    return lambda path: pq.write_table(
        table.replace_schema_metadata((table.schema.metadata or {}) | made), path
    )


def changes(path: Path) -> dict[str, Callable[[Path], object]]:
    table, data = pq.read_table(path), path.read_bytes()
    columns = table.schema.names
    older = {BY.decode(): f"rules 1, methods {METHODS}"}
    return {
        "empty": lambda path: path.write_bytes(b""),
        "another file": lambda path: path.write_bytes(b"PAR1" * 1000),
        "a large one": lambda path: os.truncate(path, 5 << 20),
        "a bomb": stored(pa.table({"station": ["x" * 200] * 200_000})),
        "a link": lambda path: (path.rename(path.with_name("m")), path.symlink_to("m")),
        "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
        "a folder": lambda path: (path.unlink(), path.mkdir()),
        "of another manifest": stored(table, **{"jbclog.manifest_sha256": "0" * 64}),
        "by older rules": stored(table, **older),
        "by newer methods": stored(table, **{BY.decode(): f"rules {RULES}, methods {METHODS + 1}"}),
        "without metadata": lambda path: pq.write_table(table.replace_schema_metadata(None), path),
        "with another column": stored(table.append_column("more", table["n"])),
        "without a column": stored(table.drop_columns(["why"])),
        "with another type": stored(
            table.set_column(columns.index("n"), "n", table["n"].cast("int32"))
        ),
        "with no number": stored(
            table.set_column(3, METRICS_SCHEMA.field(3), pa.array([np.nan] * len(table)))
        ),
        "cut": lambda path: path.write_bytes(data[:-9]),
    }


def test_another_file_changes_no_answer(
    run: Path, made: tuple[Path, list[MetricRow]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = run / METRICS_CACHE
    data = path.read_bytes()
    assert known(run) == made[1]
    for name, change in changes(path).items():
        change(path)
        assert known(run) is None, name
        path.rmdir() if path.is_dir() else path.unlink()
        path.write_bytes(data)
    monkeypatch.setattr("jbclog.analysis.stored_tables.METHODS_TEXT", f"rules {RULES}, methods 99")
    assert known(run) is None


def test_rows_that_no_recorder_writes_are_none(
    run: Path, made: tuple[Path, list[MetricRow]]
) -> None:
    rows = made[1]
    nothing = replace(rows[0], value=None, why=None)
    for wrong in (
        [],
        rows[1:],
        [*rows, rows[0]],
        rows[::-1],
        [nothing, *rows[1:]],
        [replace(rows[0], metric="other"), *rows[1:]],
    ):
        cache_metrics(run, wrong, manifest_sha256(run))  # with a check sum that fits
        assert known(run) is None


def test_damaged_bytes_change_no_answer(run: Path, made: tuple[Path, list[MetricRow]]) -> None:
    path = run / METRICS_CACHE
    data = path.read_bytes()
    for at in range(0, len(data), 7):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x11]) + data[at + 1 :])
        assert known(run) in (None, made[1]), at


def test_without_it_a_trend_computes_the_same(run: Path) -> None:
    with_it = [one.points for one in trends(open_runs(run.parent).through(Records(cache=True)))]
    (run / METRICS_CACHE).unlink()
    assert [
        one.points for one in trends(open_runs(run.parent).through(Records(cache=True)))
    ] == with_it


@pytest.mark.parametrize("after_s", [0.1, 0.7])
def test_killed_it_leaves_a_whole_run(
    made: tuple[Path, list[MetricRow]], tmp_path: Path, after_s: float
) -> None:
    folder = Path(shutil.copytree(made[0], tmp_path / made[0].name))
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    child = subprocess.Popen([*COMMAND, str(folder)])
    time.sleep(after_s)
    child.send_signal(signal.SIGKILL)
    child.wait()
    assert known(folder) in (None, made[1])
    assert {path: path.read_bytes() for path in before} == before
    assert check(folder) == []


def test_a_run_that_was_moved_is_no_error(tmp_path: Path) -> None:
    assert (
        subprocess.run(
            [*COMMAND, str(tmp_path / "gone")], capture_output=True, check=False, timeout=NICED_S
        ).stderr
        == b""
    )


def test_only_a_sealed_run_with_samples_has_metrics(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[object] = []
    monkeypatch.setattr(subprocess, "Popen", lambda *words, **_: begun.append(words))
    manifest = read_manifest(run)
    start_metrics(run, manifest)  # OFF is set for all tests
    monkeypatch.delenv(OFF)
    start_metrics(run, replace(manifest, state=RunState.OPEN))
    start_metrics(
        run,
        replace(
            manifest, stations=[replace(facts, first_tick=None) for facts in manifest.stations]
        ),
    )
    assert begun == []
    start_metrics(run, manifest)
    assert len(begun) == 1


def test_nobody_waits_for_it_except_where_it_would_end_too(
    made: tuple[Path, list[MetricRow]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(made[0], tmp_path / made[0].name))
    monkeypatch.delenv(OFF)
    monkeypatch.setattr(metrics_cache, "WAIT_S", NICED_S)
    child = start_metrics(folder, read_manifest(folder))
    assert child is not None
    assert child.returncode is None  # whoever had waited would know how it ended
    assert child.wait(NICED_S) == 0
    assert known(folder) == made[1]
    (folder / METRICS_CACHE).unlink()
    monkeypatch.setenv("SYSTEMD_EXEC_PID", str(os.getpid()))
    start_metrics(folder, read_manifest(folder))
    assert known(folder) == made[1]


FIGURES = {
    "0.1.0": "1b2c88d7e4041adb",
    "after-0.1.0": "1b2c88d7e4041adb",
    "small": "d79a4049fb635208",
}
"""Methods 4. Whoever changes these raises `METHODS` and writes down the new ones."""


def test_other_figures_are_other_methods(made: tuple[Path, list[MetricRow]]) -> None:
    found = {"small": made[1]}
    for release in ("0.1.0", "after-0.1.0"):
        (sealed,) = (release_corpus.HOME / release / "sealed").iterdir()
        found[release] = computed_metrics(open_run(sealed))
    assert METHODS == 4
    assert {name: digest(rows) for name, rows in found.items()} == FIGURES


def digest(rows: list[MetricRow]) -> str:
    """Of all rows, their values to six digits: libraries differ in the last ones."""
    texts = [
        f"{one.station} {one.port} {one.metric} {one.unit} {one.n} {one.why} "
        + " ".join(
            "-" if value is None else f"{value:.6g}"
            for value in (one.value, one.coverage, one.resolution)
        )
        for one in rows
    ]
    return sha256("\n".join(texts).encode()).hexdigest()[:16]
