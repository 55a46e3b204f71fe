"""A station's wire as a file of the run: ``wire/STATION.tsv.gz``, a table of three columns that any tool opens.

::

    at_s            what    data
    8123.480001251  run     {"format": 1, "station": "dde-1", ...}       what the session was ordered (`Head`)
    8123.480341902  opened  /dev/ttyUSB0                                  lost, failed and closed say why
    8123.481126017  sent    023030303152534d4e0302                        bytes, two hexadecimal digits each
    8123.498264515  heard   023031303041534d4e204444450374
    8123.498271302  told    ask 15 8123.481124960                         the wish that was answered, with how many bytes,
    8123.580107466  told    wait 0                                        and when the question left
    9001.220071830  broke   listen the port is gone                       in place of an answer; stopped: the run's end
    9002.118204002  done                                                  the session had ended

`at_s` is the recorder's monotonic clock in seconds. Texts have JSON's escapes. ``zcat`` and ``pandas.read_csv`` read it.

The file is written a few times a second, each time up to a point from which it can be read without what follows. A kill
leaves it without its end; `mend` cuts off what is not whole and closes it.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import zlib
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final, cast, get_args

from jbclog.errors import RecordError
from jbclog.record.from_json import Misfit, build
from jbclog.tape import Passed, PassedName, Row, Told, ToldName, WishName

FOLDER: Final = "wire"
SUFFIX: Final = ".tsv.gz"
FORMAT: Final = 1
WHOLE: Final = "whole"  # what the manifest says of wires that lack nothing
COLUMNS: Final = "at_s\twhat\tdata\n"
GZIP: Final = 16 + zlib.MAX_WBITS
PIECE: Final = 1 << 16
BYTES: Final = ("sent", "heard")
PASSED: Final = get_args(PassedName)
TOLD: Final = get_args(ToldName)
WISHES: Final = get_args(WishName)
HEADER: Final = b"\x1f\x8b\x08\0\0\0\0\0\0\xff"  # gzip, deflate, no name, no time (RFC 1952)
LAST_BLOCK: Final = b"\x03\0"  # an empty one (RFC 1951)
FLUSHED: Final = b"\0\0\xff\xff"  # the end of what a sync flush writes


@dataclass(frozen=True, slots=True)
class Head:
    """What one session was ordered, as far as line file and recipe do not say it. Times as in the manifest."""

    station: str
    url: str
    recipe: str  # the file's name in the run's folder `recipes`
    t0_mono: float
    t0_utc: float
    duration_s: float | None = None
    rate: float | str | None = None
    allow_omega_write: bool = False
    jbclog: str = ""
    format: int = FORMAT


def wire_path(folder: Path, station: str) -> Path:
    """Where the wire of a station is, in the folder of a run."""
    return folder / FOLDER / f"{station}{SUFFIX}"


def wire_paths(folder: Path) -> list[Path]:
    """The wires that a run has recorded."""
    return sorted((folder / FOLDER).glob(f"*{SUFFIX}"))


# -- rows as lines -------------------------------------------------------------------------------------------------------


def head_lines(head: Head) -> str:
    return f"{COLUMNS}{head.t0_mono!r}\trun\t{json.dumps(asdict(head))}\n"


def line_of(row: Row) -> str:
    """A row as it stands in the file; moments with all the digits that tell them apart."""
    if isinstance(row, Passed):
        return f"{row.at_s!r}\t{row.what}\t{row.data.hex() or _escaped(row.text)}\n"
    if row.what != "told":
        return f"{row.at_s!r}\t{row.what}\t{row.wish} {_escaped(row.text)}\n"
    if row.wish == "ask":
        return f"{row.at_s!r}\ttold\task {row.size} {row.sent_s!r}\n"
    return f"{row.at_s!r}\ttold\t{row.wish} {row.size}\n"


def row_of(line: str) -> Row:
    """The row in a line. Raises `ValueError` where it is none."""
    at, what, data = line.rstrip("\n").split("\t")
    moment = float(at)
    if what in BYTES:
        return Passed(moment, cast(PassedName, what), bytes.fromhex(data))
    if what in PASSED:
        return Passed(moment, cast(PassedName, what), b"", _plain(data))
    wish, _, rest = data.partition(" ")
    if what not in TOLD or wish not in WISHES:
        raise ValueError(f"{what} {wish} is not what a wire record tells")
    if what == "told":
        size, _, sent = rest.partition(" ")
        return Told(moment, "told", cast(WishName, wish), int(size), float(sent or 0.0))
    return Told(moment, cast(ToldName, what), cast(WishName, wish), text=_plain(rest))


def _escaped(text: str) -> str:
    return json.dumps(text)[1:-1]


def _plain(text: str) -> str:
    return str(json.loads(f'"{text}"'))


# -- reading -------------------------------------------------------------------------------------------------------------


def read_head(path: Path) -> Head:
    """What the session was ordered. Raises `RecordError` where the file is no wire record, or of a newer jbclog."""
    lines = lines_of(path)
    try:
        if next(lines) != COLUMNS:
            raise ValueError("its columns are others")
        _, what, data = next(lines).rstrip("\n").split("\t")
        if what != "run":
            raise ValueError("it does not say of what run it is")
        head = cast(Head, build(Head, json.loads(data)))
    except (StopIteration, ValueError, Misfit, OSError) as error:
        raise RecordError(f"{path} is no wire record: {str(error) or 'it is empty'}") from error
    if head.format > FORMAT:
        raise RecordError(f"{path}: written in format {head.format}; this jbclog knows {FORMAT}")
    return head


def read_rows(path: Path, first: int = 0) -> Iterator[Row]:
    """The rows of a wire record from number `first` on, one at a time. Raises `RecordError` at the first that is none."""
    for number, line in enumerate(lines_of(path), start=-2):  # before row 0 stand the columns' names and the head
        if number >= first:
            try:
                yield row_of(line)
            except ValueError as error:
                raise RecordError(f"{path}, line {number + 3}: {error}") from error


def count_rows(path: Path) -> int:
    """How many rows the file holds, its head included; what is not whole at its end is none."""
    return max(sum(piece.count(b"\n") for piece, _ in _unpacked(path)) - 1, 0)


def is_done(path: Path) -> bool:
    """Whether the file goes on to the end of its session."""
    last = deque(lines_of(path), maxlen=1)
    return any("\tdone\t" in line for line in last)


def lines_of(path: Path) -> Iterator[str]:
    """Every whole line, up to the end or to where the file cannot be read any further."""
    rest = b""
    for piece, _ in _unpacked(path):
        *whole, rest = (rest + piece).split(b"\n")
        for line in whole:
            yield line.decode() + "\n"


def _unpacked(path: Path) -> Iterator[tuple[bytes, bool]]:
    """The file's contents piece by piece, as far as they can be read; True once it has ended as it should."""
    unpacker = zlib.decompressobj(GZIP)
    with path.open("rb") as file:
        while packed := file.read(PIECE):
            try:
                yield unpacker.decompress(packed), unpacker.eof
            except zlib.error:
                return


