"""The file of a wire: what is written is read again to the bit, and whatever a crash leaves of it
can be read.
"""

from __future__ import annotations

import errno
import gzip
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jbclog.core.capture_rows import CaptureRow, LinkRow, ResultRow
from jbclog.core.errors import RecordError
from jbclog.record import capture_recorder
from jbclog.record.capture import (
    Head,
    count_rows,
    head_line,
    is_done,
    mend,
    read_head,
    read_to_hole,
    wire_path,
    wire_paths,
)
from jbclog.record.capture_file import FIXED, WINDOW, Gap, blocks, line_of, packed, row_of
from jbclog.record.capture_recorder import WireRecorder
from jbclog.record.check import check
from jbclog.record.manifest import Manifest, read_manifest, write_manifest
from jbclog.record.recover import recover
from support.readers.run_files import read_rows
from support.records.few_rows import abandoned
from support.records.small_run import make_run

HEAD = Head(
    "dde-1",
    "/dev/ttyUSB0",
    "tht.toml",
    8123.480001251,
    1_790_000_000.25,
    90.0,
    "fit",
    jbclog="0.1.0",
)
QUESTION, ANSWER = b"\x020001RSMN\x03\x02", b"\x020100ASMN DDE\x03U"


def some_rows(count: int) -> Iterator[CaptureRow]:
    """What a session of so many exchanges leaves."""
    yield ResultRow(8123.5, "told", "wait")
    yield LinkRow(8123.51, "opened", text="/dev/ttyUSB0")
    for number in range(count):
        at_s = 8124.0 + number * 0.0147123
        yield LinkRow(at_s, "sent", QUESTION)
        yield LinkRow(at_s + 0.014, "heard", ANSWER)
        yield ResultRow(at_s + 0.0140021, "told", "ask", len(ANSWER), at_s - 1.7e-6)
    yield ResultRow(8200.0, "broke", "listen", text='the "port"\tis\ngone…')
    yield ResultRow(8201.0, "done", "wait")


ROWS = list(some_rows(300))
ENDS_EARLY = (
    "wire/dde-1.tsv.gz ends before its session: at most the last 1 s are missing, or what"
    " wire.failed says."
)
HEADS = 5  # of 11 blocks or so: in those of numbers 0, 1, 2, 4 and 8


def written(folder: Path, rows: list[CaptureRow], *, writes: int = 10, close: bool = True) -> Path:
    """The file of these rows, written in so many pieces."""
    folder.mkdir(exist_ok=True)
    recorder = WireRecorder(folder)
    keep = recorder.begin(HEAD)
    for place, row in enumerate(rows):
        keep(row)
        if place % (len(rows) // writes + 1) == 0:
            recorder.write()
    recorder.write()
    if close:
        recorder.close()
        assert recorder.troubles() == []
    return wire_path(folder, "dde-1")


# -- the format ------------------------------------------------------------------------------------

moments = st.floats(0, 1e9)
texts = st.text(max_size=40)
rows_made_up = st.one_of(
    st.builds(
        LinkRow,
        moments,
        st.sampled_from(["sent", "heard"]),
        st.binary(min_size=1, max_size=40),
        st.just(""),
    ),
    st.builds(
        LinkRow,
        moments,
        st.sampled_from(["opened", "failed", "lost", "closed"]),
        st.just(b""),
        texts,
    ),
    st.builds(
        ResultRow,
        moments,
        st.just("told"),
        st.just("ask"),
        st.integers(0, 4096),
        moments,
        st.just(""),
        moments,
    ),
    st.builds(
        ResultRow,
        moments,
        st.just("told"),
        st.sampled_from(["listen", "wait", "reopen"]),
        st.integers(0, 4096),
        st.just(0.0),
        st.just(""),
        moments,
    ),
    st.builds(
        ResultRow,
        moments,
        st.sampled_from(["broke", "stopped"]),
        st.sampled_from(["ask", "wait"]),
        st.just(0),
        st.just(0.0),
        texts,
        st.just(0.0),
    ),
)


@settings(max_examples=40)
@given(rows_made_up)
def test_a_row_comes_back_to_the_bit(row: CaptureRow) -> None:
    line = line_of(row)
    assert line.count("\n") == 1
    assert line.count("\t") == 2
    assert row_of(line) == row


NO_ROWS = (
    "",
    "1.0\tsent",
    "x\tsent\t00",
    "1.0\tsent\t0",
    "1.0\tsang\tla",
    "1.0\ttold\tsing 1",
    "1.0\ttold\task x",
)


@pytest.mark.parametrize("line", NO_ROWS)
def test_what_is_no_row(line: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        row_of(line)


def test_the_file_opens_with_other_tools(tmp_path: Path) -> None:
    path = written(tmp_path, ROWS)
    with gzip.open(path, "rt") as file:
        assert next(file) == "at_s\twhat\tdata\n"
    table = pd.read_csv(path, sep="\t", dtype={"data": str})
    assert list(table.columns) == ["at_s", "what", "data"]
    assert len(table) == count_rows(path)
    assert table["what"].value_counts()["run"] == HEADS
    assert len(table) == len(ROWS) + HEADS
    assert bytes.fromhex(table.loc[table["what"] == "heard", "data"].iloc[-1]) == ANSWER


def test_what_was_kept_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path, ROWS)
    assert read_head(path) == HEAD
    assert list(read_rows(path)) == ROWS
    assert list(read_to_hole(path)) == ROWS
    assert is_done(path)
    assert not mend(path)
    assert path.stat().st_size < 40 * 300


def test_a_port_is_closed_behind_the_end_of_its_session(tmp_path: Path) -> None:
    path = written(tmp_path, [*ROWS, LinkRow(8201.1, "closed")])
    assert is_done(path)
    path.write_bytes(path.read_bytes()[:-1])
    assert not is_done(path)


def test_a_file_that_is_none(tmp_path: Path) -> None:
    path = tmp_path / "x.tsv.gz"
    members = [
        gzip.compress(text) for text in (b"one\ttwo\n1\t2\n", b"at_s\twhat\tdata\n1.0\tsent\t00\n")
    ]
    for data in (b"", b"at_s\twhat\tdata\n", *members):
        path.write_bytes(data)
        with pytest.raises(RecordError, match="is not a serial capture"):
            read_head(path)


def test_a_file_of_a_newer_jbclog(tmp_path: Path) -> None:
    path = written(tmp_path, ROWS[:2])
    text = gzip.decompress(path.read_bytes()).replace(b'"format": 3', b'"format": 4')
    path.write_bytes(gzip.compress(text))
    with pytest.raises(RecordError, match="format 4; this jbclog knows 3"):
        read_head(path)


def test_a_line_that_is_no_row_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, ROWS[:20])
    text = gzip.decompress(path.read_bytes()).decode().replace("opened", "opine")
    path.write_bytes(packed(text, 0, 1, zlib.crc32(head_line(HEAD).encode())))
    with pytest.raises(RecordError, match="line 6: opine"):
        list(read_rows(path))


