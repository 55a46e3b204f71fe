"""Runs found and measured through the index: the same answers as without it, whatever happens to
the folder or to the index.
"""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from operator import attrgetter
from pathlib import Path
from typing import Any

import msgspec
import pytest

from jbclog.analysis.run import open_run
from jbclog.analysis.run_metrics import computed_metrics
from jbclog.analysis.runs import Records, open_runs
from jbclog.analysis.stored_tables import cache_metrics
from jbclog.analysis.trend import trends
from jbclog.app.index import index_file, run_index
from jbclog.app.index.index_file import NAME, IndexFile
from jbclog.app.index.run_index import FOUND, RunIndex
from jbclog.core.locks import FolderLock
from jbclog.core.rows import TABLES
from jbclog.maintenance.suspect_runs import where_used
from jbclog.record.annotations import append
from jbclog.record.find_runs import ALL, Filter, Found, find
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import (
    Metadata,
    RunState,
    manifest_sha256,
    read_manifest,
    write_manifest,
)
from support.invoked import invoked
from support.records import many_runs

SINCE = datetime(2000, 1, 1, tzinfo=UTC)
FILTERS = (
    Filter(),
    Filter(order="88123"),
    Filter(unit="SN-*"),
    Filter(station="dde-1", tags={"shift": "2"}),
    Filter(verdict="REJECT"),
)
STRANGE = (
    'it\'s "a" run; DROP TABLE entries --',
    "line\nbreak",
    os.fsdecode(b"caf\xe9"),
    "%s?*[x]",
)
A_TICK_S = 0.03  # longer than a file system's clock stands still


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sealed run whose metrics its recorder left beside it."""
    run = many_runs.one_run(tmp_path_factory.mktemp("model"), 3, 1.5)
    cache_metrics(run, computed_metrics(open_run(run)), manifest_sha256(run))
    return run


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cache").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(run_index, "SETTLED_NS", int(A_TICK_S / 2 * 1e9))


@pytest.fixture
def home(model: Path, tmp_path: Path) -> Path:
    """Three runs, older than a tick."""
    out = tmp_path / "runs"
    for number in range(3):
        add(model, out, f"20261101T00000{number}Z-bench-aaaa", str(88123 + number))
    time.sleep(A_TICK_S)
    return out


def index_path(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "jbclog" / NAME


def add(model: Path, out: Path, name: str, order: str) -> Path:
    run = Path(shutil.copytree(model, out / name))
    amend(run, order)
    shutil.copy(model / "metrics.parquet", run / "metrics.parquet")
    rows = Records(cache=True).known(next(one for one in find(model) if isinstance(one, Found)))
    assert rows
    cache_metrics(run, rows, manifest_sha256(run))
    return run


def amend(run: Path, order: str) -> None:
    said = Metadata("A. Rossi", order, None, ["SN-1"], {"shift": order[-1]})
    write_manifest(run, replace(read_manifest(run), run=run.name, metadata=said))


Answer = tuple[list[Any], Any, Any]


def answer(home: Path, wanted: Filter, source: Any) -> Answer:
    """What the three commands print, from a source of runs."""
    runs = open_runs(home).through(source)
    of_metric = [
        (one.station, one.port, one.points, one.changes, one.warnings)
        for one in trends(runs, "idle_error_c")
    ]
    used = (
        where_used(home, "dde-1", since=SINCE, search=source.find) if any(home.iterdir()) else None
    )
    return list(source.find(home, wanted)), (of_metric, runs.unreadable), used


def expect_same(home: Path, wanted: Filter = ALL) -> None:
    direct = answer(home, wanted, Records(cache=True))
    for _ in range(2):  # what the first one wrote, the second one reads
        with run_index.run_index() as index:
            assert answer(home, wanted, index) == direct


def read_again(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The runs whose manifests are read from now on."""
    read: list[Path] = []
    whole = run_index.summary_of
    monkeypatch.setattr(
        run_index, "summary_of", lambda folder, *more: read.append(folder) or whole(folder, *more)
    )
    return read


def indexed(home: Path, wanted: Filter = ALL) -> list[Any]:
    with run_index.run_index() as index:
        return list(index.find(home, wanted))


