"""Seal and read the serial capture of a run, the table `wire` (`wire_recorder` makes it).

A number that is missing in `seq` is that of a row that was lost. No session is reproduced beyond
it: whose row it was is not known.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.capture_rows import CaptureRow, LinkRow, ResultRow
from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, open_regular
from jbclog.core.json_files import builder, expect_moment, json_of
from jbclog.core.operating_system import sync_folder
from jbclog.record.journal_reader import Segment
from jbclog.record.part_chain import PartChain
from jbclog.record.part_writer import collected, write_part
from jbclog.record.parts import row_groups
from jbclog.record.schema import CAPTURE, SEQ
from jbclog.record.wire_recorder import RUN, Head

WHOLE: Final = "whole"
"""What the manifest says of a capture that lacks nothing."""

_build_head: Final = builder(Head)

# -- seal ------------------------------------------------------------------------------------------


def segments(folder: Path) -> list[Path]:
    """Return the segments that are not sealed, oldest first."""
    return sorted(folder.glob(f"{CAPTURE}-[0-9]*.journal"))


def seal_capture(folder: Path, *, is_open: bool = False) -> None:
    """Make a part of each segment and remove it; with `is_open`, the recorder continues in the last
    one. May be repeated after a crash. Raises OSError, RecordError.
    """
    chain = PartChain(folder)
    paths = segments(folder)
    for path in paths[:-1] if is_open else paths:
        number = int(path.stem.removeprefix(f"{CAPTURE}-"))
        if not chain.has(CAPTURE, number):
            with open_regular(path, Kind.WIRE) as file:
                segment = Segment(path, file, folder.name)
            above = chain.last_seq(CAPTURE, before=number)
            rows = collected(CAPTURE, segment.rows(CAPTURE, above))
            if rows.num_rows:
                chain.add(number, write_part(folder, CAPTURE, rows, number))
        path.unlink()
        sync_folder(folder)


# -- read ------------------------------------------------------------------------------------------


def rows_in(table: pa.Table) -> Iterator[CaptureRow]:
    """Yield the rows of a piece of the table, without those of `Head`."""
    names = ("at_s", "what", "data", "text", "request", "size", "sent_s", "late_s")
    columns = [table[name].to_pylist() for name in names]
    for at_s, what, data, text, request, size, sent_s, late_s in zip(*columns, strict=True):
        if request is not None:
            yield ResultRow(at_s, what, request, size, sent_s, text or "", late_s)
        elif what != RUN:
            yield LinkRow(at_s, what, data or b"", text or "")


def heads_of(folder: Path) -> dict[str, Head]:
    """Return the options of each captured session of a sealed run, by station. Raises
    `RecordError`.
    """
    found = {}
    for group in row_groups(folder, CAPTURE, ["what", "text"]):
        for text in group.filter(pc.equal(group["what"], RUN))["text"].to_pylist():
            try:
                head = _build_head(json_of(text))
                expect_moment(head.t0_utc)
            except ValueError as error:
                raise RecordError(f"{folder}: options of a captured session: {error}") from error
            found[head.station] = head
    return found


def captured_rows(folder: Path, station: str) -> Iterator[CaptureRow]:
    """Yield the rows of a station up to the first that is missing. Raises `RecordError`."""
    following = 0
    for group in row_groups(folder, CAPTURE):
        whole = _rows_before_hole(group[SEQ], following)
        following += whole
        rows = group.slice(0, whole)
        yield from rows_in(rows.filter(pc.equal(rows["station"], station)))
        if whole < group.num_rows:
            return


def _rows_before_hole(numbers: pa.ChunkedArray, first: int) -> int:
    """Return how many of `numbers` follow each other from `first` on."""
    values = numbers.to_pylist()
    if not values or values[-1] - first == len(values) - 1:
        return len(values)
    return next(place for place, number in enumerate(values) if number != first + place)


def losses(folder: Path) -> list[str]:
    """Return what the sealed capture lacks, a sentence each. Raises `RecordError`."""
    found = []
    following = 0
    ended = set()
    stations = set()
    for group in row_groups(folder, CAPTURE, [SEQ, "station", "what"]):
        for number in group[SEQ].to_pylist():
            if number != following:
                found.append(f"{number - following} rows before row {number} are missing")
            following = number + 1
        stations.update(group["station"].unique().to_pylist())
        ended.update(group.filter(pc.equal(group["what"], "done"))["station"].unique().to_pylist())
    for station in sorted(stations - ended):
        found.append(f"the session of {station} has no end")
    return found
