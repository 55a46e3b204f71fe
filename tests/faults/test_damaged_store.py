"""A segment of the journal with altered bytes, anywhere: never a crash, never a wrong row, never a
loss without a message.

docs/reference/faults.md, F-29: torn tail, bit rot in the middle, a block of zeros, one that cannot
be read. `tests/unit/record/test_sealing.py` has the properties of single bytes.
"""

from __future__ import annotations

import errno
import io
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from jbclog.core.files import Kind, open_regular
from jbclog.record import damage, journal_reader
from jbclog.record.check import check
from jbclog.record.damage import REMAINS, read_damage
from jbclog.record.manifest import read_manifest
from jbclog.record.recover import recover
from support.faults.altered_files import cut, zeros
from support.records import few_rows
from support.records.journals import JournalWriter, Written, journal

BLOCK = 4096
COMMITS = [[(10, 1)] * 8, [(10, 1)] * 12]
Alteration = Callable[[bytearray, int], None]


def flip(data: bytearray, place: int) -> None:
    data[place] ^= 0x20


LENGTHS: dict[Alteration, int] = {flip: 1, zeros: 512, cut: 1 << 30}
"""Bytes from a place on that an alteration changes."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> JournalWriter:
    """A run with two segments, of which nothing is sealed."""
    return journal(tmp_path_factory.mktemp("runs"), COMMITS)


def trial(written: JournalWriter, home: Path) -> Path:
    folder = home / written.folder.name
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(written.folder, folder)
    return folder


def name_of(segment: int) -> str:
    return f"live-{segment:04d}.journal"


def hit_in(written: JournalWriter, segment: int, start: int, end: int) -> list[Written]:
    """The commits of which bytes from `start` to `end` are altered."""
    return [
        commit
        for commit in written.commits
        if commit.segment == segment and commit.start < end and start < commit.end
    ]


def assert_only_these_are_lost(
    written: JournalWriter, folder: Path, hit: list[Written], *, is_torn: bool
) -> None:
    """`is_torn`: what is missing is the end of the journal, as after a crash."""
    recover(folder)
    left = [commit for commit in written.commits if commit not in hit]
    rows = [seq for commit in left for seq in commit.rows.get("samples", [])]
    events = [seq for commit in left for seq in commit.rows.get("events", [])]
    assert few_rows.sealed_numbers(folder) == rows  # each as written
    assert few_rows.table(folder, "events")["seq"].to_pylist() == events
    lost = read_manifest(folder).lost
    assert lost is not None
    if hit and not is_torn:
        assert lost.seconds_at_most is None
        name = name_of(hit[0].segment)
        assert any(entry.place.startswith(name) for entry in read_damage(folder))
        assert name in lost.text
        assert (folder / REMAINS / name).exists()
    findings = [str(finding) for finding in check(folder)]
    # a lost commit with an event breaks the chain
    assert all(text.startswith("events/: event") for text in findings), findings


def walk(written: JournalWriter, home: Path, segment: int, first: int, stride: int) -> int:
    """Alter a segment from byte `first` on at each `stride`; return how often."""
    whole = (written.folder / name_of(segment)).read_bytes()
    tried = 0
    for place in range(first, len(whole), stride):
        for alteration, length in LENGTHS.items():
            folder = trial(written, home)
            data = bytearray(whole)
            alteration(data, place)
            (folder / name_of(segment)).write_bytes(data)
            hit = hit_in(written, segment, place, place + length)
            reaches_end = place + length >= whole.rindex(b"JBCm")
            assert_only_these_are_lost(
                written, folder, hit, is_torn=segment == written.segment and reaches_end
            )
            tried += 1
    return tried


@pytest.mark.parametrize("segment", [0, 1])
def test_a_segment_altered_at_some_places(
    written: JournalWriter, tmp_path: Path, segment: int
) -> None:
    assert walk(written, tmp_path, segment, 11, 2503) >= 9


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("remainder", range(4))
@pytest.mark.parametrize("segment", [0, 1])
def test_a_segment_altered_everywhere(
    written: JournalWriter,
    tmp_path: Path,
    segment: int,
    remainder: int,
    counted: Callable[..., None],
) -> None:
    counted(alterations=walk(written, tmp_path, segment, remainder * 23, 92), wrong_rows=0)


@pytest.mark.parametrize("kept", [0, 6])
def test_a_segment_that_ends_between_two_commits(
    written: JournalWriter, tmp_path: Path, kept: int
) -> None:
    """Nothing in it is torn; the numbers of commits and rows say what is missing."""
    folder = trial(written, tmp_path)
    with (folder / name_of(0)).open("r+b") as file:
        file.truncate(written.commits[kept].start)
    hit = [commit for commit in written.commits[kept:] if commit.segment == 0]
    assert_only_these_are_lost(written, folder, hit, is_torn=False)
    lost = sum(len(rows) for commit in hit for rows in commit.rows.values())
    assert read_damage(folder)[0].rows == lost


# -- a bad sector ----------------------------------------------------------------------------------


class BadBlock(io.BytesIO):
    """A file of which the disk cannot read the block at `start`."""

    def __init__(self, data: bytes, start: int) -> None:
        super().__init__(data)
        self._start = start

    def read(self, size: int | None = -1, /) -> bytes:
        place = self.tell()
        data = super().read(size)
        if place < self._start + BLOCK and place + len(data) > self._start:
            raise OSError(errno.EIO, "Input/output error")
        return data


@contextmanager
def bad_block(name: str, start: int) -> Iterator[None]:
    """The block at `start` of the file `name` cannot be read meanwhile."""

    def opened(path: Path, kind: Kind) -> io.BufferedIOBase:
        if path.name != name:
            return open_regular(path, kind)
        return BadBlock(path.read_bytes(), start)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journal_reader, "open_regular", opened)
        patch.setattr(damage, "open_regular", opened)
        yield


@pytest.mark.parametrize("segment", [0, 1])
def test_a_block_that_cannot_be_read_costs_what_lies_there(
    written: JournalWriter, tmp_path: Path, segment: int
) -> None:
    """Also at the end of the journal, where it is no torn tail."""
    whole = (written.folder / name_of(segment)).read_bytes()
    assert len(whole) > 2 * BLOCK
    for start in range(0, len(whole), BLOCK):
        folder = trial(written, tmp_path)
        hit = hit_in(written, segment, start, start + BLOCK)
        with bad_block(name_of(segment), start):
            assert_only_these_are_lost(written, folder, hit, is_torn=False)
        kept = (folder / REMAINS / name_of(segment)).read_bytes()
        blank = bytes(len(whole[start : start + BLOCK]))
        assert kept == whole[:start] + blank + whole[start + BLOCK :]
