"""A serial capture with anything in it altered: damage costs only the blocks it touches, is
reported, and no damaged byte counts as valid.

docs/reference/faults.md, F-29, for captures: torn tail, bit rot in the middle, zeros, foreign and
newer files.
"""

from __future__ import annotations

import gzip
import re
import shutil
import zlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from jbclog.app.replay import open_recording
from jbclog.cli.replay import DOUBTFUL
from jbclog.core.capture_rows import CaptureRow, LinkRow
from jbclog.core.errors import RecordError
from jbclog.core.rows import COLUMN
from jbclog.record import capture_file
from jbclog.record.capture import (
    WHOLE,
    Head,
    Hole,
    count_rows,
    head_line,
    holes,
    is_done,
    mend,
    read_head,
    read_to_hole,
    rows_and_holes,
    wire_path,
)
from jbclog.record.capture_file import Block, blocks
from jbclog.record.conclude import sealed_file
from jbclog.record.manifest import Manifest, write_manifest
from jbclog.record.sealed_files import losses
from support.campaigns.awaited import RECORDING_ENDS
from support.faults.altered_files import (
    Altered,
    Count,
    bits_flipped,
    bytes_replaced,
    cut_off,
    pieces_moved,
    sectors_zeroed,
)
from support.invoked import invoked
from support.links.small_wire import BLOCKS, HEAD, ROWS, answer, write_wire
from support.readers.run_files import read_rows
from support.virtual.captured_run import recorded, relived
from support.virtual.virtual_run import line_text

KIN = zlib.crc32(head_line(HEAD).encode())


