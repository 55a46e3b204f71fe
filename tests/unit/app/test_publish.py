"""`jbclog publish`: what is copied where, what stops it, and what a second call does."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.app import publish as publishing
from jbclog.app.publish import differences, publish
from jbclog.core.errors import RecordError, UsageError
from jbclog.record.annotations import append
from jbclog.record.folder import DERIVED_TABLES
from jbclog.record.manifest import read_manifest
from jbclog.record.published import Tree, key_of
from jbclog.record.schema import SCHEMAS
from jbclog.report.write import write_report
from support.invoked import invoked
from support.records.many_runs import many_runs, one_run

RUN = "20260921T060000Z-bench-aaaa"
PLACE = "line=bench/month=2026-09"


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return many_runs(tmp_path_factory.mktemp("runs"), [0.2])[0]


@pytest.fixture
def run(kept: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(kept, tmp_path / "runs" / kept.name))


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree.at(tmp_path / "plant")


def content(tree: Tree) -> dict[str, bytes]:
    """Every file of the tree."""
    home = Path(tree.url)
    files = (path for path in home.rglob("*") if path.is_file())
    return {path.relative_to(home).as_posix(): path.read_bytes() for path in files}


def test_the_files_of_a_run_are_copied_byte_for_byte(run: Path, tree: Tree) -> None:
    outcome = publish(run, tree)
    there = content(tree)
    assert (
        there[f"samples/{PLACE}/{RUN}.part-0000.parquet"]
        == (run / "samples" / "part-0000.parquet").read_bytes()
    )
    assert there.pop(f"runs/{PLACE}/{RUN}.json") == (run / "manifest.json").read_bytes()
    listed = {key_of(RUN, file.path): file for file in read_manifest(run).files}
    assert there == {key: (run / file.path).read_bytes() for key, file in listed.items()}
    assert outcome.files == len(listed) + 1
    assert outcome.bytes == sum(file.bytes for file in listed.values()) + len(
        (run / "manifest.json").read_bytes()
    )


def test_no_key_of_the_path_is_a_column() -> None:
    columns = {name for schema in SCHEMAS.values() for name in schema.names}
    assert not {"line", "month"} & columns


def test_the_same_run_again_changes_nothing(run: Path, tree: Tree) -> None:
    publish(run, tree)
    before = {path: path.stat().st_mtime_ns for path in Path(tree.url).rglob("*")}
    assert publish(run, tree).files == 0
    assert {path: path.stat().st_mtime_ns for path in Path(tree.url).rglob("*")} == before
    assert differences(run, tree) == []


class Stopped(Exception):
    """The publisher ends here."""


@pytest.mark.parametrize("after", range(7))
def test_interrupted_after_any_file_and_repeated_the_result_is_the_same(
    run: Path, tree: Tree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    whole = Tree.at(tmp_path / "whole")
    assert publish(run, whole).files == 7
    puts = iter(range(7))
    put = Tree.put

    def stopping(self: Tree, key: str, pieces: Iterator[bytes]) -> None:
        if next(puts) == after:
            raise Stopped
        put(self, key, pieces)

    monkeypatch.setattr(Tree, "put", stopping)
    with pytest.raises(Stopped):
        publish(run, tree)
    assert tree.runs() == []
    monkeypatch.undo()
    publish(run, tree)
    assert content(tree) == content(whole)


def test_the_manifest_comes_last(run: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
    append(run, who="A. Rossi", what="scrapped", why="cracked joint")
    keys: list[str] = []
    put = Tree.put
    monkeypatch.setattr(
        Tree, "put", lambda self, key, pieces: keys.append(key) or put(self, key, pieces)
    )
    publish(run, tree)
    assert keys[-1] == f"runs/{PLACE}/{RUN}.json"
    assert f"annotations/{PLACE}/{RUN}.jsonl" in keys[:-1]


def test_what_an_interrupted_publisher_left_is_written_again(run: Path, tree: Tree) -> None:
    """Its length alone does not show that it is whole."""
    publish(run, tree)
    Path(tree.url, "runs", PLACE, f"{RUN}.json").unlink()
    part = Path(tree.url, "samples", PLACE, f"{RUN}.part-0000.parquet")
    part.write_bytes(b"x" * part.stat().st_size)
    publish(run, tree)
    assert part.read_bytes() == (run / "samples" / "part-0000.parquet").read_bytes()


def test_a_part_that_differs_from_the_manifest_is_never_published(run: Path, tree: Tree) -> None:
    part = run / "samples" / "part-0000.parquet"
    data = bytearray(part.read_bytes())
    data[len(data) // 2] ^= 1
    part.write_bytes(data)
    with pytest.raises(RecordError, match=r"samples/part-0000\.parquet was changed: its SHA-256"):
        publish(run, tree)
    assert not Path(tree.url).exists()


def test_a_part_that_changes_while_it_is_copied_is_never_published(
    run: Path, tree: Tree, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publishing._Run, "expect_unchanged", lambda *_: None)
    part = run / "samples" / "part-0000.parquet"
    part.write_bytes(b"x" * part.stat().st_size)
    with pytest.raises(RecordError, match="changed while it was published"):
        publish(run, tree)
    assert [key for key in content(tree) if key.startswith(("samples/", "runs/"))] == []


def test_a_key_of_another_length_stops_with_both(run: Path, tree: Tree) -> None:
    key = f"events/{PLACE}/{RUN}.part-0000.parquet"
    other = Path(tree.url, key)
    other.parent.mkdir(parents=True)
    other.write_bytes(b"12345")
    size = (run / "events" / "part-0000.parquet").stat().st_size
    with pytest.raises(RecordError, match=rf"{key} has 5 bytes, the manifest says {size}"):
        publish(run, tree)
    assert content(tree) == {key: b"12345"}


def test_a_run_with_another_manifest_stops_with_both(run: Path, tree: Tree, tmp_path: Path) -> None:
    publish(run, tree)
    before = content(tree)
    other = one_run(tmp_path / "others", 0, 0.9)
    assert other.name == run.name
    with pytest.raises(RecordError, match=r"with another manifest \(fingerprint \w.*, here \w"):
        publish(other, tree)
    assert content(tree) == before


def test_annotations_are_published_again(run: Path, tree: Tree) -> None:
    publish(run, tree)
    append(run, who="A. Rossi", what="scrapped", why="cracked joint")
    assert differences(run, tree) == [
        f"annotations/{PLACE}/{RUN}.jsonl is missing, or older than annotations.jsonl in {run}"
    ]
    assert publish(run, tree).files == 1
    append(run, who="A. Rossi", what="found again", why="it was in the wrong box")
    assert publish(run, tree).files == 1
    assert differences(run, tree) == []
    there = Path(tree.url, "annotations", PLACE, f"{RUN}.jsonl")
    assert there.read_bytes() == (run / "annotations.jsonl").read_bytes()


def test_an_older_copy_takes_no_annotation_away(run: Path, tree: Tree, tmp_path: Path) -> None:
    older = Path(shutil.copytree(run, tmp_path / "older" / run.name))
    append(run, who="A. Rossi", what="scrapped", why="cracked joint")
    publish(run, tree)
    before = content(tree)
    assert publish(older, tree).files == 0
    assert content(tree) == before


def test_copies_that_were_annotated_differently_are_refused(
    run: Path, tree: Tree, tmp_path: Path
) -> None:
    other = Path(shutil.copytree(run, tmp_path / "other" / run.name))
    append(run, who="A. Rossi", what="scrapped", why="cracked joint")
    append(other, who="B. Bianchi", what="kept", why="it is good")
    publish(run, tree)
    before = content(tree)
    with pytest.raises(RecordError, match="annotated differently"):
        publish(other, tree)
    assert content(tree) == before


def test_what_was_derived_is_published_and_made_anew(run: Path, tree: Tree) -> None:
    publish(run, tree)
    write_report(run)
    assert publish(run, tree).files == 2 + len(DERIVED_TABLES)  # with annotations and report
    joints = Path(tree.url, "joints", PLACE, f"{RUN}.parquet")
    assert joints.read_bytes() == (run / "derived" / "joints.parquet").read_bytes()
    assert publish(run, tree).files == 0
    os.utime(run / "derived" / "joints.parquet", (2e9, 2e9))  # made anew
    assert publish(run, tree).files == 1


def test_two_publishers_of_one_run_do_no_harm(run: Path, tree: Tree, tmp_path: Path) -> None:
    whole = Tree.at(tmp_path / "whole")
    publish(run, whole)
    errors: list[BaseException] = []

    def publishes() -> None:
        try:
            for _ in range(5):
                publish(run, tree)
                Path(tree.url, "runs", PLACE, f"{RUN}.json").unlink(missing_ok=True)
            publish(run, tree)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=publishes) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    publish(run, tree)
    assert errors == []
    assert content(tree) == content(whole)


def test_what_a_killed_publisher_left_is_removed_after_a_day(run: Path, tree: Tree) -> None:
    folder = Path(tree.url, "samples", PLACE)
    folder.mkdir(parents=True)
    old, young = (folder / f".{RUN}.part-0000.parquet.{end}" for end in ("0123abcd", "4567abcd"))
    for left in (old, young):
        left.write_bytes(b"half")
    os.utime(old, (1e9, 1e9))
    publish(run, tree)
    assert sorted(folder.iterdir()) == [young, folder / f"{RUN}.part-0000.parquet"]


@pytest.mark.parametrize("name", ["../outside", "a/b/c", "samples/..", "/etc", "samples/"])
def test_a_manifest_names_no_file_elsewhere(name: str) -> None:
    with pytest.raises(RecordError, match="is no file of a run"):
        key_of(RUN, name)


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ("gs://bucket/path", "must be a folder or s3://"),
        ("s3://key:secret@bucket/path", "must not contain credentials"),
    ],
)
def test_a_place_is_a_folder_or_in_s3(given: str, why: str) -> None:
    with pytest.raises(UsageError, match=why) as raised:
        Tree.at(given)
    assert "secret@" not in str(raised.value)


# -- the command -----------------------------------------------------------------------------------


@pytest.fixture
def home(tmp_path: Path) -> Path:
    many_runs(tmp_path / "runs", [0.2, 0.9, -0.4])
    return tmp_path / "runs"


def test_all_publishes_what_is_missing(home: Path, tmp_path: Path) -> None:
    first = min(home.iterdir())
    table = tmp_path / "plant"
    assert invoked("publish", first, table).exit_code == 0
    ended = invoked("publish", "--all", home, table, "--json")
    assert ended.exit_code == 0
    lines = [json.loads(line) for line in ended.stdout.splitlines()]
    assert [(line["run"], line["files"] > 0) for line in lines] == [
        (path.name, path != first) for path in sorted(home.iterdir())
    ]
    assert Tree.at(table).runs() == sorted(path.name for path in home.iterdir())


def test_all_refuses_one_run_and_publishes_the_others(home: Path, tmp_path: Path) -> None:
    first, *others = sorted(home.iterdir())
    (first / "line.toml").write_text("changed")
    ended = invoked("publish", "--all", home, tmp_path / "plant")
    assert ended.exit_code == 4
    assert "line.toml was changed" in ended.stderr
    assert Tree.at(tmp_path / "plant").runs() == [path.name for path in others]


def test_a_run_that_is_not_sealed_is_left_out(home: Path, tmp_path: Path) -> None:
    first, *others = sorted(home.iterdir())
    manifest = (first / "manifest.json").read_text().replace('"state": "sealed"', '"state": "open"')
    (first / "manifest.json").write_text(manifest)
    ended = invoked("publish", "--all", home, tmp_path / "plant")
    assert ended.exit_code == 0
    assert f"{first}: crashed, not published" in ended.stderr
    assert Tree.at(tmp_path / "plant").runs() == [path.name for path in others]
    ended = invoked("publish", first, tmp_path / "plant")
    assert ended.exit_code == 4
    assert "is not sealed" in ended.stderr


def test_check_compares(home: Path, tmp_path: Path) -> None:
    table = tmp_path / "plant"
    first, second, third = sorted(home.iterdir())
    invoked("publish", "--all", home, table)
    assert invoked("publish", "--check", "--all", home, table).exit_code == 0
    part = table / "samples" / PLACE / f"{second.name}.part-0000.parquet"
    data = bytearray(part.read_bytes())
    data[100] ^= 1
    part.write_bytes(data)
    (table / "events" / PLACE / f"{second.name}.part-0000.parquet").unlink()
    (table / "runs" / PLACE / f"{third.name}.json").unlink()
    ended = invoked("publish", "--check", "--all", home, table)
    assert ended.exit_code == 1
    assert ended.stdout.splitlines() == [
        f"samples/{PLACE}/{second.name}.part-0000.parquet was changed: its SHA-256 is not the"
        " manifest's",
        f"events/{PLACE}/{second.name}.part-0000.parquet is missing",
        f"{third.name}: is not published",
        f"{table}: 3 differences (3 runs)",
    ]
    one_line = json.loads(invoked("publish", "--check", first, table, "--json").stdout)
    assert one_line == {
        "run": first.name,
        "folder": str(first),
        "table": str(table),
        "differences": [],
    }


def test_a_folder_that_cannot_be_written_is_one_line(run: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    ended = invoked("publish", run, tmp_path / "file")
    assert ended.exit_code == 4
    assert len(ended.stderr.splitlines()) == 1
    assert "Not a directory" in ended.stderr


def test_a_damaged_derived_file_stays_out_of_the_table(run: Path, tree: Tree) -> None:
    """Readers of the whole plant would stop at it; `jbclog report` makes it anew."""
    write_report(run)
    joints = run / "derived" / "joints.parquet"
    joints.write_bytes(joints.read_bytes()[:-4])
    publish(run, tree)
    assert tree.stored([key_of(run.name, "derived/joints.parquet")]) == {}


def test_a_run_or_a_folder_of_runs_is_no_table(run: Path, tmp_path: Path) -> None:
    """`jbclog publish runs/*` without TABLE would put a table among the files of the last run."""
    before = sorted(run.rglob("*"))
    for table, why in ((run, "is a run; the last argument"), (run.parent, "is a folder of runs")):
        ended = invoked("publish", run, table)
        assert (ended.exit_code, ended.stdout) == (2, "")
        assert f"{table}: {why}" in ended.stderr
    assert sorted(run.rglob("*")) == before
    assert invoked("publish", run, tmp_path / "table").exit_code == 0
    ended = invoked("publish", "--all", tmp_path / "table", tmp_path / "other")
    assert ended.exit_code == 2
    assert "is a table of published runs" in ended.stderr
