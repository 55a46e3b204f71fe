"""A small capture of a few commits whose questions and answers tell their numbers: what belongs
together can be told by looking.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from support.product import CaptureRow, Head, LinkRow, ResultRow, WireRecorder

HEAD = Head("dde-1", "/dev/ttyUSB0", "tht.toml", 8123.480001251, 1_790_000_000.25, 90.0)
BLOCKS = 6


def question(number: int) -> bytes:
    return b"\x020001RTT%d\x03" % number


def answer(number: int) -> bytes:
    return b"\x020100ATT%d%05d\x03" % (number, 300 + number)


def rows_of(exchanges: range) -> Iterator[CaptureRow]:
    """Each question with its answer, both of which tell their number."""
    for number in exchanges:
        at_s = 8124.0 + number * 0.0147123
        yield LinkRow(at_s, "sent", question(number))
        yield LinkRow(at_s + 0.014, "heard", answer(number))
        yield ResultRow(at_s + 0.0140021, "told", "ask", len(answer(number)), at_s - 1.7e-6)


def pieces() -> Iterator[list[CaptureRow]]:
    yield [LinkRow(8123.51, "opened", text="/dev/ttyUSB0")]
    for number in range(BLOCKS - 3):
        yield list(rows_of(range(2 * number, 2 * number + 2)))
    yield [
        ResultRow(8200.0, "broke", "listen", text='the "port"\tis\ngone…'),
        ResultRow(8201.0, "done", "wait"),
    ]


ROWS = [row for piece in pieces() for row in piece]


def write_wire(folder: Path) -> None:
    """Write that capture in the folder of a run."""
    recorder = WireRecorder(folder)
    keep = recorder.begin(HEAD)
    for piece in pieces():
        for row in piece:
            keep(row)
        recorder.write()
    recorder.close()