def one_block(text: bytes) -> bytes:
    """A capture of these lines in a single block."""
    return capture_file.packed(text.decode(), 0, 1, KIN)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A small file of six blocks."""
    folder = tmp_path_factory.mktemp("whole")
    path = write_wire(folder)
    assert len(list(blocks(path))) == BLOCKS
    assert list(read_rows(path)) == ROWS
    return path.read_bytes()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "dde-1.tsv.gz"


# -- what holds in every case ----------------------------------------------------------------------


def is_in_order(found: list[CaptureRow]) -> bool:
    """Whether these are rows of the file, each once and in order."""
    left = iter(ROWS)
    return all(row in left for row in found)


def pairs(rows: Iterator[CaptureRow]) -> Iterator[tuple[bytes, bytes]]:
    """Yield each question with its answers on the tape."""
    asked = b""
    for row in rows:
        if isinstance(row, LinkRow) and row.what == "sent":
            asked = row.data
        elif isinstance(row, LinkRow) and row.what == "heard":
            yield asked, row.data


def assert_holes_say_where(found: list[CaptureRow | Hole]) -> None:
    """The missing rows lie between the moments that a hole states."""
    last: float | None = None
    for one in found:
        if isinstance(one, Hole):
            assert one.after_s == last
        last = last if isinstance(one, Hole) else one.at_s
    gaps = [one for one in found if isinstance(one, Hole)]
    there = [row for row in found if not isinstance(row, Hole)]
    for row in ROWS:
        if row not in there and gaps:
            assert (
                any((one.after_s or 0) <= row.at_s <= (one.before_s or 1e9) for one in gaps)
                or row.at_s > there[-1].at_s
            )


def head_of(path: Path) -> Head | None:
    try:
        return read_head(path)
    except RecordError:
        return None


def look(path: Path, one: Altered, count: Count) -> list[CaptureRow]:
    """Return the remaining rows; none is wrong, each loss is reported, and no error is raised but
    those of a record.
    """
    path.write_bytes(one.data)
    found = list(rows_and_holes(path))
    rows = list(read_rows(path))
    assert rows == [row for row in found if not isinstance(row, Hole)]
    assert is_in_order(rows), one.how
    assert_holes_say_where(found)
    assert all(said == answer(int(asked[8:-1])) for asked, said in pairs(read_to_hole(path))), (
        one.how
    )
    assert list(read_to_hole(path)) == rows[: len(list(read_to_hole(path)))]
    told = list(losses(path))
    if rows != ROWS:
        assert told or not is_done(path), one.how
    assert count_rows(path) >= len(rows)
    assert head_of(path) == HEAD or told or not one.data, one.how
    count.add(lost=rows != ROWS)
    return rows


def lost_blocks(path: Path) -> int:
    return BLOCKS - sum(isinstance(one, Block) for one in blocks(path))


def flip(path: Path, whole: bytes, stride: int) -> Count:
    count = Count("one bit of a wire's file flipped")
    for one in bits_flipped(whole, stride):
        # as when a bit of deflate's own padding was flipped
        is_whole = look(path, one, count) == ROWS
        assert lost_blocks(path) == len(holes(path)) == len(list(losses(path))) <= 1, one.how
        assert is_whole or lost_blocks(path) == 1
        assert read_head(path) == HEAD
    print(count.told())
    return count


def walk(path: Path, whole: bytes, stride: int) -> Count:
    count = Count("a wire's file altered otherwise")
    ways = (
        cut_off(whole, stride),
        bytes_replaced(whole, stride),
        sectors_zeroed(whole, stride),
        pieces_moved(whole, stride),
    )
    for way in ways:
        for one in way:
            look(path, one, count)
            mend(path)
            assert is_in_order(list(read_rows(path))), one.how
    print(count.told())
    return count


# -- the campaign, and a slice of it ---------------------------------------------------------------


def test_flipped_bits(path: Path, whole: bytes) -> None:
    assert flip(path, whole, 13).tried > 500


def test_other_alterations(path: Path, whole: bytes) -> None:
    assert walk(path, whole, 17).tried > 200


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_every_bit_flipped(path: Path, whole: bytes) -> None:
    assert flip(path, whole, 1).wrong == 0


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_every_byte_altered_and_every_length(path: Path, whole: bytes) -> None:
    assert walk(path, whole, 1).wrong == 0


# -- holes -----------------------------------------------------------------------------------------


def block_of(whole: bytes, number: int) -> tuple[int, int]:
    """Return where a block of the file begins and ends."""
    starts = [
        place for place in range(len(whole)) if whole.startswith(capture_file.FIXED, place)
    ] + [len(whole)]
    return starts[number], starts[number + 1]


def test_a_damaged_block_is_named_with_its_bytes_lines_and_times(path: Path, whole: bytes) -> None:
    start, end = block_of(whole, 3)
    path.write_bytes(whole[: start + 60] + b"\0\0" + whole[start + 62 :])
    (told,) = losses(path)
    assert (
        told
        == f"bytes {start} to {end - 1}, lines 12 to 17: damaged; nothing is known from 0.549 s of"
        " the run (2026-09-21T14:13:20Z) to 0.579 s of the run (2026-09-21T14:13:20Z)"
    )
    assert list(read_rows(path)) == ROWS[:7] + ROWS[13:]


def test_a_block_of_which_not_a_byte_is_left_is_missed(path: Path, whole: bytes) -> None:
    start, end = block_of(whole, 3)
    path.write_bytes(whole[:start] + whole[end:])
    (told,) = losses(path)
    assert told.startswith(f"at byte {start}, lines 12 to 17: missing; nothing is known from")


def test_a_block_that_stands_there_twice_is_taken_once(path: Path, whole: bytes) -> None:
    start, end = block_of(whole, 3)
    path.write_bytes(whole[:end] + whole[start:end] + whole[end:])
    (told,) = losses(path)
    assert "no line: stands here a second time" in told
    assert list(read_rows(path)) == ROWS


def test_a_block_of_another_recording_is_known_for_one(path: Path, whole: bytes) -> None:
    other = capture_file.packed(
        "8124.0\tsent\t00\n", 3, 12, capture_file.zlib.crc32(b"another head")
    )
    start, end = block_of(whole, 3)
    path.write_bytes(whole[:start] + other + whole[end:])
    (told,) = losses(path)
    assert "lines 12 to 17: belongs to another recording" in told
    assert list(read_rows(path)) == ROWS[:7] + ROWS[13:]


def test_the_head_stands_in_more_than_one_place(path: Path, whole: bytes) -> None:
    start, _ = block_of(whole, 2)
    path.write_bytes(bytes(start) + whole[start:])
    assert read_head(path) == HEAD
    (told,) = losses(path)
    assert told.startswith(
        f"bytes 0 to {start - 1}, lines 1 to 4: damaged; nothing is known from its beginning to"
    )


def test_what_is_no_text_costs_its_block(path: Path, whole: bytes) -> None:
    """Correct checksums over bytes that no recorder writes: a block made by hand."""
    start, end = block_of(whole, 3)
    text = "8124.0\topened\tx\n"
    bad = capture_file.packed(text, 3, 12, KIN)
    path.write_bytes(bad)
    assert [one.text for one in blocks(path) if isinstance(one, Block)] == [text]
    raw = gzip.compress(b"\xff\xfe\n")
    path.write_bytes(whole[:start] + raw + whole[end:])
    assert "damaged" in next(losses(path)) or "missing" in next(losses(path))


# -- other files -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "data",
    [
        b"\0" * 5000,
        b"at_s\twhat\tdata\n",
        gzip.compress(b"\xff\xfe\n"),
        gzip.compress(b"\0" * 10**6),
        b"\x1f\x8b\x08\x08",
    ],
    ids=["zeros", "plain", "no_text", "gzipped_zeros", "head_of_gzip"],
)
def test_foreign_files(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    with pytest.raises(RecordError, match="is not a serial capture"):
        read_head(path)
    assert list(losses(path))
    assert list(read_rows(path)) == []
    assert not mend(path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b'"format": 3', b'"format": 4', "written in format 4; this jbclog knows 3"),
        (b'"station": "dde-1"', b'"station": "dde-2"', "it is that of dde-2"),
        (b'"tht.toml"', b'"../../x"', "is no recipe of this run"),
        (b"1790000000.25", b"Infinity", "is no number"),
        (b"1790000000.25", b'"soon"', "is not a serial capture"),
        (b'{"station"', b"[" * 100_000 + b'{"station"', "is not a serial capture"),
    ],
)
def test_heads_that_are_not_believed(
    path: Path, whole: bytes, old: bytes, new: bytes, said: str
) -> None:
    path.write_bytes(one_block(gzip.decompress(whole).replace(old, new)))
    with pytest.raises(RecordError, match=said):
        read_head(path)


def test_a_newer_file_that_is_packed_otherwise_says_its_format(path: Path, whole: bytes) -> None:
    """Rules of this format may not hold for a newer one, so the message gives the format, not
    damage.
    """
    path.write_bytes(
        gzip.compress(gzip.decompress(whole).replace(b'"format": 3', b'"format": 4'))[:-8]
        + b"other check sums"
    )
    with pytest.raises(RecordError, match="written in format 4; this jbclog knows 3"):
        read_head(path)


@pytest.mark.parametrize(
    "line",
    [
        "nan\tsent\t00",
        "1.0\ttold\task -5 1.0",
        "1e999\topened\tx",
        "1.0\tsent\tzz",
        "\ud800"[:0] + "x",
    ],
)
def test_lines_that_are_none_are_named(path: Path, whole: bytes, line: str) -> None:
    path.write_bytes(one_block(gzip.decompress(whole) + line.encode() + b"\n"))
    with pytest.raises(RecordError, match=r"dde-1\.tsv\.gz, line 27: "):
        list(read_rows(path))
    assert any("line 27" in told for told in losses(path))


def test_another_format_is_named(path: Path, whole: bytes) -> None:
    path.write_bytes(gzip.compress(gzip.decompress(whole).replace(b'"format": 3', b'"format": 1')))
    with pytest.raises(RecordError, match="written in format 1; this jbclog knows 3"):
        read_head(path)
    assert list(read_rows(path)) == []
    assert any("written in format 1" in text for text in losses(path))


# -- replayed --------------------------------------------------------------------------------------


def test_a_run_is_lived_through_up_to_the_hole(tmp_path: Path) -> None:
    run = recorded(tmp_path / "run", line_text(), duration_s=60)
    file = wire_path(tmp_path / "run", "dde-1")
    data = file.read_bytes()
    seen = set()
    for place in range(200, len(data), len(data) // 7):
        file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        if not [*losses(file)]:  # the time in the header of a member
            continue
        again, left = relived(tmp_path / "run")
        assert again.samples == run.memory.samples[: len(again.samples)]
        assert again.events == run.memory.events[: len(again.events)]
        assert left["dde-1"].is_cut_off
        seen.add(len(again.samples))
    assert max(seen) > 100
    assert all(row[COLUMN["quality"]] == "ok" for row in again.samples)
    shutil.rmtree(tmp_path / "run")


# -- replay reports damage before it starts --------------------------------------------------------


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A sealed run with its capture, as far as a replay reads it."""
    folder = tmp_path / "run"
    recorded(folder, line_text(), duration_s=5)
    files = [
        sealed_file(folder, file, None) for file in sorted(folder.rglob("*")) if file.is_file()
    ]
    write_manifest(folder, Manifest(folder.name, state="sealed", wire=WHOLE, files=files))
    return folder


