"""Serial captures that unpack to far more than a recorder's: refused in one line within their
limits, neither counted nor cut.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from jbclog.record import capture_file
from jbclog.record.capture import COLUMNS, Head, count_rows, head_line, mend, wire_path
from jbclog.record.capture_file import FIXED, MOST_LINES, Block, Gap, blocks, packed
from jbclog.record.check import check
from jbclog.record.recover import recover
from jbclog.record.sealed_files import losses
from support.faults.large_stores import crashed_run, small_batches
from support.faults.wire_bombs import beginnings, heads_in_one_another

HEAD = head_line(Head("a", "/dev/ttyUSB0", "tht.toml", 1.0, 1_790_000_000.0))
KIN = zlib.crc32(HEAD.encode())


def block_file(path: Path, texts: list[str]) -> None:
    """A capture of blocks with these lines after its head."""
    path.parent.mkdir(exist_ok=True)
    data, line = b"", 1
    for number, text in enumerate([COLUMNS + HEAD, *texts]):
        data += packed(text, number, line, KIN)
        line += text.count("\n")
    path.write_bytes(data)


def rows(count: int, size: int = 4) -> str:
    return "".join(f"{1.0 + number / 1000!r}\theard\t{'00' * size}\n" for number in range(count))


def test_blocks_of_a_million_lines_are_one_line_and_no_lines(tmp_path: Path) -> None:
    """Without limits `recover` took 44 s and sealed 90 million lines."""
    folder = crashed_run(tmp_path, small_batches([1, 2, 3]))
    path = wire_path(folder, "a")
    block_file(path, ["x\n" * 1_000_000] * 3)
    size, began = path.stat().st_size, time.process_time()
    done = recover(folder)
    assert time.process_time() - began < 5
    assert done.rows["wire"] <= 1
    assert path.stat().st_size == size
    found = [str(one) for one in check(folder)]
    assert len(found) == 1, found
    for said in (found[0], done.text):
        assert "wire/a.tsv.gz" in said
        assert "no recorder writes that; restore the file from a copy" in said


def test_lines_of_a_block_are_limited_to_what_a_recorder_may_write(tmp_path: Path) -> None:
    path = wire_path(tmp_path, "a")
    block_file(path, [rows(MOST_LINES), rows(MOST_LINES + 1), rows(3)])
    found = [*blocks(path)]
    assert [isinstance(one, Gap) for one in found] == [False, False, True, False]
    assert f"at most {MOST_LINES}" in str(found[2])
    assert count_rows(path) == 1 + MOST_LINES + 3


def test_what_it_unpacks_to_is_limited_by_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = wire_path(tmp_path, "a")
    block_file(path, [rows(100, 1000)] * 20)
    assert count_rows(path) == 2001
    monkeypatch.setattr(capture_file, "FREE_BYTES", 1 << 20)
    *whole, gap = blocks(path)
    assert all(isinstance(one, Block) for one in whole)
    assert isinstance(gap, Gap)
    assert "unpacks to more than 1 MiB and 50 times its size" in str(gap)
    assert gap.end == path.stat().st_size
    assert mend(path) == 0, "what exceeds a limit is not cut off"


def test_what_fails_after_much_unpacking_counts_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = wire_path(tmp_path, "a")
    block_file(path, [rows(1)] + [" " * 3_000_000 + "no end"] * 20)
    monkeypatch.setattr(capture_file, "FREE_BYTES", 10 << 20)
    unpacked: list[int] = []
    unpack = capture_file._unpack
    monkeypatch.setattr(
        capture_file, "_unpack", lambda *member: unpacked.append(1) or unpack(*member)
    )
    assert [type(one) for one in blocks(path)] == [Block, Block, Gap]
    assert len(unpacked) == 6


def test_a_flooded_link_is_read(tmp_path: Path) -> None:
    """A repeated frame packs to a hundredth."""
    path = wire_path(tmp_path, "a")
    block_file(path, [rows(5000, 1024)] * 2)
    assert path.stat().st_size * 50 < 2 * 5000 * 2048
    assert [type(one) for one in blocks(path)] == [Block] * 3


@pytest.mark.parametrize("bomb", [heads_in_one_another, beginnings])
def test_heads_that_no_recorder_writes_cost_no_more_than_their_bytes(
    tmp_path: Path, bomb: Callable[[Path], None]
) -> None:
    """Each of 100 000 heads once unpacked the rest of the file, and each of ten million beginnings
    was read separately. The first block counts, and nothing is cut off.
    """
    path = wire_path(tmp_path, "a")
    block_file(path, [rows(3)])
    first = path.read_bytes()
    bomb(path)
    path.write_bytes(first + path.read_bytes())
    began = time.process_time()
    *whole, gap = blocks(path)
    assert time.process_time() - began < 5
    assert [type(one) for one in whole] == [Block, Block]
    assert isinstance(gap, Gap)
    assert "no recorder writes that" in str(gap)
    assert (gap.start, gap.end, gap.is_refused) == (len(first), path.stat().st_size, True)
    assert mend(path) == 0


def test_a_capture_whose_blocks_are_all_damaged_is_searched_to_its_end(tmp_path: Path) -> None:
    """The heads are right, the rest is not: the limits are not those of a genuine file."""
    path = wire_path(tmp_path, "a")
    block_file(path, [f"{number}.0\theard\t00\n" for number in range(12_000)])
    data, heads = path.read_bytes(), path.read_bytes().split(FIXED)
    path.write_bytes(
        FIXED.join([heads[0], *(one[:-1] + b"\xff" for one in heads[1:-1]), heads[-1]])
    )
    assert path.stat().st_size == len(data)
    *_, last = blocks(path)
    assert isinstance(last, Block), "each but the last one lost the end of its length"
    assert last.text == "11999.0\theard\t00\n"


def test_of_many_losses_the_first_are_told(tmp_path: Path) -> None:
    """A byte behind each block: 80 000 sentences for 5 MB in what `recover` prints."""
    path = wire_path(tmp_path, "a")
    block_file(path, [f"{number}.0\theard\t00\n" for number in range(300)])
    begin, *blocks_of = path.read_bytes().split(FIXED)
    path.write_bytes(begin + b"".join(FIXED + one + b"?" for one in blocks_of))
    *told, last = losses(path)
    assert len(told) == 100
    assert last == "201 more stretches are damaged or missing"
    assert count_rows(path) == 1 + 300
