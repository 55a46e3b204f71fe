"""The writer of segments: whatever the disk does, what was acknowledged is read back, each row
once, and nothing that was never handed over.
"""

from __future__ import annotations

import errno
import io
from collections.abc import Mapping
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.core.rows import TABLES
from jbclog.record import segments
from jbclog.record.frames import Commit, FrameKind, Mark, read_items
from jbclog.record.run_journal import RowBuffer
from jbclog.record.segments import (
    RESERVE,
    RESERVE_BYTES,
    Disk,
    Kept,
    SegmentWriter,
    segment_name,
)
from support.faults.disk_model import ERRORS, ModelDisk
from support.records import few_rows
from support.records.journal_rows import read_files

RUN = "run"
FOLDER = Path("/nowhere") / RUN


class Recorder:
    """Hands rows over and commits them, as `RunJournal` does; remembers what was acknowledged."""

    def __init__(self, disk: Disk) -> None:
        self.writer = SegmentWriter(FOLDER, disk)
        self.buffer = RowBuffer(RUN, lambda table, error: pytest.fail(f"{table}: {error}"))
        self.rows = 0
        self.acknowledged = 0
        self.commits = 0

    def begin(self) -> None:
        self.writer.begin({"run": RUN}, 0)
        self.commits = self.writer.commits

    def add(self, rows: int) -> None:
        for number in range(self.rows, self.rows + rows):
            self.buffer.counter(few_rows.counter(number))
            self.buffer.event(few_rows.event(number))
            facts = few_rows.facts()
            facts.outages = number + 1
            facts.touched = [number]
            self.buffer.facts(facts)
        self.rows += rows

    def commit(self) -> Kept:
        self.buffer.take(0.0)
        notes = {"rows": self.rows}
        kept = self.writer.commit(self.buffer.backlog, self.buffer.changed_facts, notes, self.rows)
        if kept.is_safe:
            self.buffer.stored()
            self.acknowledged = self.rows
            self.commits = self.writer.commits
        return kept

    def expect(self, files: Mapping[str, bytes], removed_rows: int = 0) -> None:
        """What is read is what was handed over up to some row, and all that was acknowledged."""
        journal = read_files(files)
        for table in ("counters", "events"):
            rows = journal.rows[table]
            assert set(range(removed_rows, self.acknowledged)) <= rows.keys()
            end = max(rows, default=self.acknowledged - 1) + 1
            assert end <= self.rows
            assert rows.keys() >= {*range(removed_rows, end)}
            for seq, row in rows.items():
                assert row["value"] == (seq if table == "counters" else 1.5 * seq)
        assert journal.marked <= self.commits
        if self.acknowledged:
            assert int(str(journal.facts["a"]["outages"])) >= self.acknowledged
            assert int(str(journal.notes["rows"])) >= self.acknowledged
            assert journal.notes["run"] == RUN


STEPS = st.lists(st.sampled_from(["add", "add", "commit", "commit", "idle", "rotate"]), max_size=12)
FAILURES = st.dictionaries(st.integers(0, 60), st.sampled_from(ERRORS), max_size=4)


@settings(max_examples=80, deadline=None)
@given(steps=STEPS, failures=FAILURES, seed=st.integers(0, 1 << 32))
def test_what_was_acknowledged_survives_any_failure_and_any_crash(
    steps: list[str], failures: dict[int, int], seed: int
) -> None:
    rng = Random(seed)
    disk = ModelDisk(failures, rng)
    recorder = Recorder(disk)
    try:
        recorder.begin()
    except OSError:
        return  # no station was touched
    removed_rows = 0
    for step in steps:
        if step == "add":
            recorder.add(rng.randint(1, 4))
        elif step == "commit":
            recorder.commit()
        elif step == "idle":
            recorder.writer.mark(recorder.acknowledged)
        else:
            try:
                recorder.writer.rotate(recorder.acknowledged)
            except OSError:
                continue
            recorder.commits = recorder.writer.commits
            if rng.random() < 0.5:
                present = recorder.writer.path.name
                for name in [*disk.names]:  # sealed: they are not needed any more
                    if name < present:
                        del disk.names[name]
                removed_rows = recorder.acknowledged
        recorder.expect(disk.after_kill(), removed_rows)
        for _ in range(3):
            recorder.expect(disk.after_crash(rng), removed_rows)
    kept = recorder.commit()
    if kept.is_safe:
        recorder.expect(disk.after_crash(rng), removed_rows)


@settings(max_examples=30, deadline=None)
@given(failures=FAILURES, seed=st.integers(0, 1 << 32))
def test_a_disk_that_is_well_again_takes_everything(failures: dict[int, int], seed: int) -> None:
    """After at most one commit for each failure."""
    disk = ModelDisk(failures, Random(seed))
    recorder = Recorder(disk)
    try:
        recorder.begin()
    except OSError:
        return
    for _ in range(70):
        recorder.add(1)
        kept = recorder.commit()
    assert disk.failed == len(failures)
    assert kept.is_safe
    journal = read_files(disk.after_kill())
    assert journal.rows["events"].keys() == {*range(70)}
    assert sorted({*journal.commits}) == [*range(1, recorder.writer.commits + 1)]
    assert journal.marked == recorder.writer.commits


def failing(number: int, error: int) -> ModelDisk:
    return ModelDisk({number: error}, Random(1))


# operations of a commit after those of the begin: reserve, create, write, sync, sync of the folder,
# mark
BEGIN = 6


