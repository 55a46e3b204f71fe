"""Whatever happens to a journal between two looks, a follower reads each row of a marked commit
once, and no other.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

from jbclog.core.rows import COLUMN, SAMPLE_COLUMNS, TABLES
from jbclog.live.record_follower import RecordFollower
from jbclog.record.frames import Frame, FrameKind, commit_bytes, mark_bytes
from jbclog.record.part_chain import PartChain
from jbclog.record.part_writer import write_part
from jbclog.record.row_batches import BARE, decode, encode, schema_frame
from jbclog.record.schema import SEQ
from jbclog.record.segments import segment_name

STATION = "dde-1"


def sample(seq: int) -> list[object]:
    row: list[object] = [None] * len(SAMPLE_COLUMNS)
    values = {"time": seq * 100_000, "tick": seq // 2, "station": STATION, "port": 1 + seq % 2}
    for name, value in {**values, "quality": "ok", "temperature_c": 300 + seq % 9}.items():
        row[COLUMN[name]] = value
    return row


def samples(first: int, count: int) -> Frame:
    values = [value for seq in range(first, first + count) for value in sample(seq)]
    return encode("samples", values, first, TABLES.index("samples"), lambda: None)


def events(numbers: list[int]) -> Frame:
    names = BARE["events"].names
    values: list[object] = []
    for seq in numbers:
        row = dict.fromkeys(names)
        row |= {"seq": seq, "time": seq, "kind": "host.busy", "severity": "info", "text": "late"}
        row["prev_sha256"] = ""
        values += [row[name] for name in names]
    return encode("events", values, numbers[0], TABLES.index("events"), lambda: None)


def beginning(facts: str = "{}") -> list[Frame]:
    """What a segment begins with."""
    return [
        *(schema_frame(table, number) for number, table in enumerate(TABLES)),
        Frame.of(FrameKind.FACTS, facts.encode()),
        Frame.of(FrameKind.NOTES, b'{"run":"the-run","schema":2}'),
    ]


def rows_in(frames: list[Frame]) -> dict[str, list[int]]:
    """The numbers of the rows in frames."""
    numbers: dict[str, list[int]] = {}
    for frame in frames:
        if frame.kind is FrameKind.ROWS:
            table = TABLES[frame.table]
            rows = decode(frame, BARE[table], "the-run")
            numbers.setdefault(table, []).extend(rows[SEQ].to_pylist())
    return numbers


class Histories(RuleBasedStateMachine):
    """A recorder, its disk and its sealing child, and a follower that looks now and then."""

    folder: Path

    @initialize()
    def begin(self) -> None:
        for path in sorted(self.folder.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        self.commits = 0  # on the disk
        self.marked = 0
        self.utc_us = 0
        self.next_seq = {"samples": 0, "events": 0}
        # commits on the disk and their rows, by segment
        self.segments: dict[int, list[tuple[int, list[Frame]]]] = {}
        self.waiting: list[Frame] = []  # rows of a commit that failed
        self.expected: dict[str, set[int]] = {"samples": set(), "events": set()}
        self.read: dict[str, list[int]] = {"samples": [], "events": []}
        self.number = -1
        self.has_unmarked_begin = False
        self.rotate(is_marked=True)
        self.follower = RecordFollower(self.folder, self.take)

    def take(self, table: str, rows: pa.Table) -> None:
        self.read[table] += rows[SEQ].to_pylist()

    @property
    def path(self) -> Path:
        return self.folder / segment_name(self.number)

    def new_rows(self, count: int, holes: int) -> list[Frame]:
        frames = []
        if count:
            frames.append(samples(self.next_seq["samples"], count))
            self.next_seq["samples"] += count
        if holes:
            numbers = [self.next_seq["events"], self.next_seq["events"] + holes]
            frames.append(events(numbers))
            self.next_seq["events"] = numbers[-1] + 1
        return frames

    def append(self, data: bytes) -> None:
        with self.path.open("ab") as file:
            file.write(data)

    def stored(self, frames: list[Frame]) -> None:
        self.commits += 1
        self.segments[self.number].append((self.commits, frames))
        self.waiting = []

    # -- the recorder ------------------------------------------------------------------------------

    @rule(count=st.integers(0, 5), holes=st.integers(0, 2))
    def commit(self, count: int, holes: int) -> None:
        frames = [*self.waiting, *self.new_rows(count, holes)]
        if frames:
            self.append(commit_bytes(self.commits + 1, frames))
            self.stored(frames)

    @rule()
    def mark(self) -> None:
        self.utc_us += 600_000
        self.append(mark_bytes(self.commits, self.utc_us))
        self.marked = self.commits
        for commits in self.segments.values():
            for _, frames in commits:
                for table, numbers in rows_in(frames).items():
                    self.expected[table].update(numbers)

    @rule(count=st.integers(1, 5), share=st.floats(0, 1), looks=st.booleans())
    def fail_to_write(self, count: int, share: float, looks: bool) -> None:
        """The disk is full: what was written of a commit is cut off, be it the whole."""
        self.waiting += self.new_rows(count, 0)
        size = self.path.stat().st_size
        data = commit_bytes(self.commits + 1, self.waiting)
        self.append(data[: round(share * len(data))])
        if looks:
            self.look()
        with self.path.open("r+b") as file:
            file.truncate(size)

    @rule(count=st.integers(1, 5), share=st.floats(0, 1), looks=st.booleans())
    def fail_to_sync(self, count: int, share: float, looks: bool) -> None:
        """A part of the commit is in the file, or the whole, and the same rows are in a new one."""
        self.waiting += self.new_rows(count, 0)
        data = commit_bytes(self.commits + 1, self.waiting)
        self.append(data[: round(share * len(data))])
        if looks:
            self.look()
        self.rotate(is_marked=looks)

    @rule(is_marked=st.booleans())
    def rotate(self, *, is_marked: bool) -> None:
        frames = [*self.waiting, *self.new_rows(1, 0)] if self.waiting else []
        self.number += 1
        self.segments[self.number] = []
        self.append(commit_bytes(self.commits + 1, [*beginning(), *frames]))
        self.stored(frames)
        if is_marked:
            self.mark()

    @precondition(lambda self: len(self.segments) > 1)
    @rule()
    def seal_oldest(self) -> None:
        number = min(self.segments)
        commits = self.segments.pop(number)
        chain = PartChain(self.folder)
        for table in ("samples", "events"):
            pieces = [
                decode(frame, BARE[table], "the-run")
                for _, frames in commits
                for frame in frames
                if TABLES[frame.table] == table
            ]
            if pieces:
                rows = pa.concat_tables(pieces)
                rows = rows.filter(pc.greater(rows[SEQ], chain.last_seq(table)))
                chain.add(number, write_part(self.folder, table, rows, number))
                # what is sealed is on the disk, marked or not
                self.expected[table].update(rows[SEQ].to_pylist())
        (self.folder / segment_name(number)).unlink()

    # -- the follower ------------------------------------------------------------------------------

    @rule()
    def look(self) -> None:
        self.follower.read(None)
        while self.follower.read_earlier():
            pass
        assert self.follower.is_whole
        assert self.follower.damage == []
        assert self.read["events"] == sorted(self.read["events"])
        for table, numbers in self.read.items():
            assert len(numbers) == len(set(numbers))
            if self.marked == self.commits:
                assert set(numbers) == self.expected[table]
            assert set(numbers) <= self.expected[table]


def test_each_marked_row_comes_once_whatever_happens_between_two_looks(tmp_path: Path) -> None:
    run_state_machine_as_test(type("Histories", (Histories,), {"folder": tmp_path}))


@dataclass
class Written:
    """A segment with three marked commits of five samples each, and a follower of it."""

    folder: Path

    def __post_init__(self) -> None:
        self.path = self.folder / segment_name(0)
        self.ends = []
        data = b""
        for number in range(3):
            frames = [*(beginning() if not number else []), samples(5 * number, 5)]
            data += commit_bytes(number + 1, frames) + mark_bytes(number + 1, number)
            self.ends.append(len(data))
        self.data = data
        self.read: list[int] = []
        self.follower = RecordFollower(self.folder, lambda _, rows: self.read.extend(numbers(rows)))

    def look(self, data: bytes) -> tuple[list[int], list[str]]:
        """Return what was read and what is damaged when the segment holds these bytes."""
        self.path.write_bytes(data)
        self.follower.read(None)
        return self.read, self.follower.damage

    def damaged(self, commit: int) -> bytes:
        data = bytearray(self.data)
        data[self.ends[commit] - 40] ^= 1
        return bytes(data)


def numbers(rows: pa.Table) -> list[int]:
    return rows[SEQ].to_pylist()  # type: ignore[no-any-return]


def test_damage_costs_its_commit_and_is_believed_when_it_is_seen_again(tmp_path: Path) -> None:
    """Who reads while something is cut off and written anew may see half of each."""
    written = Written(tmp_path)
    assert written.look(written.damaged(1)) == ([*range(5)], [])
    assert not written.follower.is_whole
    read, damage = written.look(written.damaged(1))
    assert read == [*range(5), *range(10, 15)]
    assert len(damage) == 1
    assert damage[0].startswith("live-0000.journal: ")
    assert written.follower.is_whole


def test_what_was_read_while_it_was_written_is_no_damage(tmp_path: Path) -> None:
    written = Written(tmp_path)
    written.look(written.damaged(1))
    assert written.look(written.data) == ([*range(15)], [])


def test_a_segment_without_its_first_commit_is_read(tmp_path: Path) -> None:
    written = Written(tmp_path)
    written.look(written.damaged(0))
    read, damage = written.look(written.damaged(0))
    assert (read, len(damage)) == ([*range(5, 15)], 1)


def test_a_segment_that_lost_its_marked_end_is_read_from_its_begin(tmp_path: Path) -> None:
    """As on a network's file system, after its server has crashed."""
    written = Written(tmp_path)
    written.look(written.data)
    rewritten = commit_bytes(3, [samples(10, 8)]) + mark_bytes(3, 7)
    assert written.look(written.data[: written.ends[1]] + rewritten) == ([*range(18)], [])


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_segment_that_lost_its_end_is_damaged_when_the_next_one_shows_it(
    tmp_path: Path, lost: int
) -> None:
    written = Written(tmp_path)
    following = commit_bytes(4, [*beginning(), samples(15, 5)]) + mark_bytes(4, 4)
    (tmp_path / segment_name(1)).write_bytes(following)
    end = written.ends[2 - lost]
    read, damage = written.look(written.data[: end + 30 * (lost > 0)])
    assert read == [*range(15 - 5 * lost), *range(15, 20)]
    commits = "1 commit" if lost == 1 else f"{lost} commits"
    expected = [f"live-0000.journal: its end cannot be read, {commits}"]
    assert damage == expected[: lost > 0]


def test_no_file_is_open_between_two_looks(tmp_path: Path) -> None:
    """A follower that is stopped keeps no space of a segment that was removed."""
    written = Written(tmp_path)
    written.look(written.data)
    opened = [path.readlink() for path in Path("/proc/self/fd").iterdir() if path.exists()]
    assert written.path not in opened
