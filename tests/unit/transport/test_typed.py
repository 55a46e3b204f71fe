"""Lines that come in while a run goes on: what makes one, what is none, and that nothing is lost or
waited for.
"""

from __future__ import annotations

import os
import pty
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.core.errors import UsageError
from jbclog.transport.typed_lines import (
    KEPT,
    LineSource,
    LineSplitter,
    SourceLost,
    TypedLine,
    is_plain_file,
    lines_of_file,
    open_source,
)
from support.command import until


def lines(*pieces: bytes) -> list[TypedLine]:
    splitter = LineSplitter()
    return [line for piece in pieces for line in splitter.feed(piece)]


@pytest.mark.parametrize("end", [b"\n", b"\r", b"\r\n"])
def test_a_reader_may_end_its_lines_as_it_is_set_up(end: bytes) -> None:
    assert lines(b"SN-1" + end, b"SN", b"-2" + end) == [TypedLine("SN-1"), TypedLine("SN-2")]


@given(st.lists(st.sampled_from(["SN-1", "Ä 7", "", "\x1dA"])), st.data())
def test_how_the_bytes_come_changes_nothing(serials: list[str], data: st.DataObject) -> None:
    whole = "".join(f"{serial}\r\n" for serial in serials).encode()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(whole)))))
    pieces = [whole[a:b] for a, b in zip([0, *cuts], [*cuts, len(whole)], strict=True)]
    assert lines(*pieces) == lines(whole)


@pytest.mark.parametrize("nothing", [b"\n", b"\r\n\r\n", b"  \t\n"])
def test_an_empty_line_is_none(nothing: bytes) -> None:
    assert lines(nothing) == []


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        (b"0104\x1d21A\n", "0104\\x1d21A"),  # GS1 with its group separator
        (b"SN\xe97\n", "SN\\xe97"),  # Latin-1
        (b"SN\xe2\x80\xae7\n", "SN\\u202e7"),  # turns the text around
        (b"\x1b[2JSN\n", "\\x1b[2JSN"),
        (b"SN\x00\n", "SN\\x00"),
    ],
)
def test_what_does_not_show_is_kept_as_an_escape_and_told(typed: bytes, kept: str) -> None:
    assert lines(typed) == [TypedLine(kept, is_clear=False)]


def test_two_serials_that_differ_in_what_does_not_show_differ() -> None:
    assert len({line.text for line in lines(b"A\x1dB\nA\x1eB\nAB\n")}) == 3


MARK = b"\xef\xbb\xbf"


@pytest.mark.parametrize(
    "pieces",
    [
        (MARK + b"SN-1\nSN-2\n",),
        (b"SN-1\n" + MARK + b"SN-2\n",),  # cat morning.txt evening.txt
        (MARK + b"SN-1\r\n" + MARK + b" SN-2" + MARK + b"\n",),
        (b"SN-1\n" + MARK + b"\n" + MARK + MARK + b"SN-2\n",),
        (b"SN-1\n" + MARK[:1], MARK[1:2], MARK[2:] + b"SN-2\n"),
    ],
)
def test_the_mark_that_windows_puts_first_is_no_part_of_a_serial(pieces: tuple[bytes, ...]) -> None:
    assert lines(*pieces) == [TypedLine("SN-1"), TypedLine("SN-2")]


def test_the_mark_within_a_serial_is_shown() -> None:
    """Nobody can know whether it is one serial or two."""
    assert lines(b"SN-1" + MARK + b"SN-2\n") == [TypedLine("SN-1\\ufeffSN-2", is_clear=False)]


@pytest.mark.parametrize("length", [201, KEPT, KEPT + 1, 10 * KEPT])
def test_a_line_that_is_too_long_is_told_as_such_and_the_next_one_counts(length: int) -> None:
    pieces = [b"X" * 256] * (length // 256) + [b"X" * (length % 256), b"\nSN-2\n"]
    assert lines(*pieces) == [TypedLine("X" * 200, is_whole=False), TypedLine("SN-2")]


def test_what_has_no_end_yet_is_not_lost() -> None:
    splitter = LineSplitter()
    assert (list(splitter.feed(b"SN-1\nSN")), list(splitter.finish()), list(splitter.finish())) == (
        [TypedLine("SN-1")],
        [TypedLine("SN")],
        [],
    )


# -- sources ---------------------------------------------------------------------------------------


def test_nothing_is_waited_for() -> None:
    reading, writing = os.pipe()
    source = LineSource(reading, "stdin")
    assert source.read() == b""  # or it would wait for ever
    os.write(writing, b"SN-1\n")
    assert source.read() == b"SN-1\n"
    os.close(writing)
    assert source.read() is None
    source.close()


def test_a_flood_stays_in_the_pipe() -> None:
    reading, writing = os.pipe()
    os.write(writing, b"y\n" * 20000)
    source = LineSource(reading, "stdin")
    assert len(source.read() or b"") <= 256
    source.close()
    os.close(writing)


def test_the_writers_of_a_named_pipe_come_and_go(tmp_path: Path) -> None:
    pipe = tmp_path / "serials"
    os.mkfifo(pipe)
    source = open_source(str(pipe))
    for serial in (b"SN-1\n", b"SN-2\n"):
        assert source.read() == b""
        pipe.write_bytes(serial)
        assert source.read() == serial
    assert source.read() == b""
    source.close()


def test_a_reader_on_a_terminal_of_its_own_that_is_unplugged() -> None:
    ours, theirs = pty.openpty()
    source = open_source(os.ttyname(theirs))
    os.close(theirs)
    os.write(ours, b"SN-1\r")
    assert source.is_typed
    heard = bytearray()
    # the system hands on in its own time what was typed
    assert until(lambda: heard.extend(source.read() or b"") or heard.endswith(b"\n"))  # type: ignore[func-returns-value]
    assert heard == b"SN-1\n"
    os.close(ours)
    with pytest.raises(SourceLost):
        source.read()
    source.close()


@pytest.mark.parametrize("name", ["nowhere/serials", "/", "a\0b", "x" * 5000])
def test_what_cannot_be_read_is_said_before_anything_is_sent(name: str) -> None:
    with pytest.raises(UsageError, match="--units"):
        open_source(name)


def test_a_plain_file_is_a_list(tmp_path: Path) -> None:
    file = tmp_path / "serials.txt"
    file.write_bytes(b"\xef\xbb\xbfSN-1\r\n\r\nSN-2")
    assert is_plain_file(str(file))
    assert lines_of_file(str(file), 100) == [TypedLine("SN-1"), TypedLine("SN-2")]
    with pytest.raises(UsageError, match="not a list of serials"):
        lines_of_file(str(file), 5)
