"""The derived tables that a recorder leaves in its run's folder: they save work, and may be lost,
damaged or of something else.
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

from jbclog.analysis.derived_files import BY, SUM, MetricRow
from jbclog.analysis.derived_schemas import METRICS_SCHEMA
from jbclog.analysis.metrics.metric import METHODS
from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.analysis.runs import Records, open_runs
from jbclog.analysis.trend import trends
from jbclog.analysis.verdict import RULES
from jbclog.app.run import derive as derive_process
from jbclog.app.run.derive import OFF, start_derive
from jbclog.record.annotations import append
from jbclog.record.check import check
from jbclog.record.cross_check import uncovered
from jbclog.record.folder import DERIVED, DERIVED_TABLES, derived_file
from jbclog.record.manifest import Metadata, RunState, read_manifest, write_manifest
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records import release_corpus, small_run
from support.records.derived import derive, known_metrics, write_metrics

COMMAND = [sys.executable, "-P", "-m", "jbclog.app.run.derive"]
METRICS = derived_file("metrics")
NICED_S = 240.0  # the process is niced: on a busy machine everything else comes first


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[MetricRow]]:
    """A sealed run and its metrics."""
    run = small_run.make_run(tmp_path_factory.mktemp("made"), 40.0)
    return run, computed_metrics(open_run(run))


@pytest.fixture
def run(made: tuple[Path, list[MetricRow]], tmp_path: Path) -> Path:
    """The run with its table of metrics."""
    folder = Path(shutil.copytree(made[0], tmp_path / "runs" / made[0].name))
    write_metrics(folder, made[1])
    return folder


def test_the_process_leaves_what_the_record_gives(
    made: tuple[Path, list[MetricRow]], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(made[0], tmp_path / made[0].name))
    assert subprocess.run([*COMMAND, str(folder)], check=False, timeout=NICED_S).returncode == 0
    assert known_metrics(folder) == made[1]
    added = {path.name for path in folder.iterdir()} - {path.name for path in made[0].iterdir()}
    assert added == {DERIVED}
    left = {path.relative_to(folder).as_posix(): path for path in (folder / DERIVED).iterdir()}
    assert [*sorted(left)] == sorted(map(derived_file, DERIVED_TABLES))
    before = {name: path.read_bytes() for name, path in left.items()}
    assert check(folder) == []
    write_report(folder)  # writes the same bytes
    assert {name: path.read_bytes() for name, path in left.items()} == before


def test_check_covers_it_only_with_a_report(run: Path) -> None:
    assert check(run) == []
    assert [(file, text.partition(":")[0]) for file, text in uncovered(run, None)] == [
        (METRICS, "derived from the record, never the truth")
    ]
    (run / METRICS).rename(run / DERIVED / ".metrics.parquet.tmp")  # its writer was killed
    assert check(run) == []
    ended = invoked("check", run)
    assert ended.exit_code == 0
    assert f"not covered: {DERIVED}/.metrics.parquet.tmp: its writer was killed" in ended.output
    (run / DERIVED / ".metrics.parquet.tmp").unlink()
    assert check(run) == []  # an empty folder
    write_report(run)
    assert [*uncovered(run, None)] == []
    write_metrics(run, [])
    assert [finding.file for finding in check(run)] == [METRICS]


def test_all_readers_take_it_and_a_report_makes_it_anew(
    run: Path, made: tuple[Path, list[MetricRow]]
) -> None:
    others = [replace(row, value=1.0, why=None) for row in made[1]]
    write_metrics(run, others)

    def read(records: Records) -> list[MetricRow]:
        return [
            row for _, rows in open_runs(run.parent).through(records).metric_rows() for row in rows
        ]

    assert read(Records()) == others
    assert (open_run(run).metrics()["value"] == 1.0).all()
    assert read(Records(stored=False)) == made[1]
    write_report(run)
    assert read(Records()) == made[1]


def stored(table: pa.Table, **metadata: str) -> Callable[[Path], object]:
    made = {name.encode(): text.encode() for name, text in metadata.items()}
    return lambda path: pq.write_table(
        table.replace_schema_metadata((table.schema.metadata or {}) | made), path
    )


def changes(path: Path) -> dict[str, Callable[[Path], object]]:
    table, data = pq.read_table(path), path.read_bytes()
    columns = table.schema.names
    older = {BY.decode(): f"rules 1, methods {METHODS}"}
    summed = {SUM.decode(): "0" * 64}
    return {
        "empty": lambda path: path.write_bytes(b""),
        "another file": lambda path: path.write_bytes(b"PAR1" * 1000),
        "a large one": lambda path: os.truncate(path, 257 << 20),
        "a bomb": stored(pa.table({"station": ["x" * 200] * 200_000})),
        "a link": lambda path: (path.rename(path.with_name("m")), path.symlink_to("m")),
        "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
        "a folder": lambda path: (path.unlink(), path.mkdir()),
        "of another manifest": stored(table, **{"jbclog.manifest_sha256": "0" * 64}),
        "by older rules": stored(table, **older),
        "with another sum": stored(table, **summed),
        "by newer methods": stored(table, **{BY.decode(): f"rules {RULES}, methods {METHODS + 1}"}),
        "without metadata": lambda path: pq.write_table(table.replace_schema_metadata(None), path),
        "with another column": stored(table.append_column("more", table["n"])),
        "without a column": stored(table.drop_columns(["why"])),
        "with another type": stored(
            table.set_column(columns.index("n"), "n", table["n"].cast("int32"))
        ),
        "with no number": stored(
            table.set_column(4, METRICS_SCHEMA.field(4), pa.array([np.nan] * len(table)))
        ),
        "cut": lambda path: path.write_bytes(data[:-9]),
    }


def test_another_file_changes_no_answer(
    run: Path, made: tuple[Path, list[MetricRow]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = run / METRICS
    data = path.read_bytes()
    assert known_metrics(run) == made[1]
    for name, change in changes(path).items():
        change(path)
        assert known_metrics(run) is None, name
        path.rmdir() if path.is_dir() else path.unlink()
        path.write_bytes(data)
    monkeypatch.setattr("jbclog.analysis.derived_files.METHODS_TEXT", f"rules {RULES}, methods 99")
    assert known_metrics(run) is None


def test_a_late_serial_makes_joints_and_units_old_and_no_metrics(run: Path) -> None:
    write_manifest(run, replace(read_manifest(run), metadata=Metadata()))
    derive(run)
    assert open_run(run).joints()["unit"].isna().all()
    append(run, who="A. Rossi", what="SN-7", why="the reader was off", kind="unit.late")
    assert (open_run(run).joints()["unit"] == "SN-7").all()
    assert list(open_run(run).units()["unit"]) == ["SN-7"]
    assert known_metrics(run) is not None
    derive(run)
    assert (open_run(run).joints()["unit"] == "SN-7").all()


def test_damaged_bytes_change_no_answer(run: Path, made: tuple[Path, list[MetricRow]]) -> None:
    path = run / METRICS
    data = path.read_bytes()
    for at in range(0, len(data), 7):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x11]) + data[at + 1 :])
        assert known_metrics(run) in (None, made[1]), at


def test_without_it_a_trend_computes_the_same(run: Path) -> None:
    with_it = [one.points for one in trends(open_runs(run.parent).through(Records()))]
    (run / METRICS).unlink()
    assert [one.points for one in trends(open_runs(run.parent).through(Records()))] == with_it


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
    assert known_metrics(folder) in (None, made[1])
    assert {path: path.read_bytes() for path in before} == before
    assert check(folder) == []


def test_a_run_that_was_moved_is_no_error(tmp_path: Path) -> None:
    assert (
        subprocess.run(
            [*COMMAND, str(tmp_path / "gone")], capture_output=True, check=False, timeout=NICED_S
        ).stderr
        == b""
    )


def test_only_a_sealed_run_with_samples_is_derived_from(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[object] = []
    monkeypatch.setattr(subprocess, "Popen", lambda *words, **_: begun.append(words))
    manifest = read_manifest(run)
    start_derive(run, manifest)  # OFF is set for all tests
    monkeypatch.delenv(OFF)
    start_derive(run, replace(manifest, state=RunState.OPEN))
    start_derive(
        run,
        replace(
            manifest, stations=[replace(facts, first_tick=None) for facts in manifest.stations]
        ),
    )
    assert begun == []
    start_derive(run, manifest)
    assert len(begun) == 1


def test_nobody_waits_for_it_except_where_it_would_end_too(
    made: tuple[Path, list[MetricRow]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(made[0], tmp_path / made[0].name))
    monkeypatch.delenv(OFF)
    monkeypatch.setattr(derive_process, "WAIT_S", NICED_S)
    child = start_derive(folder, read_manifest(folder))
    assert child is not None
    assert child.returncode is None  # whoever had waited would know how it ended
    assert child.wait(NICED_S) == 0
    assert known_metrics(folder) == made[1]
    shutil.rmtree(folder / DERIVED)
    monkeypatch.setenv("SYSTEMD_EXEC_PID", str(os.getpid()))
    start_derive(folder, read_manifest(folder))
    assert known_metrics(folder) == made[1]


FIGURES = {
    "0.1.0": "8cfdb5576e1fd6fd",
    "after-0.1.0": "8cfdb5576e1fd6fd",
    "small": "af44029ba7e832c7",
}
"""Methods 5. Whoever changes these raises `METHODS` and writes down the new ones."""


def test_other_figures_are_other_methods(made: tuple[Path, list[MetricRow]]) -> None:
    found = {"small": made[1]}
    for release in ("0.1.0", "after-0.1.0"):
        (sealed,) = (release_corpus.HOME / release / "sealed").iterdir()
        found[release] = computed_metrics(open_run(sealed))
    assert METHODS == 5
    assert {name: digest(rows) for name, rows in found.items()} == FIGURES


def digest(rows: list[MetricRow]) -> str:
    """Of all rows, their values to six digits: libraries differ in the last ones."""
    texts = [
        f"{one.station} {one.port} {one.metric} {one.uom} {one.n} {one.why} "
        + " ".join(
            "-" if value is None else f"{value:.6g}"
            for value in (one.value, one.coverage, one.resolution)
        )
        for one in rows
    ]
    return sha256("\n".join(texts).encode()).hexdigest()[:16]