# -- a file without its end ------------------------------------------------------------------------------------------------


def end_of_file(crc: int, size: int) -> bytes:
    """What closes a file whose contents have that check sum and size."""
    return LAST_BLOCK + struct.pack("<II", crc, size & 0xFFFFFFFF)


def mend(path: Path) -> bool:
    """Close a file that a crash left without its end, after the last row that is whole; whether that was needed.

    Raises OSError.
    """
    if any(ended for _, ended in _unpacked(path)):
        return False
    end, crc, size = _last_point(path)
    with path.open("r+b") as file:
        file.truncate(end)
        file.seek(0, os.SEEK_END)
        file.write((b"" if end else HEADER) + end_of_file(crc, size))
    return True


def _last_point(path: Path) -> tuple[int, int, int]:
    """The last place that the file was written up to as a whole: its offset, and check sum and size of what it holds."""
    end = path.stat().st_size
    if end:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            while (found := data.rfind(FLUSHED, len(HEADER), end)) >= 0:
                end = found + len(FLUSHED)
                if held := _contents(data, end):
                    return end, *held
                end -= 1
    return 0, 0, 0


def _contents(data: mmap.mmap, end: int) -> tuple[int, int] | None:
    """Check sum and size of what the bytes before `end` hold, if a block and a line end there."""
    unpacker, crc, size, last = zlib.decompressobj(-zlib.MAX_WBITS), 0, 0, b""
    try:
        for place in range(len(HEADER), end, PIECE):
            piece = unpacker.decompress(data[place : min(place + PIECE, end)])
            crc, size, last = zlib.crc32(piece, crc), size + len(piece), piece[-1:] or last
        return (crc, size) if last == b"\n" and not unpacker.decompress(LAST_BLOCK) and unpacker.eof else None
    except zlib.error:
        return None
