"""The serial capture of a station, ``wire/STATION.tsv.gz``: a table of three columns that any tool
opens.

::

    at_s            what    data
    8123.480001251  run     {"format": 3, "station": "dde-1", ...}  the session's options (`Head`)
    8123.480341902  opened  /dev/ttyUSB0      lost, failed and closed give the reason
    8123.481126017  sent    023030303152534d4e0302  bytes, two hexadecimal digits each
    8123.498264515  heard   023031303041534d4e204444450374
    8123.498271302  told    ask 15 8123.481124960  the request answered, with its number of bytes,
    8123.580107466  told    wait 0            and when the command was sent
    8125.006217701  told    gather 0          all stations have finished this step of the start
    9001.220071830  broke   listen the port is gone  instead of an answer; stopped: the run's end
    9002.118204002  done                      the session ended

`at_s` is the recorder's monotonic clock in seconds. Texts have JSON's escapes. ``zcat`` and
``pandas.read_csv`` read it.

It is written a few times a second, each time a block with its own checksum (`capture_file.py`);
several blocks contain the row ``run``. A damaged stretch becomes a `Hole` between the rows. `mend`
cuts off an incomplete block that a kill leaves at the end.
"""

from __future__ import annotations

import json
import os
import re
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from io import BufferedReader
from pathlib import Path
from typing import Final

from jbclog.core.capture_rows import CaptureRow
from jbclog.core.errors import RecordError
from jbclog.core.files import (
    Kind,
    NotReadable,
    is_plain_folder,
    open_regular,
    open_to_write,
)
from jbclog.core.json_files import builder, expect_moment, json_of
from jbclog.core.operating_system import read_at
from jbclog.record.capture_file import FIXED, Block, Gap, blocks, blocks_in, row_of

FOLDER: Final = "wire"
SUFFIX: Final = ".tsv.gz"
FORMAT: Final = 3
WHOLE: Final = "whole"  # what the manifest says of wires that lack nothing
COLUMNS: Final = "at_s\twhat\tdata\n"
RUN: Final = "run"
FIRST_BYTES: Final = 4096  # in which a file says its format, whatever that is
SIP: Final = 64


@dataclass(frozen=True, slots=True)
class Head:
    """The options of a session beyond line file and recipe. Times as in the manifest."""

    station: str
    url: str
    recipe: str  # the file's name in the run's folder `recipes`
    t0_mono: float
    t0_utc: float
    duration_s: float | None = None
    rate: float | str | None = None
    allow_omega_write: bool = False
    allow_missing: bool = False
    jbclog: str = ""
    format: int = FORMAT


_build_head: Final = builder(Head)


def wire_path(folder: Path, station: str) -> Path:
    """Return the path of a station's capture in the run's folder."""
    return folder / FOLDER / f"{station}{SUFFIX}"


def wire_paths(folder: Path) -> list[Path]:
    """Return the paths of a run's captures."""
    return sorted((folder / FOLDER).glob(f"*{SUFFIX}")) if is_plain_folder(folder / FOLDER) else []


@dataclass(frozen=True, slots=True)
class Hole:
    """A lost stretch of a capture, and the times of the rows on both sides (None: no row)."""

    gap: Gap
    after_s: float | None
    before_s: float | None

    def describe(self, head: Head | None) -> str:
        """Return what is lost, where in the file, and between which times."""
        return f"{self.gap}; nothing is known {_between(self.after_s, self.before_s, head)}"


def _between(after_s: float | None, before_s: float | None, head: Head | None) -> str:
    if after_s is None and before_s is None:
        return "of it at all"
    since = "from its beginning" if after_s is None else f"from {_moment(after_s, head)}"
    return f"{since} {'on' if before_s is None else f'to {_moment(before_s, head)}'}"


def _moment(at_s: float, head: Head | None) -> str:
    if head is None:
        return f"{at_s:.3f} s (monotonic)"
    since, utc = at_s - head.t0_mono, at_s - head.t0_mono + head.t0_utc
    if not 0 <= utc < 1e11:
        return f"{since:.3f} s of the run"
    return f"{since:.3f} s of the run ({datetime.fromtimestamp(utc, UTC):%Y-%m-%dT%H:%M:%S}Z)"


def head_line(head: Head) -> str:
    return f"{head.t0_mono!r}\t{RUN}\t{json.dumps(asdict(head))}\n"


def read_head(path: Path) -> Head:
    """Read a capture's head. Raises RecordError if the file is no capture, or of another format."""
    try:
        head = _head(path)
    except (ValueError, OSError) as error:
        raise RecordError(f"{path} is not a serial capture: {error}") from error
    if head.format != FORMAT:
        raise RecordError(f"{path}: written in format {head.format}; this jbclog knows {FORMAT}")
    return head