def test_a_full_disk_is_cut_back_and_the_reserve_serves_the_second_attempt() -> None:
    disk = failing(BEGIN, errno.ENOSPC)
    recorder = Recorder(disk)
    recorder.begin()
    recorder.add(3)
    kept = recorder.commit()
    assert (kept.is_safe, kept.moved_to) == (True, None)
    assert "No space left" in str(kept.trouble)
    assert [*disk.names] == [segment_name(0)]
    assert [type(item) for item in items(disk, 0)] == [Commit, Mark, Commit, Mark]


@pytest.mark.parametrize("operation", ["write", "sync"])
def test_after_an_error_of_the_disk_nothing_more_is_written_to_that_file(operation: str) -> None:
    disk = failing(BEGIN + (operation == "sync"), errno.EIO)
    recorder = Recorder(disk)
    recorder.begin()
    recorder.add(3)
    kept = recorder.commit()
    assert (kept.is_safe, kept.moved_to) == (True, segment_name(1))
    size = len(disk.names[segment_name(0)].data)
    recorder.add(3)
    assert recorder.commit() == segments.KEPT
    assert len(disk.names[segment_name(0)].data) == size
    first = items(disk, 1)[0]
    assert isinstance(first, Commit)
    assert [frame.kind for frame in first.frames].count(FrameKind.SCHEMA) == len(TABLES)


@pytest.mark.parametrize("error", segments.FULL)
@pytest.mark.parametrize("has_reserve", [True, False])
def test_after_a_sync_without_space_nothing_more_is_written_to_that_file(
    error: int, has_reserve: bool
) -> None:
    """The system may have dropped what it could not sync: a later sync of that file proves
    nothing. The reserve serves the new segment at once; without it, the next commit tries again.
    """
    failures = {BEGIN + 1: error}
    if not has_reserve:
        failures[BEGIN + 2] = error
    disk = ModelDisk(failures, Random(1))
    recorder = Recorder(disk)
    recorder.begin()
    recorder.add(3)
    assert recorder.commit().is_safe is has_reserve
    size = len(disk.names[segment_name(0)].data)
    recorder.add(3)
    assert recorder.commit().is_safe
    assert len(disk.names[segment_name(0)].data) == size
    assert [*disk.names] == [segment_name(0), segment_name(1)]
    assert read_files(disk.after_kill()).rows["events"].keys() == {*range(6)}


def items(disk: ModelDisk, number: int) -> list[object]:
    return [*read_items(io.BytesIO(disk.names[segment_name(number)].data))]


def test_a_disk_on_which_one_segment_after_the_other_fails_is_a_failing_one() -> None:
    writes = dict.fromkeys(range(BEGIN, 400, 7), errno.EIO)
    recorder = Recorder(ModelDisk(writes, Random(1)))
    recorder.begin()
    moved = []
    for _ in range(40):
        recorder.add(1)
        kept = recorder.commit()
        if kept.trouble:
            moved.append(kept.moved_to)
    assert None not in moved[: segments.MOST_FAILED]
    assert moved[-1] is None


def test_a_segment_that_cannot_begin_leaves_the_present_one_as_it_is() -> None:
    disk = failing(BEGIN + 3, errno.ENOSPC)  # a commit of three operations, then the creation
    recorder = Recorder(disk)
    recorder.begin()
    recorder.add(2)
    recorder.commit()
    with pytest.raises(OSError, match="No space"):
        recorder.writer.rotate(0)
    recorder.add(2)
    assert recorder.commit() == segments.KEPT
    assert [*disk.names] == [segment_name(0)]


def test_more_frames_than_a_commit_holds_are_several_commits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(segments, "FRAMES_A_COMMIT", 2)
    disk = ModelDisk({}, Random(1))
    recorder = Recorder(disk)
    recorder.begin()
    recorder.add(2)
    recorder.buffer.setting(few_rows.setting(0))
    assert recorder.commit().is_safe
    assert [item.number for item in items(disk, 0) if isinstance(item, Mark)] == [3, 6]
    recorder.expect(disk.after_kill())


# -- on a real disk --------------------------------------------------------------------------------


def test_bytes_of_a_row(tmp_path: Path) -> None:
    """The bounds of commits of one row and of 200, marks among them."""
    for rows, bound in ((1, 400), (200, 25)):
        folder = tmp_path / str(rows)
        folder.mkdir()
        writer = SegmentWriter(folder)
        writer.begin({"run": RUN}, 0)
        before = (folder / segment_name(0)).stat().st_size
        buffer = RowBuffer(RUN, lambda table, error: None)
        for number in range(10 * rows):
            buffer.sample(few_rows.sample(number))
            if number % rows == rows - 1:
                buffer.take(0.0)
                assert writer.commit(buffer.backlog, {}, {}, 0) == segments.KEPT
                buffer.stored()
        writer.close()
        size = (folder / segment_name(0)).stat().st_size - before
        assert size / (10 * rows) <= bound


def test_a_segment_or_folder_that_was_removed_takes_nothing(tmp_path: Path) -> None:
    writer = SegmentWriter(tmp_path)
    writer.begin({}, 0)
    assert (tmp_path / RESERVE).stat().st_size == RESERVE_BYTES
    (tmp_path / segment_name(0)).rename(tmp_path / "elsewhere")
    (tmp_path / segment_name(0)).symlink_to(tmp_path / "elsewhere")
    assert "was removed during the run" in str(writer.commit((), {}, {"x": 1}, 0).trouble)
    with pytest.raises(OSError, match="removed"):
        writer.rotate(0)
    writer.close()
    assert not (tmp_path / RESERVE).exists()
