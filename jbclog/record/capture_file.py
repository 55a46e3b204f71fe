"""The file of a serial capture: rows of text in blocks with a checksum each."""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Final, cast, get_args

from jbclog.core.capture_rows import (
    CaptureRow,
    LinkRow,
    LinkRowKind,
    RequestName,
    ResultKind,
    ResultRow,
)
from jbclog.core.files import Kind, open_regular
from jbclog.core.operating_system import read_at

BYTES: Final = ("sent", "heard")
PASSED: Final = get_args(LinkRowKind)
RESULTS: Final = get_args(ResultKind)
REQUESTS: Final = get_args(RequestName)


def line_of(row: CaptureRow) -> str:
    """Format a row; times have all digits."""
    if isinstance(row, LinkRow):
        return f"{row.at_s!r}\t{row.what}\t{row.data.hex() or _escaped(row.text)}\n"
    if row.what != "told":
        return f"{row.at_s!r}\t{row.what}\t{row.request} {_escaped(row.text)}\n"
    if row.late_s:
        return f"{row.at_s!r}\ttold\t{row.request} {row.size} {row.sent_s!r} {row.late_s!r}\n"
    if row.request == "ask":
        return f"{row.at_s!r}\ttold\task {row.size} {row.sent_s!r}\n"
    return f"{row.at_s!r}\ttold\t{row.request} {row.size}\n"


def row_of(line: str) -> CaptureRow:
    """Parse a row. Raises ValueError."""
    columns = line.rstrip("\n").split("\t")
    if len(columns) != 3:
        raise ValueError("must have three columns")
    at, what, data = columns
    moment = _finite(at)
    if what in BYTES:
        return LinkRow(moment, cast(LinkRowKind, what), bytes.fromhex(data))
    if what in PASSED:
        return LinkRow(moment, cast(LinkRowKind, what), b"", _plain(data))
    name, _, rest = data.partition(" ")
    if what not in RESULTS or name not in REQUESTS:
        raise ValueError(f"{what} {name} is no row of a serial capture")
    request = cast(RequestName, name)
    if what == "told":
        size, sent, late, *more = *rest.split(" "), "", ""
        if any(more):
            raise ValueError(f"{rest} has too many fields for a serial capture")
        return ResultRow(
            moment, "told", request, _count(size), _finite(sent or "0"), late_s=_finite(late or "0")
        )
    return ResultRow(moment, cast(ResultKind, what), request, text=_plain(rest))


def _finite(text: str) -> float:
    number = float(text)
    if not isfinite(number):
        raise ValueError(f"{text} is not a time")
    return number


def _count(text: str) -> int:
    if not text.isdecimal():
        raise ValueError(f"{text} is not a number of bytes")
    return int(text)


def _escaped(text: str) -> str:
    return json.dumps(text)[1:-1]


def _plain(text: str) -> str:
    return str(json.loads(f'"{text}"'))


# Each block is a gzip member with its own checksum, so that damage costs only the blocks it
# touches.
#
# ::
#
#     1f 8b 08 04 ...  gzip's head (RFC 1952) with an extra field `JW`, which other tools skip:
#                      number of the block, number of its first line, kin, length of the block in
#                      bytes, CRC-32 of all of that
#     ...              its lines, deflated
#     crc size         of the lines, as gzip has them
#
# `kin` is the CRC-32 of the file's first head: it identifies blocks of another file. Numbers of
# blocks and lines have no gaps, so missing lines are counted even if no byte of them is left.

FIXED: Final = b"\x1f\x8b\x08\x04\0\0\0\0\0\xff"  # deflate, an extra field, no time, no system
FIELD_NAME: Final = b"JW"
HEAD: Final = struct.Struct("<10sH2sH4II")
FIELD_BYTES: Final = HEAD.size - 16
PIECE: Final = 1 << 16
MOST_BYTES: Final = 64 << 20  # of a decompressed block: three times what a recorder writes
MOST_LINES: Final = 32_768  # of a block: a recorder's has at most 20 002
FREE_BYTES: Final = 256 << 20  # that a file may unpack to, whatever its size,
# and beyond that so many times its size; a busy link has seven, a flooded one hundreds for a while
RATIO: Final = 50
NOT_OURS: Final = "no recorder writes that; restore the file from a copy"
STEP: Final = 1 << 20  # bytes unpacked at a time
# A head says how long its block is, so heads that lie in one another's blocks would have the same
# bytes unpacked again for each; and what begins like a head must be looked at. A recorder's blocks
# follow each other, and have a hundred bytes or more.
TWICE: Final = 2  # of a file's size, and `MOST_BYTES` beyond that: what is unpacked of it
FREE_HEADS: Final = 10_000
BYTES_A_HEAD: Final = 32
SEARCHED: Final = 4 << 20  # bytes at a time
LEVEL, WINDOW, MEMORY = 6, 13, 7  # of zlib: nearly as small as 9 and 15, in a quarter of the memory


