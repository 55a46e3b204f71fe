"""Frames, of which the segments of a journal consist (docs/reference/run-folder.md).

1. A frame is a header and a payload, packed by zstd: the Arrow schema of a table, a record batch of
   its rows without the schema, or JSON. Its CRC-32 is over header and payload.
2. Frames that are written and synced together are a commit. Each says which commit it belongs to,
   and that it is number `place` of `count` in it: a commit counts only if all of them are there.
3. A mark says that a commit is on the disk. It is written after the sync, and itself not synced.
4. Reading continues behind damage at the next frame that is whole. Damage costs the commit that it
   lies in; at the end of a file it is a commit that was never finished. Blocks that the disk cannot
   read are damage, too.

Here are bytes only: `segments` has the files, `row_batches` the rows.
"""

from __future__ import annotations

import errno
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from io import SEEK_END
from typing import BinaryIO, Final, NamedTuple

import pyarrow as pa

FRAME: Final = b"JBCf"
MARK: Final = b"JBCm"
HEAD: Final = struct.Struct("<4sBBHHQQIIII")
"""Magic, kind, table, place and count of frames in the commit, number of the commit, `seq` of the
first row, rows, bytes of the payload, its bytes unpacked, CRC-32 of all that.
"""
CRC: Final = struct.Struct("<I")
MARK_HEAD: Final = struct.Struct("<4sQQI")
"""Magic, number of the commit, UTC in µs before which all is on the disk, CRC-32."""
MOST_BYTES: Final = 64 << 20
"""Of an unpacked payload."""
MOST_PACKED: Final = MOST_BYTES + (1 << 16)
_CODEC: Final = pa.Codec("zstd", compression_level=1)
_CODEC_OF_FEW: Final = pa.Codec("zstd", compression_level=6)  # as fast for so few bytes
_FEW: Final = 4096
_CHUNK: Final = 1 << 20
_BLOCK: Final = 4096
"""Bytes that a disk reads, or cannot read, together."""


class FrameKind(IntEnum):
    SCHEMA = 1  # of a table: an Arrow schema message, whose metadata name the table
    ROWS = 2  # of a table: an Arrow record batch message
    FACTS = 3  # of stations that changed: a JSON object by station
    NOTES = 4  # of the run: a JSON object


_KINDS: Final = frozenset(map(int, FrameKind))


class TooLarge(ValueError):
    """A payload has more than `MOST_BYTES`."""


@dataclass(frozen=True, slots=True)
class Frame:
    """`table` is the table's number in its segment; `first` the `seq` of the first of `rows`."""

    kind: FrameKind
    packed: bytes
    unpacked: int
    table: int = 0
    first: int = 0
    rows: int = 0

    @classmethod
    def of(
        cls, kind: FrameKind, payload: bytes, table: int = 0, first: int = 0, rows: int = 0
    ) -> Frame:
        """Pack a payload. Raises `TooLarge`."""
        if len(payload) > MOST_BYTES:
            raise TooLarge(f"{len(payload)} bytes; a frame holds at most {MOST_BYTES}")
        codec = _CODEC_OF_FEW if len(payload) <= _FEW else _CODEC
        packed = bytes(codec.compress(payload, asbytes=True))
        return cls(kind, packed, len(payload), table, first, rows)

    def payload(self) -> bytes:
        """Unpack. Raises OSError if the bytes are not what `of` packed."""
        return bytes(_CODEC.decompress(self.packed, decompressed_size=self.unpacked, asbytes=True))