def _head(path: Path) -> Head:
    for block in blocks(path):
        if isinstance(block, Block):
            if block.first_line == 1 and not block.text.startswith(COLUMNS):
                raise ValueError("its columns are others")
            _, what, data = (
                *block.text.removeprefix(COLUMNS).partition("\n")[0].split("\t"),
                "",
                "",
                "",
            )[:3]
            if what == RUN:
                return _believed(_build_head(json_of(data)), path)
            if block.first_line == 1:
                raise ValueError("it does not say of what run it is")
    raise ValueError(_why_none(path))


def _believed(head: Head, path: Path) -> Head:
    """Return a plausible head that points to no other folder. Raises ValueError."""
    expect_moment(head.t0_utc)
    if head.station != path.name.removesuffix(SUFFIX):
        raise ValueError(f"it is that of {head.station}")
    if head.recipe != Path(head.recipe).name:
        raise ValueError(f"{head.recipe} is no recipe of this run")
    return head


def _why_none(path: Path) -> str:
    """Return why a file has no head; another format states its number, however it is packed."""
    with open_regular(path, Kind.WIRE) as file:
        first = file.read(FIRST_BYTES)
    found = re.search(rb'\trun\t\{[^\n]*"format": ([0-9]{1,9})', _begun(first))
    if found and int(found[1]) != FORMAT:
        return f"written in format {int(found[1])}; this jbclog knows {FORMAT}"
    return "no block that says of what run it is can be proven" if first else "it is empty"


def _begun(first: bytes) -> bytes:
    """Decompress the first bytes of a file as far as possible, without checks."""
    unpacker, begun = zlib.decompressobj(16 + zlib.MAX_WBITS), b""
    with suppress(zlib.error):
        for place in range(0, len(first), SIP):
            begun += unpacker.decompress(first[place : place + SIP], FIRST_BYTES)
    return begun


def rows_and_holes(path: Path) -> Iterator[CaptureRow | Hole]:
    """Yield all intact rows in order, and holes between them. Raises RecordError if an intact line
    is no row.
    """
    last: float | None = None
    open_gap: Gap | None = None
    for block in _blocks(path):
        if isinstance(block, Gap):
            open_gap = block
            continue
        for row in _rows(path, block):
            if open_gap is not None:
                yield Hole(open_gap, last, row.at_s)
                open_gap = None
            last = row.at_s
            yield row
    if open_gap is not None:
        yield Hole(open_gap, last, None)


def _rows(path: Path, block: Block) -> Iterator[CaptureRow]:
    for number, line in enumerate(block.text.split("\n")[:-1], start=block.first_line):
        if (number == 1 and line + "\n" == COLUMNS) or f"\t{RUN}\t" in line:
            continue
        try:
            yield row_of(line)
        except ValueError as error:
            raise RecordError(f"{path}, line {number}: {error}") from error


def _blocks(path: Path) -> Iterator[Block | Gap]:
    try:
        yield from blocks(path)
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from error


def read_to_hole(path: Path) -> Iterator[CaptureRow]:
    """Yield the rows up to the first hole: no session is replayed beyond it."""
    for row in rows_and_holes(path):
        if isinstance(row, Hole):
            return
        yield row


def holes(path: Path) -> list[Hole]:
    """Return the holes of a capture."""
    return [hole for hole in rows_and_holes(path) if isinstance(hole, Hole)]


def count_rows(path: Path) -> int:
    """Return the number of intact lines, without the header."""
    texts = (block.text for block in blocks(path) if isinstance(block, Block))
    return sum(text.count("\n") - text.startswith(COLUMNS) for text in texts)


def is_done(path: Path) -> bool:
    """Whether the file contains its session's end; the port's closing may follow."""
    is_done = False
    for block in blocks(path):
        is_done = isinstance(block, Block) and (is_done or "\tdone\t" in block.text)
    return is_done


def mend(path: Path) -> int:
    """Cut off an incomplete block at the end; return the number of bytes. Raises OSError.

    Cuts only if nothing intact follows, nothing that exceeds a limit, never a whole file that may
    be something else, and never another file than the one that was read.
    """
    last: Block | Gap | None = None
    with open_regular(path, Kind.WIRE) as file:
        for last in blocks_in(file.fileno()):  # noqa: B007  # the last one counts
            pass
        if not isinstance(last, Gap) or last.is_refused or not (last.start or _has_begun(file)):
            return 0
        _cut(path, last.start, os.fstat(file.fileno()))
    return last.end - last.start


def _has_begun(file: BufferedReader) -> bool:
    """Whether the file begins like a block."""
    return FIXED.startswith(read_at(file.fileno(), len(FIXED), 0))


def _cut(path: Path, size: int, looked_at: os.stat_result) -> None:
    descriptor = open_to_write(path, Kind.WIRE, makes=False)
    try:
        if not os.path.samestat(os.fstat(descriptor), looked_at):
            raise NotReadable("was replaced while it was read; nothing was cut off")
        os.ftruncate(descriptor, size)
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
