"""A store is checked, compacted and vacuumed; damage, a newer schema and a publisher at work are
said; nothing is read short.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from deltalake import DeltaTable, write_deltalake

import jbclog
from jbclog.analysis.run import Run
from jbclog.analysis.store import contents, reader, rows, schema
from jbclog.analysis.store.place import Place, place_of
from jbclog.analysis.store.reader import Store
from jbclog.analysis.store.schema import DATA, PARTITIONS, PROPERTY, RUNS, TABLES
from jbclog.app.publish import commits, lease, publisher, safe_place, upkeep
from jbclog.app.publish.commits import create_tables, fence
from jbclog.app.publish.lease import Lease, live
from jbclog.app.publish.publisher import Publisher, Result
from jbclog.app.publish.upkeep import Checked, check, compact, vacuum
from jbclog.core.errors import RecordError, StoreError, UsageError
from jbclog.record import annotations
from support.invoked import invoked
from support.records.many_runs import many_runs
from support.records.plant_store import published

AT_ONCE = timedelta(0)
OF_THIS_RELEASE = Path(__file__).parents[3] / "data" / "stores" / "schema-1"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return many_runs(tmp_path_factory.mktemp("runs"), [0.2, 0.9, -0.4])


@pytest.fixture(scope="module")
def filled(runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Place:
    return published(tmp_path_factory.mktemp("plant") / "store", *runs)


@pytest.fixture
def place(filled: Place, tmp_path: Path) -> Place:
    shutil.copytree(filled.url, tmp_path / "a store")
    return place_of(tmp_path / "a store")


def files(place: Place, table: str) -> list[Path]:
    return [
        Path(place.of(table), *path.split("/"))
        for path in DeltaTable(place.of(table)).get_add_actions()["path"].to_pylist()
    ]


def on_line(*words: object) -> tuple[int, dict[str, object]]:
    ended = invoked(*words, "--json")
    return ended.exit_code, json.loads(ended.stdout)


# -- check -----------------------------------------------------------------------------------------


def test_nothing_is_wrong(place: Place, runs: list[Path]) -> None:
    code, found = on_line("store", "check", place.url)
    assert (code, found["agrees"], found["runs"], found["findings"], found["leftovers"]) == (
        0,
        True,
        len(runs),
        [],
        [],
    )


def test_half_a_table_deleted_is_found_and_not_read(place: Place) -> None:
    victim = sorted(Path(place.of("samples")).rglob("*.parquet"))[0]
    victim.unlink()
    code, found = on_line("store", "check", place.url)
    assert code == 1
    assert [
        text for text in found["findings"] if victim.name in text and "is missing" in text
    ] != []
    with pytest.raises(RecordError, match="samples are incomplete"):
        [*jbclog.open_runs(place.url).samples()]


def test_rows_that_somebody_deleted_are_found_and_not_read(place: Place, runs: list[Path]) -> None:
    DeltaTable(place.of("joints")).delete(f"run = '{runs[1].name}' AND joint > 2")
    found = check(place, AT_ONCE)
    assert [
        text
        for text in found.findings
        if text.startswith(f"joints: {runs[1].name} version 1: 2 of ")
    ] != []
    with pytest.raises(RecordError, match="joints are incomplete: 2 of"):
        jbclog.open_run(f"{place}/{runs[1].name}").joints()


def test_a_table_without_its_log_is_named(place: Place) -> None:
    shutil.rmtree(Path(place.of("metrics"), "_delta_log"))
    assert [
        text for text in check(place, AT_ONCE).findings if "its table metrics is missing" in text
    ] != []
    ended = invoked("trend", place.url)
    assert ended.exit_code == 4
    assert "metrics is missing" in ended.output


def test_metrics_that_lack_are_an_error_of_the_trend(place: Place, runs: list[Path]) -> None:
    DeltaTable(place.of("metrics")).delete(f"run = '{runs[1].name}' AND metric = 'recovery_s'")
    ended = invoked("trend", place.url)
    assert ended.exit_code == 4
    assert "metrics are incomplete" in ended.output


def test_a_changed_manifest_is_noticed(
    place: Place, runs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = Store.files_of
    monkeypatch.setattr(
        Store, "files_of", lambda self, one: [(name, data + b" ") for name, data in real(self, one)]
    )
    with pytest.raises(RecordError, match="its manifest was changed"):
        jbclog.open_run(f"{place}/{runs[0].name}")


def test_no_store_is_said(tmp_path: Path) -> None:
    code, found = on_line("store", "check", tmp_path)
    assert code == 2
    assert "no store" in str(found["problems"])


# -- interrupted publishers ------------------------------------------------------------------------


def leave(place: Place, publication: str = "abcdefabcdef-1") -> None:
    """Rows in samples of which `runs` knows nothing."""
    found = DeltaTable(place.of("samples"))
    rows = found.to_pyarrow_table().slice(0, 5)
    mine = rows.set_column(
        rows.schema.get_field_index("publication"),
        rows.schema.field("publication"),
        pa.array([publication] * 5),
    )
    write_deltalake(found, mine, mode="append")


def test_leftovers_count_for_nobody_and_are_removed(
    place: Place, filled: Place, runs: list[Path]
) -> None:
    leave(place)
    before = len(jbclog.open_runs(place.url)[0].samples())
    assert before == len(jbclog.open_runs(filled.url)[0].samples())
    found = check(place, AT_ONCE)
    assert len(found.leftovers) == len(found.removed) == 1
    assert check(place, AT_ONCE).leftovers == []
    assert len(jbclog.open_runs(place.url)[0].samples()) == before


TRIALS = ["_probe-12ab34cd.a", "_probe-12ab34cd/0/_delta_log/x.json"]


def tried(place: Place, name: str, age: timedelta) -> Path:
    """A file of a trial of the place, written so long ago."""
    path = Path(place.of(name))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"1")
    written = time.time() - age.total_seconds()
    os.utime(path, (written, written))
    return path


@pytest.mark.parametrize("name", TRIALS)
def test_what_a_killed_trial_of_the_place_left_is_removed(place: Place, name: str) -> None:
    tried(place, name, lease.VALID * 2)
    found = check(place, AT_ONCE)
    assert (found.findings, found.notes, found.removed) == ([], [], [name.partition("/")[0]])
    assert [*Path(place.url).glob("_probe*")] == []


@pytest.mark.parametrize("name", TRIALS)
def test_a_trial_of_a_publisher_that_starts_stays(place: Place, name: str) -> None:
    """It has no lease yet. Its newest file counts, because a trial takes a while."""
    tried(place, name.replace("x.json", "w.json"), lease.VALID * 2)
    path = tried(place, name, lease.VALID / 2)
    found = check(place, AT_ONCE)
    assert (found.findings, found.removed, path.is_file()) == ([], [], True)
    (said,) = found.notes
    assert said == f"{name.partition('/')[0]}: a trial of the place, younger than 1 h"


def test_a_check_in_the_midst_of_a_trial_does_not_disturb_it(
    place: Place, runs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    race = safe_place._race
    asked: list[Checked] = []

    def beside(at: Place, name: str) -> None:
        race(at, name)
        asked.append(check(at, AT_ONCE))

    monkeypatch.setattr(safe_place, "_race", beside)
    with Publisher(place) as one:
        assert one.publish(runs[0]).result is Result.THERE
    assert [one.removed for one in asked] == [[]] * safe_place.ROUNDS
    assert [*Path(place.url).glob("_probe*")] == []


def test_a_trial_does_not_wait_for_a_writer_that_never_starts(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread that is refused memory in its first lines ends without an error."""
    monkeypatch.setattr(safe_place, "STARTS_S", 0.2)
    monkeypatch.setattr(
        safe_place, "ThreadPoolExecutor", lambda threads: ThreadPoolExecutor(threads - 1)
    )
    with pytest.raises(StoreError, match=r"of 4 threads at least one did not start within 0\.2 s"):
        safe_place.expect_safe(place)
    assert [*Path(place.url).glob("_probe*")] == []


