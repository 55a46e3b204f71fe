"""Runs are published whole, once, and anew where annotations were added; what is not a whole sealed
run is refused.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest
from deltalake import DeltaTable

import jbclog
from jbclog.analysis.store.place import Place, place_of
from jbclog.analysis.store.reader import Store
from jbclog.analysis.store.schema import DATA, RECORD, TABLES
from jbclog.app.publish import commits, publisher
from jbclog.app.publish.folder import NOT_SEALED, publish_all
from jbclog.app.publish.follow import Follower
from jbclog.app.publish.publisher import Publisher, Result
from jbclog.core.errors import RecordError
from jbclog.record import annotations
from jbclog.record.manifest import RunState, read_manifest, write_manifest
from support.records import sealed_run, small_run
from support.records.plant_store import published

NAME = 'a plant\'s "store" = 100 % – Łódź'  # what a folder of a user may be called


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run.make_run(tmp_path_factory.mktemp("runs"), 12.0)


@pytest.fixture(scope="module")
def filled(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Place:
    """A store with this run."""
    return published(tmp_path_factory.mktemp("plant") / NAME, folder)


@pytest.fixture
def place(filled: Place, tmp_path: Path) -> Place:
    """A copy of that store, to change."""
    shutil.copytree(filled.url, tmp_path / "store")
    return place_of(tmp_path / "store")


@pytest.fixture
def own(folder: Path, tmp_path: Path) -> Path:
    """A copy of the run, to change."""
    return Path(shutil.copytree(folder, tmp_path / "runs" / folder.name))


def rows(place: Place) -> dict[str, int]:
    return {name: DeltaTable(place.of(name)).to_pyarrow_dataset().count_rows() for name in TABLES}


def versions(place: Place) -> dict[str, int]:
    return {name: DeltaTable(place.of(name)).version() for name in TABLES}


def says(folder: Path, what: str, kind: str = "note") -> None:
    annotations.append(folder, who="A. Rossi", what=what, why="a test", kind=kind)


@pytest.fixture
def publishing(place: Place) -> Iterator[Publisher]:
    with Publisher(place) as one:
        yield one


@pytest.mark.parametrize("table", [*RECORD, "joints", "metrics", "units", "alarms"])
def test_every_cell_comes_back(folder: Path, filled: Place, table: str) -> None:
    """Nulls stay null with their reasons, types and order are those of the folder."""
    import pandas as pd

    here, there = jbclog.open_run(folder), jbclog.open_run(Path(filled.url) / folder.name)
    expected = getattr(here, table)()
    assert len(expected)
    pd.testing.assert_frame_equal(getattr(there, table)(), expected)


def test_units_and_time_zones_are_in_the_schema(filled: Place) -> None:
    schema = DeltaTable(filled.of("samples")).to_pyarrow_dataset().schema
    assert schema.field("temperature_c").metadata == {
        b"unit": "°C".encode(),
        b"command": b"R-TTx R-ATx",
    }
    assert schema.field("time").type == pa.timestamp("us", tz="UTC")
    assert schema.field("scan_us").metadata == {b"unit": "µs".encode()}
    assert DeltaTable(filled.of("alarms")).to_pyarrow_dataset().schema.field("peak_c").metadata == {
        b"unit": "°C".encode()
    }


def test_each_table_is_partitioned_by_line_and_month(filled: Place) -> None:
    for name in TABLES:
        table = DeltaTable(filled.of(name))
        assert table.metadata().partition_columns == ["line", "month"]
        assert table.partitions() in ([], [{"line": "bench", "month": "2026-09"}])


def test_publishing_again_changes_nothing(
    folder: Path, place: Place, publishing: Publisher
) -> None:
    before = versions(place)
    for _ in range(2):
        assert publishing.publish(folder).result is Result.THERE
    assert versions(place) == before


def test_a_renamed_copy_is_the_same_run(own: Path, place: Place, publishing: Publisher) -> None:
    assert publishing.publish(own.rename(own.parent / "renamed")).result is Result.THERE


def test_an_annotated_run_is_a_new_version_and_its_record_is_not_copied(
    own: Path, place: Place, publishing: Publisher
) -> None:
    before = rows(place)
    says(own, "SN-LATE", annotations.LATE)
    done = publishing.publish(own)
    assert (done.result, done.version) == (Result.VERSIONED, 2)
    after = rows(place)
    assert [after[name] - before[name] for name in RECORD] == [0, 0, 0, 0]
    assert after["runs"] == before["runs"] + 1
    (run,) = jbclog.open_runs(place.url)
    assert "SN-LATE" in [*run.units()["unit"]]
    assert len(jbclog.open_runs(place.url, unit="SN-LATE")) == 1
    # the older one is kept
    assert [one.version for one in Store(place).every_version()] in ([1, 2], [2, 1])
    assert publishing.publish(own).result is Result.THERE


def test_an_older_copy_adds_nothing(
    folder: Path, own: Path, place: Place, publishing: Publisher
) -> None:
    says(own, "a remark")
    publishing.publish(own)
    before = rows(place)
    assert publishing.publish(folder).result is Result.OLDER
    assert rows(place) == before


def test_a_report_alone_is_no_new_version(own: Path, place: Place, publishing: Publisher) -> None:
    annotations.append(
        own,
        who="jbclog report",
        what="report.json SHA-256 " + "0" * 64,
        why="-",
        kind=annotations.VOUCHED,
    )
    from jbclog.analysis.store.identity import Step, identity_of

    known = Store(place).newest(own.name)
    assert known is not None
    assert identity_of(own).step(known.identity) is Step.NOTHING


def test_copies_that_were_annotated_differently_are_refused(
    own: Path, place: Place, publishing: Publisher, tmp_path: Path
) -> None:
    other = Path(shutil.copytree(own, tmp_path / "other" / own.name))
    says(own, "here")
    says(other, "there")
    publishing.publish(own)
    before = rows(place)
    with pytest.raises(RecordError, match="annotated differently"):
        publishing.publish(other)
    assert rows(place) == before


def test_another_run_of_the_same_name_is_refused(
    folder: Path, place: Place, publishing: Publisher, tmp_path: Path
) -> None:
    other = sealed_run.seal(
        tmp_path,
        [sealed_run.station(rows=100)],
        sealed_run.table(sealed_run.samples(100)),
        run=folder.name,
    )
    with pytest.raises(RecordError, match="another manifest"):
        publishing.publish(other)


def test_a_run_whose_check_fails_is_refused_and_leaves_nothing(own: Path, tmp_path: Path) -> None:
    (own / "recipes" / "extra.toml").write_text("x = 1\n")
    place = place_of(tmp_path / "empty")
    with (
        Publisher(place) as one,
        pytest.raises(RecordError, match="is not in the manifest; nothing was published"),
    ):
        one.publish(own)
    assert set(rows(place).values()) == {0}


def test_a_run_that_is_not_sealed_is_refused(own: Path, publishing: Publisher) -> None:
    write_manifest(own, replace(read_manifest(own), state=RunState.OPEN))
    with pytest.raises(RecordError, match="is not sealed"):
        publishing.publish(own)
    assert [str(one) for one in publish_all(publishing, own)] == [f"{own}: {NOT_SEALED}"]


@pytest.mark.parametrize("name", ["..", "", "a/b", "/tmp/x"])
def test_a_run_that_is_named_as_no_folder_is_refused(
    own: Path, publishing: Publisher, name: str
) -> None:
    write_manifest(own, replace(read_manifest(own), run=name))
    with pytest.raises(RecordError, match="as no run is named; nothing was published"):
        publishing.publish(own)


def test_what_fails_half_way_is_removed_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that is no kill: the publisher takes its own rows out."""
    place = place_of(tmp_path / "store")

    def failing(run: jbclog.Run, table: str) -> Iterator[pa.Table]:
        if table == "joints":
            raise RecordError("the disk fails")
        return made(run, table)

    made = publisher.rows_of
    with Publisher(place) as one:
        monkeypatch.setattr(publisher, "rows_of", failing)
        with pytest.raises(RecordError, match="the disk fails"):
            one.publish(folder)
        assert set(rows(place).values()) == {0}
        monkeypatch.undo()
        assert one.publish(folder).result is Result.PUBLISHED