# -- what a crash leaves ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    "tail", [b"", b"\0" * 300, FIXED, os.urandom(300)], ids=["cut", "zeros", "a beginning", "noise"]
)
def test_wherever_it_was_cut_off_it_is_mended_to_whole_rows(tmp_path: Path, tail: bytes) -> None:
    path = written(tmp_path, ROWS, close=False)
    whole = path.read_bytes()
    for end in [*range(1, 40), *range(40, len(whole), 397), len(whole)]:
        path.write_bytes(whole[:end] + tail)
        before = list(read_rows(path))
        assert before == ROWS[: len(before)]
        cut = mend(path)
        assert path.stat().st_size == end + len(tail) - cut
        assert list(read_rows(path)) == before
        if end >= len(FIXED):
            assert gzip.decompress(path.read_bytes()).endswith(b"\n") or not before
            assert not mend(path)
    assert before == ROWS


def test_what_is_none_of_ours_is_not_cut(tmp_path: Path) -> None:
    path = tmp_path / "dde-1.tsv.gz"
    for data in (b"\0" * 300, b"a letter", gzip.compress(b"a letter\n")[:-3]):
        path.write_bytes(data)
        assert not mend(path)
        assert path.read_bytes() == data


@pytest.mark.parametrize("kind", ["a file", "a link", "a pipe"])
def test_what_takes_its_name_while_it_is_read_is_not_cut(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    path, aside, foreign = written(tmp_path, ROWS, close=False), tmp_path / "a", tmp_path / "b"
    torn = path.read_bytes()[:-1]
    path.write_bytes(torn)
    content = torn * 2  # longer than what is left of the capture
    foreign.write_bytes(content)
    really = os.pread

    def swapping(descriptor: int, size: int, at: int) -> bytes:
        if not aside.exists():
            path.rename(aside)
            if kind == "a link":
                path.symlink_to(foreign)
            elif kind == "a pipe":
                os.mkfifo(path)
            else:
                foreign.replace(path)
        return really(descriptor, size, at)

    monkeypatch.setattr(os, "pread", swapping)
    with pytest.raises(OSError, match="replaced" if kind == "a file" else f"is {kind}, not"):
        mend(path)
    monkeypatch.undo()
    assert aside.read_bytes() == torn
    assert (path if kind == "a file" else foreign).read_bytes() == content


def test_half_a_second_is_what_a_cut_takes_at_most(tmp_path: Path) -> None:
    """Up to each write all rows are there without what follows."""
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    for place, row in enumerate(ROWS[:100], start=1):
        keep(row)
        recorder.write()
        assert len(list(read_rows(wire_path(tmp_path, "dde-1")))) == place
    recorder.close()


def test_recover_closes_it_and_says_so(tmp_path: Path) -> None:
    folder = abandoned(tmp_path)
    write_manifest(folder, Manifest(folder.name, wire="open"))
    path = written(folder, ROWS[:-1], close=False)
    recover(folder)
    manifest = read_manifest(folder)
    assert manifest.wire == ENDS_EARLY
    listed = {file.path: file.rows for file in manifest.files}
    assert listed["wire/dde-1.tsv.gz"] == count_rows(path) == len(ROWS) - 1 + HEADS
    assert check(folder) == []
    assert list(read_rows(path)) == ROWS[:-1]


def test_recover_knows_one_that_had_ended_before(tmp_path: Path) -> None:
    for rows, said in ((ROWS, "whole"), (ROWS[:-1], ENDS_EARLY)):
        folder = abandoned(tmp_path / str(len(rows)))
        write_manifest(folder, Manifest(folder.name, wire="open"))
        written(folder, rows)
        recover(folder)
        assert read_manifest(folder).wire == said


def test_check_looks_at_it_too(tmp_path: Path) -> None:
    folder = make_run(tmp_path, seconds=2.0)
    path = written(folder, ROWS[:50])
    assert [str(finding) for finding in check(folder)] == [
        "wire/dde-1.tsv.gz: is not in the manifest"
    ]
    assert wire_paths(folder) == [path]


# -- what goes wrong while it is written -----------------------------------------------------------


def failing(monkeypatch: pytest.MonkeyPatch, after: int) -> None:
    """A disk that is full after so many bytes, in the middle of a write."""
    write, left = os.write, [after]

    def full(descriptor: int, data: memoryview) -> int:
        if not left[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done = write(descriptor, data[: left[0]])
        left[0] -= done
        return done

    monkeypatch.setattr(capture_recorder.os, "write", full)


@pytest.mark.parametrize("after", [0, 5, 100, 1000, 3000])
def test_a_full_disk_ends_this_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    failing(monkeypatch, after)
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    for row in ROWS:
        keep(row)
        recorder.write()
    (said,) = recorder.news()
    assert (
        said == "wire/dde-1.tsv.gz cannot be written any further: No space left on device. The run"
        " continues without it."
    )
    assert recorder.news() == []
    recorder.close()
    path = wire_path(tmp_path, "dde-1")
    if after < 300:  # not even its first block
        assert not path.exists()  # an empty file would be no wire record
        return
    assert not mend(path)  # it was closed properly
    rows = list(read_rows(path))
    assert rows == ROWS[: len(rows)]
    assert len(rows) >= (after - 1200) // 100


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "wire").write_text("a file is in its way")
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    keep(ROWS[0])
    recorder.write()
    recorder.close()
    (said,) = recorder.troubles()
    assert "Not a directory" in said


def test_it_gives_way_to_the_record_where_room_is_short(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(capture_recorder, "LEAST_FREE", 1 << 60)
    recorder = WireRecorder(tmp_path)
    recorder.begin(HEAD)(ROWS[0])
    recorder.write()
    (said,) = recorder.news()
    assert "are free on the disk, and the record needs them" in said


def test_a_disk_that_hangs_takes_no_more_memory_than_there_is_for_it(tmp_path: Path) -> None:
    recorder = WireRecorder(tmp_path)
    keep = recorder.begin(HEAD)
    for _ in range(capture_recorder.MOST_ROWS + 10):
        keep(ROWS[0])
    recorder.write()
    assert "the disk was too slow for it" in recorder.news()[0]
    recorder.close()
    assert list(read_rows(wire_path(tmp_path, "dde-1"))) == []


def test_trouble_with_one_wire_leaves_the_others(tmp_path: Path) -> None:
    (tmp_path / "wire").mkdir()
    wire_path(tmp_path, "dde-1").write_text("here already")
    recorder = WireRecorder(tmp_path)
    keeps = [recorder.begin(head) for head in (HEAD, Head("dde-2", "x", "tht.toml", 1.0, 2.0))]
    recorder.start()
    for keep in keeps:
        keep(ROWS[0])
    recorder.close()
    assert len(recorder.news()) == 1
    assert list(read_rows(wire_path(tmp_path, "dde-2"))) == ROWS[:1]
    assert wire_path(tmp_path, "dde-1").read_text() == "here already"


def test_the_window_is_one_that_every_reader_has() -> None:
    assert WINDOW <= zlib.MAX_WBITS


def test_a_large_file_without_a_block_takes_little_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.tsv.gz"
    with path.open("wb") as file:
        file.truncate(300 << 20)
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = peak_kib()
    (gap,) = blocks(path)
    assert isinstance(gap, Gap)
    assert (gap.start, gap.end) == (0, 300 << 20)
    assert peak_kib() - before < 64 << 10


def peak_kib() -> int:
    (line,) = (
        line
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("VmHWM")
    )
    return int(line.split()[1])
