"""Sealing and recovery of a journal: every row once, whatever is damaged or interrupted; what is
lost is told to the row.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.core.rows import TABLES
from jbclog.record.check import check
from jbclog.record.damage import REMAINS, read_damage
from jbclog.record.journal_reader import Journal
from jbclog.record.manifest import read_manifest
from jbclog.record.part_chain import PartChain
from jbclog.record.parts import part_paths, row_groups
from jbclog.record.recover import Outcome, recover
from jbclog.record.seal import seal_journal
from support.faults.crash import contents
from support.records import few_rows
from support.records.journals import Counts, JournalWriter, Written, journal

COMMITS = st.lists(st.tuples(st.integers(0, 7), st.integers(0, 2)), max_size=4)
SEGMENTS = st.lists(COMMITS, min_size=1, max_size=3)
PLAIN = [[(50, 3), (50, 0)], [(40, 2)], [(10, 1)]]


@contextmanager
def written(segments: Sequence[Sequence[Counts]]) -> Iterator[JournalWriter]:
    with tempfile.TemporaryDirectory() as out:
        yield journal(Path(out), segments)


def seqs(folder: Path, table: str) -> list[int]:
    return sorted(
        seq for group in row_groups(folder, table, ["seq"]) for seq in group["seq"].to_pylist()
    )


def rows_of(commits: Sequence[Written], table: str) -> list[int]:
    return sorted({seq for commit in commits for seq in commit.rows.get(table, [])})


@given(SEGMENTS)
@settings(max_examples=20, deadline=None)
def test_what_is_recovered_is_what_was_written(segments: list[list[Counts]]) -> None:
    with written(segments) as writer:
        folder = writer.folder
        recover(folder)
        assert few_rows.sealed_numbers(folder) == [*range(writer.samples)]
        assert seqs(folder, "events") == [*range(writer.events)]
        assert check(folder) == []
        manifest = read_manifest(folder)
        assert manifest.lost is not None
        assert manifest.lost.seconds_at_most == 1.0
        (facts,) = manifest.stations
        assert facts.skipped == len(segments) - 1  # the last ones
        before = contents(folder)
        assert recover(folder).outcome is Outcome.WHOLE
        assert contents(folder) == before


@given(SEGMENTS, st.data())
@settings(max_examples=40, deadline=None)
def test_a_changed_byte_costs_its_commit_and_is_told_to_the_row(
    segments: list[list[Counts]], data: st.DataObject
) -> None:
    with written(segments) as writer:
        folder = writer.folder
        path = folder / f"live-{data.draw(st.integers(0, writer.segment)):04d}.journal"
        whole = path.read_bytes()
        at = data.draw(st.integers(0, len(whole) - 1))
        path.write_bytes(
            whole[:at] + bytes([whole[at] ^ data.draw(st.integers(1, 255))]) + whole[at + 1 :]
        )
        hit = [
            commit
            for commit in writer.commits
            if path.name == f"live-{commit.segment:04d}.journal" and commit.start <= at < commit.end
        ]
        left = [commit for commit in writer.commits if commit not in hit]
        recover(folder)
        for table in ("samples", "events"):
            assert seqs(folder, table) == rows_of(left, table)
        damage = read_damage(folder)
        lost = {table: len(rows_of(hit, table)) for table in ("samples", "events")}
        later = writer.commits[hit[0].number :] if hit else []
        followed = {table for table in lost if rows_of(later, table)}
        if not hit:
            assert damage == []
        else:
            (entry,) = damage
            told = sum(lost[table] for table in followed) if followed else None
            assert entry.rows == told
            assert path.name in entry.place
            assert (folder / REMAINS / path.name).exists()
            assert check(folder) == []


@given(SEGMENTS, st.data())
@settings(max_examples=20, deadline=None)
def test_a_cut_end_costs_what_it_cuts(segments: list[list[Counts]], data: st.DataObject) -> None:
    with written(segments) as writer:
        folder = writer.folder
        size = data.draw(st.integers(0, writer.path.stat().st_size))
        os.truncate(writer.path, size)
        left = [c for c in writer.commits if c.segment < writer.segment or c.end <= size]
        recover(folder)
        for table in ("samples", "events"):
            assert seqs(folder, table) == rows_of(left, table)
        assert read_damage(folder) == []
        assert check(folder) == []


@given(SEGMENTS)
@settings(max_examples=20, deadline=None)
def test_a_commit_that_is_there_twice_counts_once(segments: list[list[Counts]]) -> None:
    with written(segments) as writer:
        writer.again()
        writer.commit((3, 1))
        recover(writer.folder)
        assert few_rows.sealed_numbers(writer.folder) == [*range(writer.samples)]
        assert seqs(writer.folder, "events") == [*range(writer.events)]
        assert read_damage(writer.folder) == []


def test_the_last_segment_of_an_open_run_is_left_to_its_recorder(tmp_path: Path) -> None:
    writer = journal(tmp_path, PLAIN)
    last = writer.path.read_bytes()
    seal_journal(writer.folder, is_open=True)
    assert [path.name for path in writer.folder.glob("live-*")] == [writer.path.name]
    assert writer.path.read_bytes() == last
    assert seqs(writer.folder, "samples") == [*range(140)]
    assert [part.file.path for part in PartChain(writer.folder).of("samples")] == [
        "samples/part-0000.parquet",
        "samples/part-0001.parquet",
    ]
    with Journal(writer.folder) as reader:
        assert [rows["seq"].to_pylist() for rows in reader.rows("samples")] == [[*range(140, 150)]]


def test_a_table_without_rows_in_a_segment_gets_no_part(tmp_path: Path) -> None:
    writer = journal(tmp_path, [[(5, 0)], [(0, 2)], [(5, 0)]])
    seal_journal(writer.folder)
    names = {table: [path.name for path in part_paths(writer.folder, table)] for table in TABLES}
    assert names == {
        "samples": ["part-0000.parquet", "part-0002.parquet"],
        "events": ["part-0001.parquet"],
        "settings": [],
        "counters": [],
    }


# -- interrupted -----------------------------------------------------------------------------------


class Interrupted(BaseException):
    """As if the process ended there."""


class Interruption:
    """Ends the work after a number of operations that reach the disk."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, after: int) -> None:
        self.left = after
        for name in ("fsync", "fdatasync", "replace", "unlink", "mkdir"):
            monkeypatch.setattr(os, name, self._before(getattr(os, name)))
        write = pq.ParquetWriter.write_table
        monkeypatch.setattr(pq.ParquetWriter, "write_table", self._before(write))

    def _before(self, real: Callable[..., object]) -> Callable[..., object]:
        def call(*arguments: object, **more: object) -> object:
            if self.left <= 0:
                raise Interrupted
            self.left -= 1
            return real(*arguments, **more)

        return call


@pytest.mark.parametrize("each", [5, pytest.param(1, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("work", [seal_journal, recover], ids=["seal", "recover"])
def test_interrupted_at_any_step_and_done_again_it_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, work: Callable[[Path], object], each: int
) -> None:
    writer = journal(tmp_path, PLAIN)
    for steps in range(0, 1000, each):
        folder = tmp_path / str(steps) / writer.folder.name
        folder.mkdir(parents=True)
        for path in writer.folder.iterdir():
            (folder / path.name).write_bytes(path.read_bytes())
        try:
            with monkeypatch.context() as interrupted:
                Interruption(interrupted, steps)
                work(folder)
            break
        except Interrupted:
            pass
        recover(folder)
        (folder / "guard.lock").unlink(missing_ok=True)  # of a recovery that had ended but for it
        assert check(folder) == []
        if steps == 0:
            expected = contents(folder)
        assert contents(folder) == expected, steps
    assert steps > 30