def test_a_recording_as_it_was_made_raises_no_doubt(run: Path) -> None:
    assert open_recording(run).doubts == []


@pytest.mark.parametrize("name", ["wire/dde-1.tsv.gz", "line.toml", "recipes/recipe.toml"])
def test_what_was_changed_since_is_named(run: Path, name: str) -> None:
    """Even if all checksums in the file are right."""
    data = (run / name).read_bytes()
    (run / name).write_bytes(
        one_block(gzip.decompress(data)) if name.endswith(".gz") else data + b"\n"
    )
    assert open_recording(run).doubts == [f"{name}: was changed: its SHA-256 is not the manifest's"]


def test_a_wire_that_is_gone_is_named(run: Path) -> None:
    shutil.copy(wire_path(run, "dde-1"), run / "kept")
    recording = open_recording(run)
    wire_path(run, "dde-1").unlink()
    assert recording.doubts == ["wire/dde-1.tsv.gz: is missing"]


def test_replay_tells_of_a_hole_and_does_not_call_it_the_same(run: Path, tmp_path: Path) -> None:
    file = wire_path(run, "dde-1")
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    (run / "manifest.json").unlink()
    told = invoked("replay", run, "--record", tmp_path / "again")
    assert told.exit_code == 1, told.stderr
    first, second, *_ = told.stderr.splitlines()
    assert first.startswith("wire/dde-1.tsv.gz: bytes ")
    assert ": damaged; nothing is known from " in first
    assert second == DOUBTFUL
    assert re.search(
        rf"^dde-1: {RECORDING_ENDS} -?[\d.]+ s after the run's start, before its session$",
        told.stderr,
        re.MULTILINE,
    )