@dataclass(frozen=True, slots=True)
class Block:
    """Intact lines: the number of the first in its file, from 1, and their text."""

    first_line: int
    text: str

    @property
    def next_line(self) -> int:
        return self.first_line + self.text.count("\n")


@dataclass(frozen=True, slots=True)
class Gap:
    """What is lost: its bytes in the file (`end` excluded), its number of lines (None: not known),
    and why.

    `is_refused`: the bytes may be intact, and exceed a limit.
    """

    start: int
    end: int
    first_line: int
    next_line: int | None
    why: str
    is_refused: bool = False

    def __str__(self) -> str:
        where = (
            f"bytes {self.start} to {self.end - 1}"
            if self.end > self.start
            else f"at byte {self.start}"
        )
        if self.next_line is None:
            return f"{where}, from line {self.first_line} on: {self.why}"
        last = self.next_line - 1
        lines = (
            "no line"
            if last < self.first_line
            else f"line {last}"
            if last == self.first_line
            else f"lines {self.first_line} to {last}"
        )
        return f"{where}, {lines}: {self.why}"


@dataclass(frozen=True, slots=True)
class _Label:
    """The head of a block, and its place."""

    at: int
    number: int
    first_line: int
    kin: int
    length: int


def packed(text: str, number: int, first_line: int, kin: int) -> bytes:
    """Pack lines into a block."""
    data = text.encode()
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, -WINDOW, MEMORY)
    body = (
        packer.compress(data)
        + packer.flush()
        + struct.pack("<II", zlib.crc32(data), len(data) & 0xFFFFFFFF)
    )
    header = (
        FIXED,
        FIELD_BYTES + 4,
        FIELD_NAME,
        FIELD_BYTES,
        number,
        first_line,
        kin,
        HEAD.size + len(body),
    )
    return HEAD.pack(*header, _crc(HEAD.pack(*header, 0))) + body


def has_head(number: int) -> bool:
    """Whether the block of that number repeats the file's head: 0, 1, 2, 4, 8 …, so that copies are
    spread over the file.
    """
    return number & (number - 1) == 0


def _crc(head: bytes) -> int:
    return zlib.crc32(head[:-4])


def blocks(path: Path) -> Iterator[Block | Gap]:
    """Yield the file's blocks in order, with gaps for what is damaged. Raises OSError."""
    with open_regular(path, Kind.WIRE) as file:
        yield from blocks_in(file.fileno())


def blocks_in(descriptor: int) -> Iterator[Block | Gap]:
    """Yield the blocks of an open file, as `blocks`."""
    data = _Bytes(descriptor)
    if len(data):
        labels = _labels(data)
        first = next(labels, None)
        if first is None:
            yield Gap(0, len(data), 1, None, "no block of it can be proven")
            return
        yield from _numbered(data, first, labels)