def test_only_what_is_new_is_read(home: Path, model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = read_again(monkeypatch)
    first = indexed(home)
    assert len(read) == len(first) == 3
    assert indexed(home) == first
    assert len(read) == 3
    new = add(model, home, "20261101T000009Z-bench-aaaa", "9")
    time.sleep(A_TICK_S)
    assert [one.folder for one in indexed(home)] == [*(one.folder for one in first), new]
    assert read[3:] == [new]
    assert indexed(home, Filter(order="9")) == list(find(home, Filter(order="9"))) != []
    assert read[3:] == [new]


def test_metrics_are_measured_once(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    expect_same(home)
    measured: list[object] = []
    monkeypatch.setattr(Records, "metrics", lambda *those: measured.append(those) or [])
    with run_index.run_index() as index:
        for metric in ("idle_error_c", "recovery_s"):  # the other one was kept, too
            assert [len(one.points) for one in trends(open_runs(home).through(index), metric)] == [
                3
            ]
    assert measured == []


def measured_again(home: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The runs whose metrics are read or computed by a trend over an index that is up to date."""
    asked: list[Path] = []
    with monkeypatch.context() as patch:
        for name in ("known", "metrics"):
            whole = getattr(Records, name)
            patch.setattr(
                Records,
                name,
                lambda records, run, *more, whole=whole: (
                    asked.append(run.folder) or whole(records, run, *more)
                ),
            )
        with run_index.run_index() as index:
            trends(open_runs(home).through(index), "idle_error_c")
    return sorted({*asked})


def test_metrics_that_were_left_depend_on_the_files_that_were_left(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left, computed, _ = sorted(home.iterdir())
    (computed / "metrics.parquet").unlink()
    time.sleep(A_TICK_S)
    expect_same(home)
    assert measured_again(home, monkeypatch) == []
    for run in (left, computed):
        os.utime(run / "samples" / "part-0000.parquet")
    time.sleep(A_TICK_S)
    assert measured_again(home, monkeypatch) == [computed]
    os.utime(left / "metrics.parquet")
    time.sleep(A_TICK_S)
    assert measured_again(home, monkeypatch) == [left]
    (left / "metrics.parquet").unlink()
    assert measured_again(home, monkeypatch) == [left]
    for table in TABLES:
        shutil.rmtree(left / table)  # then both looks see the same files
    assert run_index._look_at_left(left).stamp != run_index._look_at_record(left).stamp


def test_what_was_written_just_now_is_read_again(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_index, "SETTLED_NS", int(3600 * 1e9))
    read = read_again(monkeypatch)
    assert indexed(home) == indexed(home)
    assert len(read) == 6


def test_a_run_that_continues_or_was_cut_off_is_looked_at_each_time(home: Path) -> None:
    run = home / "20261101T000001Z-bench-aaaa"
    write_manifest(run, replace(read_manifest(run), state=RunState.OPEN))
    lock = FolderLock.take(run)
    time.sleep(A_TICK_S)
    assert [one.state for one in (*indexed(home), *indexed(home))] == [
        "sealed",
        "running",
        "sealed",
    ] * 2
    expect_same(home)
    lock.remove()
    assert [one.state for one in indexed(home)] == ["sealed", "crashed", "sealed"]
    write_manifest(run, replace(read_manifest(run), state=RunState.SEALED))
    assert [one.state for one in indexed(home)] == ["sealed"] * 3


CHANGES = 18


def change(rng: random.Random, model: Path, home: Path, index: Path) -> str:
    """Change something by chance; return what."""
    runs = sorted(home.iterdir())
    one, other = rng.choice(runs), rng.choice(runs)
    manifest = one / MANIFEST

    def in_place(path: Path, data: bytes) -> None:
        """With the same size, inode and time of writing."""
        before = path.stat()
        with path.open("r+b") as file:
            file.write(data)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))

    def damaged(path: Path) -> None:
        data = bytearray(path.read_bytes())
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        in_place(path, bytes(data))

    def exchanged() -> None:
        aside = home.parent / "aside"
        one.rename(aside)
        with suppress(OSError):
            other.rename(one)
            aside.rename(other)

    def garbled() -> None:
        if index.exists():
            data = bytearray(index.read_bytes())
            for _ in range(rng.randrange(1, 30)):
                data[rng.randrange(len(data))] ^= 0xFF
            index.write_bytes(data[: rng.choice((len(data), len(data) // 2))])

    ways: dict[str, Callable[[], object]] = {
        "added": lambda: add(
            model,
            home,
            f"20261101T00{rng.randrange(10, 60)}{rng.randrange(10, 60)}Z-bench-aaaa",
            "88123",
        ),
        "strange": lambda: add(model, home, rng.choice(STRANGE), "5"),
        "removed": lambda: shutil.rmtree(one) if len(runs) > 2 else None,
        "annotated": lambda: append(
            one, who="a", what=f"SN-{rng.randrange(9)}", why="late", kind="unit.late"
        ),
        "amended": lambda: amend(one, str(rng.choice((88123, 88124)))),
        "manifest damaged": lambda: damaged(manifest),
        "manifest cut": lambda: manifest.write_bytes(manifest.read_bytes()[: rng.randrange(2000)]),
        "manifest of another run in its place": lambda: in_place(
            manifest, (other / MANIFEST).read_bytes()
        ),
        "manifest gone": lambda: manifest.unlink(missing_ok=True),
        "exchanged": exchanged,
        "samples damaged": lambda: damaged(one / "samples" / "part-0000.parquet"),
        "samples gone": lambda: shutil.rmtree(one / "samples", ignore_errors=True),
        "cache of metrics damaged": lambda: damaged(one / "metrics.parquet"),
        "cache of metrics gone": lambda: (one / "metrics.parquet").unlink(missing_ok=True),
        "times": lambda: os.utime(manifest, ns=(0, rng.choice((0, 2**62)))),
        "index garbled": garbled,
        "index gone": lambda: index.unlink(missing_ok=True),
    }
    name = rng.choice(list(ways))
    with suppress(Exception):  # what an earlier change has made impossible
        ways[name]()
    return name


@pytest.mark.parametrize("seed", range(3))
def test_with_and_without_the_index_the_answers_are_the_same(
    seed: int, home: Path, model: Path, tmp_path: Path
) -> None:
    rng, done = random.Random(seed), list[str]()
    expect_same(home)
    for _ in range(CHANGES):
        done.append(change(rng, model, home, index_path(tmp_path)))
        if rng.random() < 0.6:
            time.sleep(A_TICK_S)  # else within the same tick
        wanted = rng.choice(FILTERS)
        direct = answer(home, wanted, Records(cache=True))
        with run_index.run_index() as index:
            assert answer(home, wanted, index) == direct, done


def test_where_used_reads_again_what_it_names(home: Path) -> None:
    indexed(home)
    with run_index.run_index() as index:
        first = next(one for one in index.find(home) if isinstance(one, Found))
        forged = replace(first, order="forged", units=("forged",))
        values = attrgetter(*(name for name in Found.__dataclass_fields__ if name != "folder"))(
            forged
        )
        stamp = run_index._look(
            [str(first.folder / MANIFEST), str(first.folder / "annotations.jsonl")],
            len(str(first.folder)),
        ).stamp
        place, name = index._place(home), os.fsencode(first.folder.name)
        index._file.put(place, FOUND, name, stamp, msgspec.msgpack.encode(values))
    with run_index.run_index() as index:
        assert next(iter(index.find(home))) == forged  # as good as the index can be forged
        assert where_used(home, "dde-1", since=SINCE, search=index.find) == where_used(
            home, "dde-1", since=SINCE
        )


def test_entries_of_another_folder_are_none_of_this_one(
    home: Path, tmp_path: Path, model: Path
) -> None:
    indexed(home)
    other = tmp_path / "other"
    shutil.copytree(home, other)
    amend(other / "20261101T000000Z-bench-aaaa", "77777")
    time.sleep(A_TICK_S)
    expect_same(other)
    with sqlite3.connect(index_path(tmp_path)) as database:
        places = [place for (place,) in database.execute("SELECT DISTINCT place FROM entries")]
        assert len(places) == 2
        for one, two in (places, places[::-1]):
            rows = database.execute(
                "SELECT kind, run, stamp, data, sum FROM entries WHERE place = ?", (one,)
            ).fetchall()
            database.executemany(
                "INSERT OR REPLACE INTO entries VALUES (?, ?, ?, ?, ?, ?)",
                [(two, *row) for row in rows],
            )
    expect_same(home)
    expect_same(other)


def test_runs_that_are_gone_leave_the_index(home: Path, tmp_path: Path) -> None:
    expect_same(home)
    shutil.rmtree(home / "20261101T000001Z-bench-aaaa")
    expect_same(home)
    with sqlite3.connect(index_path(tmp_path)) as database:
        assert database.execute("SELECT count(DISTINCT run) FROM entries").fetchone() == (2,)


def test_the_commands_print_the_same(home: Path, tmp_path: Path) -> None:
    for words in (
        ["runs", str(home)],
        ["runs", str(home), "--json"],
        ["trend", str(home)],
        ["where-used", str(home), *USED],
    ):
        direct = invoked(*words, "--no-cache")
        assert direct.exit_code == 0, direct.output
        for _ in range(2):
            assert invoked(*words).output == direct.output
        index_path(tmp_path).write_bytes(b"SQLite format 3\0 and nothing else")
        assert invoked(*words).output == direct.output


USED = ("--station", "dde-1", "--since", "2020-01-01")
BESIDE = """
import sys
from pathlib import Path
from jbclog.app.index import run_index
from jbclog.record.find_runs import find
run_index.SETTLED_NS = 0
home = Path(sys.argv[1])
for _ in range(40):
    with run_index.run_index() as index:
        assert list(index.find(home)) == list(find(home))
    with run_index.run_index() as index:
        index._file.keep_only(index._place(home), "run", set())
"""


def test_two_programs_write_at_once(home: Path) -> None:
    time.sleep(A_TICK_S)
    both = [
        subprocess.Popen(
            [sys.executable, "-c", BESIDE, str(home)], stderr=subprocess.PIPE, text=True
        )
        for _ in range(2)
    ]
    assert [(one.communicate(timeout=120)[1], one.returncode) for one in both] == [("", 0)] * 2
    expect_same(home)


def test_a_program_that_writes_for_long_blocks_nobody(
    home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(index_file, "BUSY_S", 0.05)
    expect_same(home)
    with sqlite3.connect(index_path(tmp_path), isolation_level=None) as database:
        database.execute("BEGIN EXCLUSIVE")
        expect_same(home)
    assert index_path(tmp_path).exists()


@pytest.fixture
def without_home(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(IndexFile, "_opened", lambda *_: None)


@pytest.mark.usefixtures("without_home")
def test_without_a_place_for_it_there_is_no_index(home: Path) -> None:
    expect_same(home)
    assert RunIndex(IndexFile(None))._file.entries(b"", FOUND) == {}