@dataclass(frozen=True, slots=True)
class Commit:
    """A whole commit, which stands from `start` to `end` in its file."""

    number: int
    frames: tuple[Frame, ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Mark:
    """Commit `number` is on the disk, and so is what came before `utc_us`."""

    number: int
    utc_us: int
    end: int


@dataclass(frozen=True, slots=True)
class Gap:
    """Bytes that are no whole commit. `is_end`: nothing whole follows in the file. `is_unreadable`:
    the disk cannot read some of them.
    """

    start: int
    end: int
    is_end: bool
    is_unreadable: bool = False


def commit_bytes(number: int, frames: Sequence[Frame]) -> bytes:
    """Return the bytes of a commit."""
    pieces: list[bytes] = []
    for place, frame in enumerate(frames):
        head = HEAD.pack(
            FRAME,
            frame.kind,
            frame.table,
            place,
            len(frames),
            number,
            frame.first,
            frame.rows,
            len(frame.packed),
            frame.unpacked,
            0,
        )
        head = head[: -CRC.size]
        crc = zlib.crc32(frame.packed, zlib.crc32(head))
        pieces += [head, CRC.pack(crc), frame.packed]
    return b"".join(pieces)


def mark_bytes(number: int, utc_us: int) -> bytes:
    """Return the bytes of a mark."""
    head = MARK_HEAD.pack(MARK, number, utc_us, 0)[: -CRC.size]
    return head + CRC.pack(zlib.crc32(head))


class _Placed(NamedTuple):
    """A whole frame with what its header says of its commit, and where it stands."""

    frame: Frame
    commit: int
    place: int
    places: int
    start: int
    end: int


class _Source:
    """A segment's file as it is now: what is written later is not read, because the beginning of a
    commit would look like damage once the rest of it is there.

    A block that the disk cannot read is zeros, and listed in `unreadable`.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.size = file.seek(0, SEEK_END)
        self.unreadable: set[int] = set()

    def read(self, start: int, size: int) -> bytes:
        """Return `size` bytes from `start`, fewer at the end. Raises OSError."""
        size = max(min(size, self.size - start), 0)
        try:
            return self._read(start, size)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
        end = start + size
        pieces = []
        while start < end:
            following = min(start - start % _BLOCK + _BLOCK, end)
            pieces.append(self._read_in_block(start, following))
            start = following
        return b"".join(pieces)

    def gap(self, start: int, end: int, *, is_end: bool) -> Gap:
        is_unreadable = any(start < block + _BLOCK and block < end for block in self.unreadable)
        return Gap(start, end, is_end, is_unreadable)

    def _read(self, start: int, size: int) -> bytes:
        self._file.seek(start)
        return self._file.read(size)

    def _read_in_block(self, start: int, end: int) -> bytes:
        try:
            return self._read(start, end - start)
        except OSError as error:
            if error.errno != errno.EIO:
                raise
        self.unreadable.add(start - start % _BLOCK)
        return bytes(end - start)


def read_items(file: BinaryIO, start: int = 0) -> Iterator[Commit | Mark | Gap]:
    """Yield what a segment holds from `start`, the begin of a frame or mark, in order.

    A commit that is not whole is a `Gap`. Raises OSError, but not for blocks that cannot be read.
    """
    source = _Source(file)
    begun: list[_Placed] = []  # of a commit that is not complete yet
    position = start
    gap: int | None = None  # where damage began
    while True:
        item = _item_at(source, position)
        if item is None:
            following = _next_start(source, position + 1)
            gap = _first(gap, begun, position)
            begun = []
            if following is None:
                if source.size > gap:
                    yield source.gap(gap, source.size, is_end=True)
                return
            position = following
            continue
        position = item.end
        if isinstance(item, Mark):
            if begun:
                gap = _first(gap, begun, position)
                begun = []
            if gap is not None:
                yield source.gap(gap, item.end - MARK_HEAD.size, is_end=False)
                gap = None
            yield item
            continue
        follows = bool(begun) and (
            begun[0].commit == item.commit
            and len(begun) == item.place
            and begun[0].places == item.places
        )
        if not follows and begun:
            gap = _first(gap, begun, item.start)
            begun = []
        if not follows and item.place:
            gap = item.start if gap is None else gap
            continue
        if not begun and gap is not None:
            yield source.gap(gap, item.start, is_end=False)
            gap = None
        begun.append(item)
        if len(begun) == item.places:
            frames = tuple(placed.frame for placed in begun)
            yield Commit(item.commit, frames, begun[0].start, item.end)
            begun = []


def readable_bytes(file: BinaryIO) -> bytes:
    """Return the bytes of a file, zeros for blocks that the disk cannot read. Raises OSError."""
    source = _Source(file)
    return source.read(0, source.size)


def _first(gap: int | None, begun: Sequence[_Placed], position: int) -> int:
    """Return where damage began: before, with the commit that was begun, or here."""
    if gap is not None:
        return gap
    if begun:
        return begun[0].start
    return position


def _item_at(source: _Source, start: int) -> _Placed | Mark | None:
    """Return the whole frame or mark at `start`; None if there is none."""
    head = source.read(start, HEAD.size)
    if head.startswith(MARK):
        return _mark(head[: MARK_HEAD.size], start)
    if len(head) < HEAD.size or not head.startswith(FRAME):
        return None
    _, kind, table, place, count, commit, first, rows, length, unpacked, crc = HEAD.unpack(head)
    if length > MOST_PACKED or unpacked > MOST_BYTES or place >= count:
        return None
    packed = source.read(start + HEAD.size, length)
    if len(packed) < length or zlib.crc32(packed, zlib.crc32(head[: -CRC.size])) != crc:
        return None
    if kind not in _KINDS:
        return None
    frame = Frame(FrameKind(kind), packed, unpacked, table, first, rows)
    return _Placed(frame, commit, place, count, start, start + HEAD.size + length)


def _mark(data: bytes, start: int) -> Mark | None:
    if len(data) < MARK_HEAD.size:
        return None
    _, number, utc_us, crc = MARK_HEAD.unpack(data)
    if zlib.crc32(data[: -CRC.size]) != crc:
        return None
    return Mark(number, utc_us, start + MARK_HEAD.size)


def _next_start(source: _Source, start: int) -> int | None:
    """Return where the next whole frame or mark begins, from `start` on; None if none does."""
    while True:
        chunk = source.read(start, _CHUNK)
        for offset in _candidates(chunk):
            if _item_at(source, start + offset) is not None:
                return start + offset
        if len(chunk) < _CHUNK:
            return None
        start += len(chunk) - len(FRAME) + 1


def _candidates(chunk: bytes) -> Iterator[int]:
    """Yield the offsets at which a frame or mark may begin."""
    shared = FRAME[:-1]  # both begin with it
    offset = chunk.find(shared)
    while offset >= 0:
        yield offset
        offset = chunk.find(shared, offset + 1)