class _Bytes:
    """The bytes of an open file by slices. A memory map would count as memory, and a shrinking file
    would kill the process.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._size = os.fstat(descriptor).st_size

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, wanted: slice) -> bytes:
        start, stop, _ = wanted.indices(self._size)
        return read_at(self._descriptor, max(stop - start, 0), start)


def _labels(data: _Bytes) -> Iterator[_Label | None]:
    """Yield every intact head of a block; None, and nothing more, where too much looks like one."""
    for count, at in enumerate(_places_of_heads(data)):
        if count > FREE_HEADS + at // BYTES_A_HEAD:
            yield None
            return
        head = data[at : at + HEAD.size]
        if (
            len(head) == HEAD.size
            and head.startswith(FIXED)
            and HEAD.unpack(head)[-1] == _crc(head)
        ):
            yield _Label(at, *HEAD.unpack(head)[4:8])


def _places_of_heads(data: _Bytes) -> Iterator[int]:
    """Yield every place where a head may begin. Pieces overlap, so that none is cut in two."""
    # no zeros: `find` steps over what cannot be part of it, and zeros are what a damaged disk has
    sought = FIXED[:4]
    for start in range(0, len(data), SEARCHED - len(sought) + 1):
        piece = data[start : start + SEARCHED]
        at = piece.find(sought)
        while at >= 0:
            yield start + at
            at = piece.find(sought, at + 1)


def _numbered(
    data: _Bytes, first: _Label, labels: Iterator[_Label | None]
) -> Iterator[Block | Gap]:
    """Yield the intact blocks, and gaps between them."""
    end, number, line, why, is_refused, unpacked, taken = 0, 0, 1, "", False, 0, 0
    for label in _chain(first, labels):
        if label is None:
            why, is_refused = f"begins like a block too often ({NOT_OURS})", True
            break
        is_next = label.kin == first.kin and label.number >= number and label.length <= MOST_BYTES
        text, size, read = _unpack(data, label) if is_next else (None, 0, 0)
        unpacked, taken = unpacked + size, taken + read
        too_much = _excess_of_file(unpacked, label.at + label.length) or _excess_of_tries(
            taken, len(data)
        )
        excess = too_much or _excess_of_block(text)
        if text is None or excess:
            why, is_refused = (
                too_much or why or excess or _doubt(label, first, number),
                is_refused or bool(excess),
            )
            if too_much:
                break
            continue
        if label.at > end or label.number > number:
            missing = why or ("damaged" if label.at > end else "missing")
            yield Gap(end, label.at, line, label.first_line, missing, is_refused)
        block = Block(label.first_line, text)
        yield block
        end, number, line, why, is_refused = (
            label.at + label.length,
            label.number + 1,
            block.next_line,
            "",
            False,
        )
    if end < len(data):
        yield Gap(
            end, len(data), line, None, why or "damaged, or not written to its end", is_refused
        )


def _excess_of_block(text: str | None) -> str:
    """Return which limit a block exceeds; empty where none."""
    lines = 0 if text is None else text.count("\n")
    return (
        f"a block of {lines} lines; a recorder's have at most {MOST_LINES} ({NOT_OURS})"
        if lines > MOST_LINES
        else ""
    )


def _excess_of_file(unpacked: int, packed: int) -> str:
    if unpacked <= max(FREE_BYTES, RATIO * packed):
        return ""
    return f"unpacks to more than {FREE_BYTES >> 20} MiB and {RATIO} times its size ({NOT_OURS})"


def _excess_of_tries(taken: int, size: int) -> str:
    return f"has blocks in one another ({NOT_OURS})" if taken > TWICE * size + MOST_BYTES else ""


def _chain(first: _Label, others: Iterator[_Label | None]) -> Iterator[_Label | None]:
    yield first
    yield from others


def _doubt(label: _Label, first: _Label, number: int) -> str:
    if label.kin != first.kin:
        return "belongs to another recording"
    return "damaged" if label.number >= number else "stands here a second time"


def _unpack(data: _Bytes, label: _Label) -> tuple[str | None, int, int]:
    """Return the lines of a gzip member if its checksum and size are right, else None; and the
    bytes that were unpacked, and taken from the file.
    """
    unpacker, pieces, size = zlib.decompressobj(16 + zlib.MAX_WBITS), list[bytes](), 0
    at, end = label.at, min(label.at + label.length, len(data))
    try:
        while not unpacker.eof and size <= MOST_BYTES:
            left = unpacker.unconsumed_tail
            if not left:
                left = data[at : min(at + PIECE, end)]
                at += len(left)
            piece = unpacker.decompress(left, STEP)
            if not (piece or left):
                return None, size, at - label.at
            pieces.append(piece)
            size += len(piece)
        text = b"".join(pieces).decode()
    except (zlib.error, UnicodeDecodeError):
        return None, size, at - label.at
    is_whole = unpacker.eof and not unpacker.unused_data and at == end and text.endswith("\n")
    return text if is_whole else None, size, at - label.at
