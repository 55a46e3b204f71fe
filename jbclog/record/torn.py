"""How much of a write-ahead log SQLite will leave out after a crash, counted before it does.

SQLite reads its log up to the first frame whose check sum is wrong and takes the rest for never written. After a kill
that is right; after damage it drops transactions that were acknowledged, without a word. So the log is read here by
the same rules (sqlite.org/fileformat2.html, "The Write-Ahead Log") and the commits behind that frame are counted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

HEADER: Final = 32
FRAME_HEADER: Final = 24
LITTLE_ENDIAN: Final = 0x377F0682
BIG_ENDIAN: Final = 0x377F0683

Sums = tuple[int, int]


def torn_commits(log: Path) -> int:
    """How many transactions stand in the log behind the first frame that SQLite does not believe."""
    try:
        data = log.read_bytes()
    except FileNotFoundError:
        return 0
    if len(data) < HEADER + FRAME_HEADER:
        return 0
    page_bytes = struct.unpack_from(">I", data, 8)[0]
    if page_bytes not in (512 << shift for shift in range(8)):
        page_bytes = 4096
    frames = list(range(HEADER, len(data) - FRAME_HEADER - page_bytes + 1, FRAME_HEADER + page_bytes))
    believed = sum(1 for _ in _believed(data, frames, page_bytes))
    salts = {data[16:24], data[HEADER + 8 : HEADER + 16]}  # either may be what was damaged
    behind = [frame for frame in frames[believed:] if data[frame + 8 : frame + 16] in salts]
    return sum(1 for frame in behind if struct.unpack_from(">I", data, frame + 4)[0])


def _believed(data: bytes, frames: list[int], page_bytes: int) -> Iterator[int]:
    """The frames from the start of the log whose salts and check sums are right."""
    magic = struct.unpack_from(">I", data, 0)[0]
    if magic not in (LITTLE_ENDIAN, BIG_ENDIAN):
        return
    words = "<" if magic == LITTLE_ENDIAN else ">"
    sums = _add((0, 0), data[:24], words)
    if sums != struct.unpack_from(">II", data, 24):
        return
    for frame in frames:
        sums = _add(sums, data[frame : frame + 8], words)
        sums = _add(sums, data[frame + FRAME_HEADER : frame + FRAME_HEADER + page_bytes], words)
        if data[frame + 8 : frame + 16] != data[16:24] or sums != struct.unpack_from(">II", data, frame + 16):
            return
        yield frame


def _add(sums: Sums, data: bytes, words: str) -> Sums:
    first, second = sums
    numbers = struct.unpack(f"{words}{len(data) // 4}I", data)
    for even, odd in zip(numbers[::2], numbers[1::2], strict=True):
        first = (first + even + second) & 0xFFFFFFFF
        second = (second + odd + first) & 0xFFFFFFFF
    return first, second