def test_a_trial_whose_threads_cannot_be_started_ends_at_once(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Refused(ThreadPoolExecutor):
        """The system refuses the last thread."""

        left = safe_place.WRITERS - 1

        def submit(self, *given: Any, **named: Any) -> Future[Any]:
            if not self.left:
                raise RuntimeError("can't start new thread")
            self.left -= 1
            return super().submit(*given, **named)

    monkeypatch.setattr(safe_place, "ThreadPoolExecutor", Refused)
    began = time.monotonic()
    with pytest.raises(RuntimeError, match="can't start new thread"):
        safe_place.expect_safe(place)
    assert time.monotonic() - began < safe_place.STARTS_S / 2
    assert [*Path(place.url).glob("_probe*")] == []


def test_a_lease_of_the_moment_of_the_check_stays(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is taken after the check has looked who is at work."""
    taken: list[Lease] = []

    def swept(at: Place, left: object) -> list[tuple[str, str]]:
        taken.append(Lease(at))
        return []

    monkeypatch.setattr(upkeep, "swept", swept)
    assert check(place, AT_ONCE).removed == []
    assert [one.publisher for one in live(place)] == [taken[0].publisher]


def test_a_name_with_a_quote_removes_no_other_rows(place: Place) -> None:
    """It would end the text in the condition of what is deleted."""
    leave(place, "x' OR run <> '")
    assert len(check(place, AT_ONCE).removed) == 1
    found = check(place, AT_ONCE)
    assert (found.findings, found.leftovers) == ([], [])


def test_beside_a_publisher_nothing_is_removed(place: Place) -> None:
    leave(place)
    with Publisher(place):
        found = check(place, AT_ONCE)
        assert found.removed == []
        assert f"process {os.getpid()} on {socket.gethostname()}" in found.notes[0]
    assert check(place, AT_ONCE).removed != []


def test_a_publisher_that_was_only_slow_does_not_name_what_was_removed(
    runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Somebody removed its lease and its rows while it slept, right before its last commit."""
    place = place_of(tmp_path / "store")
    from jbclog.app.publish import publisher

    made = publisher.commit_run

    def asleep(*words: object) -> bool:
        monkeypatch.setattr(lease.Found, "is_live", property(lambda _: False))
        assert check(place, AT_ONCE).removed != []
        monkeypatch.undo()
        return made(*words)  # type: ignore[arg-type]  # as they came

    with Publisher(place) as one:
        monkeypatch.setattr(publisher, "commit_run", asleep)
        with pytest.raises(RecordError, match="publish again"):
            one.publish(runs[0])
        assert len(jbclog.open_runs(place.url)) == 0
        assert one.publish(runs[0]).result is Result.PUBLISHED
    assert len(jbclog.open_runs(place.url)[0].samples()) > 0


def test_a_fence_excludes_a_commit_of_the_same_moment(place: Place) -> None:
    """It is a commit to `runs` of the same application; who read the table before cannot commit."""
    stale = DeltaTable(place.of(RUNS))
    assert fence(place, lambda _: ["abcdefabcdef-1"]) == ["abcdefabcdef-1"]
    from deltalake.exceptions import CommitFailedError

    from jbclog.app.publish.commits import APPLICATION, properties

    row = stale.to_pyarrow_table().slice(0, 1)
    with pytest.raises(CommitFailedError):
        write_deltalake(stale, row, mode="append", commit_properties=properties((APPLICATION, 99)))


def test_leases_of_other_hosts_end_after_an_hour(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = Lease(place)
    assert len(live(place)) == 1
    monkeypatch.setattr(lease, "boot_id", lambda: "another boot")
    assert len(live(place)) == 1
    monkeypatch.setattr(lease, "VALID", timedelta(0))
    assert live(place) == []
    held.release()


def test_the_holders_of_many_leases_are_not_asked_for_without_end(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, asked, holder = [Lease(place) for _ in range(3)], list[str](), lease._holder
    monkeypatch.setattr(lease, "_holder", lambda at, name: asked.append(name) or holder(at, name))
    assert {one.holder is None for one in live(place)} == {False}
    assert sorted(asked) == sorted(one.publisher for one in held)
    asked.clear()
    monkeypatch.setattr(lease, "ASKED_S", 0.0)
    assert [one.holder for one in live(place)] == [None] * len(held)  # renewed within the hour
    assert asked == []


# -- compact and vacuum ----------------------------------------------------------------------------


def test_joined_files_have_the_same_rows_in_the_same_order(place: Place, filled: Place) -> None:
    code, found = on_line("store", "compact", place.url)
    assert (code, found["tables"]["samples"]) == (0, {"replaced": 3, "by": 1})
    for here, there in zip(jbclog.open_runs(filled.url), jbclog.open_runs(place.url), strict=True):
        for table in ("samples", "events", "joints", "alarms"):
            pd.testing.assert_frame_equal(getattr(there, table)(), getattr(here, table)())
        pd.testing.assert_frame_equal(there.metrics(), here.metrics())
    assert check(place, AT_ONCE).findings == []
    leave(place)
    compact(place)
    assert len(check(place, AT_ONCE).removed) == 1  # also from a file that it shares with others
    pd.testing.assert_frame_equal(
        jbclog.open_runs(place.url)[1].samples(), jbclog.open_runs(filled.url)[1].samples()
    )


def test_the_log_of_a_table_is_not_read_once_for_each_table(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have thousands of commits."""
    read: list[str] = []
    whole = Place.table
    monkeypatch.setattr(Place, "table", lambda at, name: read.append(name) or whole(at, name))
    compact(place)
    assert Counter(read) == Counter([*TABLES, RUNS])
    read.clear()
    vacuum(place)
    assert Counter(read) == Counter(TABLES)


@pytest.fixture
def in_parts(runs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    """A store to which each run was committed in ten parts, each larger than the one before."""

    def split(run: Run, table: str) -> Iterator[pa.Table]:
        for piece in contents.rows_of(run, table):
            bounds = [2**part - 1 for part in range(10)]
            ends = [*bounds[1:], piece.num_rows]
            yield from (
                piece.slice(begin, end - begin)
                for begin, end in zip(bounds, ends, strict=True)
                if begin < piece.num_rows
            )

    monkeypatch.setattr(publisher, "rows_of", split)
    monkeypatch.setattr(commits, "BATCHES", 1)
    return published(tmp_path / "in parts", *runs)


def test_a_run_in_parts_has_its_rows_in_order_after_compaction(
    in_parts: Place, filled: Place
) -> None:
    assert compact(in_parts)["samples"][0] > 20
    rows = DeltaTable(in_parts.of("samples")).to_pyarrow_table()["row"].to_pylist()
    assert any(after < before for before, after in pairwise(rows) if after)  # not in order there
    for here, there in zip(
        jbclog.open_runs(filled.url), jbclog.open_runs(in_parts.url), strict=True
    ):
        for table in ("samples", "events", "joints", "alarms"):
            pd.testing.assert_frame_equal(getattr(there, table)(), getattr(here, table)())
        pd.testing.assert_frame_equal(
            there.samples(columns=["tick"]), here.samples(columns=["tick"])
        )


def test_rows_in_any_order_come_in_theirs_a_piece_at_a_time(
    place: Place, filled: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "BATCH_ROWS", 37)
    table = DeltaTable(place.of("samples")).to_pyarrow_table()
    write_deltalake(place.of("samples"), table.sort_by([("row", "descending")]), mode="overwrite")
    for here, there in zip(jbclog.open_runs(filled.url), jbclog.open_runs(place.url), strict=True):
        pd.testing.assert_frame_equal(there.samples(), here.samples())


def test_files_whose_rows_alternate_are_read_in_the_order_of_the_rows(
    place: Place, filled: Place
) -> None:
    table = DeltaTable(place.of("samples")).to_pyarrow_table()
    odd = pc.bit_wise_and(table["row"], 1)
    for value, mode in ((0, "overwrite"), (1, "append")):
        write_deltalake(place.of("samples"), table.filter(pc.equal(odd, value)), mode=mode)  # type: ignore[call-overload]
    for here, there in zip(jbclog.open_runs(filled.url), jbclog.open_runs(place.url), strict=True):
        pd.testing.assert_frame_equal(there.samples(), here.samples())


def test_rows_with_strange_numbers_are_refused(place: Place) -> None:
    table = DeltaTable(place.of("samples")).to_pyarrow_table()
    numbers = pc.subtract(10**12, table["row"])
    changed = table.set_column(table.schema.get_field_index("row"), "row", numbers)
    write_deltalake(place.of("samples"), changed, mode="overwrite")
    with pytest.raises(RecordError, match=r"samples have a row numbered 10{12}, and only 300 rows"):
        jbclog.open_runs(place.url)[0].samples()


def test_an_annotation_after_compaction_is_a_version(
    place: Place, runs: list[Path], tmp_path: Path
) -> None:
    compact(place)
    own = Path(shutil.copytree(runs[0], tmp_path / runs[0].name))
    annotations.append(own, who="A. Rossi", what="a remark", why="a test")
    with Publisher(place) as one:
        assert one.publish(own).result is Result.VERSIONED
    assert check(place, AT_ONCE).findings == []


def test_vacuum_below_seven_days_or_beside_a_publisher_is_refused(place: Place) -> None:
    compact(place)
    before = sum(path.is_file() for path in Path(place.url).rglob("*"))
    code, found = on_line("store", "vacuum", place.url, "--days", 6.9)
    assert (code, "must be 7 or more" in str(found["problems"])) == (2, True)
    with Publisher(place), pytest.raises(UsageError, match="a publisher is at work"):
        vacuum(place)
    assert sum(path.is_file() for path in Path(place.url).rglob("*")) == before
    assert on_line("store", "vacuum", place.url)[1]["deleted"]["samples"] == 0  # they are younger


def test_vacuum_deletes_what_no_version_needs(
    place: Place, filled: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    stray = Path(
        place.of("samples"), "line=bench", "month=2026-09", "part-of-a-killed-publisher.parquet"
    )
    stray.write_bytes(b"cut off")
    os.utime(stray, (0, 0))
    assert vacuum(place)["samples"] == 1
    assert not stray.exists()
    assert len(jbclog.open_runs(place.url)[0].samples()) == len(
        jbclog.open_runs(filled.url)[0].samples()
    )


# -- schema ----------------------------------------------------------------------------------------


def test_a_store_of_a_newer_schema_is_refused(place: Place, runs: list[Path]) -> None:
    DeltaTable(place.of(RUNS)).alter.set_table_properties(
        {PROPERTY: "2"}, raise_if_not_exists=False
    )
    for words in (
        ["runs", place.url],
        ["store", "check", place.url],
        ["publish", str(runs[0]), place.url],
    ):
        ended = invoked(*words)
        assert ended.exit_code == 4
        assert "written with schema 2; this jbclog knows 1" in ended.output


@pytest.fixture
def newer(monkeypatch: pytest.MonkeyPatch) -> Iterator[pa.Schema]:
    """A later jbclog, whose metrics have one column more."""
    grown = schema.OWN["metrics"].append(pa.field("method", pa.utf8()))
    made = contents._computed

    def computed(run: jbclog.Run, table: str) -> pa.Table:
        if table != "metrics":
            return made(run, table)
        with pytest.MonkeyPatch.context() as before:
            before.setattr(contents, "OWN", schema_before)
            old = made(run, table)
        return old.append_column("method", pa.array(["by a later release"] * old.num_rows))

    schema_before = dict(schema.OWN)
    changed = {**schema_before, "metrics": grown}
    with pytest.MonkeyPatch.context() as later:
        for module in (schema, contents, reader):
            later.setattr(module, "OWN", changed)
        later.setattr(contents, "_computed", computed)
        yield grown


def test_a_store_of_this_release_is_read(tmp_path: Path) -> None:
    """`tests/data/stores` was written when the schema had number 1."""
    shutil.copytree(OF_THIS_RELEASE, tmp_path / "store")
    (run,) = jbclog.open_runs(tmp_path / "store")
    assert (len(run.samples()), len(run.events()), len(run.joints()), len(run.metrics())) == (
        60,
        0,
        0,
        42,
    )
    assert run.samples()["temperature_c"].iloc[-1] == 350
    assert run.manifest.line is not None
    assert check(place_of(tmp_path / "store"), AT_ONCE).findings == []


def test_a_column_more_is_added_and_older_readers_read_on(
    tmp_path: Path, runs: list[Path], newer: pa.Schema
) -> None:
    place = place_of(shutil.copytree(OF_THIS_RELEASE, tmp_path / "store"))
    with Publisher(place) as one:
        assert one.publish(runs[1]).result is Result.PUBLISHED
    table = DeltaTable(place.of("metrics")).to_pyarrow_table(columns=["run", "method"]).to_pylist()
    expected = {True: "by a later release", False: None}
    assert {(row["run"] == runs[1].name, row["method"]) for row in table} == {*expected.items()}
    for one in Store(place).runs():
        (piece,) = Store(place).pieces("metrics", one, ["metric", "method"])
        assert {*piece["method"].to_pylist()} == {expected[one.identity.run == runs[1].name]}


def test_an_older_publisher_adds_to_a_store_with_a_column_more(
    place: Place, tmp_path: Path, runs: list[Path]
) -> None:
    from deltalake.schema import Field, PrimitiveType

    DeltaTable(place.of("metrics")).alter.add_columns([Field("method", PrimitiveType("string"))])
    own = Path(shutil.copytree(runs[0], tmp_path / runs[0].name))
    annotations.append(own, who="A. Rossi", what="a remark", why="a test")
    with Publisher(place) as one:
        assert one.publish(own).result is Result.VERSIONED
    assert len(jbclog.open_runs(place.url).metrics()) == len(runs) * len(
        jbclog.open_run(own).metrics()
    )


def add_run(place: Place, like: Path, **changed: str | None) -> None:
    """A row in `runs`, like that of another run but for these values."""
    table = DeltaTable(place.of(RUNS))
    row = table.to_pyarrow_table(filters=[("run", "=", like.name)])
    for name, value in changed.items():
        row = row.set_column(
            row.schema.get_field_index(name), row.schema.field(name), pa.array([value], pa.utf8())
        )
    write_deltalake(table, row, mode="append")


@pytest.mark.parametrize("name", ["..", ".", "", "a/b", "/tmp/x", "a\0b", "x" * 300])
def test_a_run_that_is_named_as_no_folder_is_refused(
    place: Place, runs: list[Path], name: str
) -> None:
    """Its files would be written elsewhere."""
    add_run(place, runs[0], run=name)
    for reads in (lambda: len(jbclog.open_runs(place.url)), lambda: check(place, AT_ONCE)):
        with pytest.raises(StoreError, match="which no run is named"):
            reads()


@pytest.mark.parametrize(
    "name",
    ["../x", "/tmp/x", "", "a/b/c", "recipes/..", "a\0b", "x" * 300, "manifest.json/x", "recipes/"],
)
def test_a_kept_file_that_no_run_has_is_refused(
    place: Place, runs: list[Path], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    real = Store.files_of
    monkeypatch.setattr(Store, "files_of", lambda self, one: [*real(self, one), (name, b"x")])
    with pytest.raises(RecordError, match=r"which no run has|cannot be written"):
        jbclog.open_run(f"{place}/{runs[0].name}")


@pytest.mark.parametrize("line", ["line 4 = \"tin\" & 'lead'", "Łódź/1:%", "..", None])
def test_a_run_of_an_odd_line_is_looked_up(
    place: Place, runs: list[Path], line: str | None
) -> None:
    add_run(place, runs[0], run="an odd one", line=line)
    for _ in range(2):
        found = Store(place).newest("an odd one")
        assert found is not None
        assert (found.line, found.month) == (line, "2026-09")
        assert [one.line for one in Store(place).runs() if one.identity.run == "an odd one"] == [
            line
        ]
        compact(place)


@pytest.mark.parametrize("line", ["line 4 = \"tin\" & 'lead'", "Łódź/1:%", "..", None])
def test_odd_names_in_partitions_come_back(tmp_path: Path, line: str | None) -> None:
    place = place_of(tmp_path / "store")
    create_tables(place)
    rows = pa.table(
        {"unit": ["SN-1", "SN-2"], "begin": [None, None], "end": [None, None]},
        schema=schema.OWN["units"],
    )
    partition = {"line": line, "month": "2026-09"}
    for number in range(2):
        batches = contents.stamped([rows], "units", "a run", f"abc-{number}", partition)
        rows_of = pa.RecordBatchReader.from_batches(schema.schema_of("units"), batches)
        write_deltalake(DeltaTable(place.of("units")), rows_of, mode="append")
    DeltaTable(place.of("units")).optimize.compact()
    dataset = Store(place).dataset("units")
    import pyarrow.compute as pc

    mine = pc.field("line").is_null() if line is None else pc.field("line") == line
    assert dataset.count_rows(filter=mine) == 4
    assert dataset.to_table(columns=[*PARTITIONS])["line"].to_pylist() == [line] * 4
    assert [path for path in tmp_path.iterdir() if path.name != "store"] == []


def test_tables_are_all_known() -> None:
    assert {*TABLES} == {*DATA, RUNS}
    assert TABLES[-1] == RUNS