def test_two_at_once_leave_one_copy(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other one publishes between our look and our commit: ours is taken out again."""
    place = place_of(tmp_path / "store")
    with Publisher(place) as first, Publisher(place) as second:
        made = publisher.commit_run

        def late(*words: object) -> bool:
            monkeypatch.undo()
            assert second.publish(folder).result is Result.PUBLISHED
            return made(*words)  # type: ignore[arg-type]  # as they came

        monkeypatch.setattr(publisher, "commit_run", late)
        assert first.publish(folder).result is Result.THERE
    (run,) = jbclog.open_runs(place.url)
    assert rows(place)["samples"] == len(run.samples()) == len(jbclog.open_run(folder).samples())
    assert rows(place)["runs"] == 1


def test_who_decided_before_another_commit_decides_anew(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other one publishes between our reading of `runs` and our commit to it: the library
    refuses ours.
    """
    place, made = place_of(tmp_path / "store"), publisher._Writing._row
    with Publisher(place) as first, Publisher(place) as second:

        def slow(self: publisher._Writing, runs: DeltaTable) -> pa.Table | None:
            chosen = made(self, runs)
            monkeypatch.undo()
            others.append(second.publish(folder).result)
            return chosen

        others: list[Result] = []
        monkeypatch.setattr(publisher._Writing, "_row", slow)
        assert first.publish(folder).result is Result.THERE
    # asked twice: the commit after the first decision was refused
    assert others == [Result.PUBLISHED, Result.THERE]
    assert rows(place)["runs"] == 1
    assert rows(place)["samples"] == len(jbclog.open_run(folder).samples())


def test_a_commit_whose_answer_was_lost_is_found_again(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The storage made the commit and reported a conflict: it is ours, and its rows stay."""
    place, made = place_of(tmp_path / "store"), commits.committed

    def unanswered(place: Place, commit: object) -> bool:
        made(place, commit)  # type: ignore[arg-type]  # as it came
        return False

    with Publisher(place) as one:
        made_run = publisher.commit_run

        def losing(*words: object) -> bool:
            calls = iter([unanswered])
            monkeypatch.setattr(commits, "committed", lambda *these: next(calls, made)(*these))
            return made_run(*words)  # type: ignore[arg-type]  # as they came

        monkeypatch.setattr(publisher, "commit_run", losing)
        done = one.publish(folder)
    assert (done.result, done.version) == (Result.PUBLISHED, 1)
    assert rows(place)["runs"] == 1
    assert len(jbclog.open_runs(place.url)[0].samples()) == rows(place)["samples"]


def test_a_folder_is_published_run_by_run_and_one_blocks_no_other(
    own: Path, tmp_path: Path
) -> None:
    (own / "manifest.json").write_bytes(
        (own / "manifest.json").read_bytes().replace(b"bench", b"bensh")
    )
    sealed_run.seal(
        own.parent, [sealed_run.station(rows=100)], sealed_run.table(sealed_run.samples(100))
    )
    with Publisher(place_of(tmp_path / "store")) as one:
        done = [str(each) for each in publish_all(one, own.parent)]
    assert [text for text in done if "published (version 1)" in text] != []
    assert [text for text in done if "digest" in text] != []
    assert len(jbclog.open_runs(tmp_path / "store")) == 1


def test_a_follower_publishes_what_is_sealed_and_annotated_meanwhile(
    own: Path, tmp_path: Path
) -> None:
    with Publisher(place_of(tmp_path / "store")) as one:
        follower = Follower(one, own.parent)
        assert [str(each) for each in follower.poll()] == [f"{own.name}: published (version 1)"]
        assert [*follower.poll()] == []
        says(own, "a remark")
        assert [str(each) for each in follower.poll()] == [f"{own.name}: new version (version 2)"]
        sealed_run.seal(
            own.parent, [sealed_run.station(rows=100)], sealed_run.table(sealed_run.samples(100))
        )
        assert len([*follower.poll()]) == 1


def test_every_table_has_the_rows_that_runs_counts(filled: Place) -> None:
    (one,) = Store(filled).runs()
    assert {name: one.rows[name] for name in DATA} == {name: rows(filled)[name] for name in DATA}
