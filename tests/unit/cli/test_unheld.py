"""What is printed is taken at once, and lost only where nobody took it in time."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from jbclog.cli import streams
from jbclog.cli.streams import NonblockingOutput


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    reading, writing = os.pipe()
    yield reading, writing
    os.close(writing)


def fill(writing: int) -> int:
    """Write until nothing more is taken; how much that was."""
    size = 0
    os.set_blocking(writing, False)
    try:
        while True:
            size += os.write(writing, b"x" * 4096)
    except BlockingIOError:
        os.set_blocking(writing, True)
    return size


def test_all_comes_in_order(pipe: tuple[int, int]) -> None:
    stream = NonblockingOutput(pipe[1])
    for number in range(1000):
        stream.write(b"%d\n" % number)
    assert stream.settle()
    assert os.read(pipe[0], 1 << 16) == b"".join(b"%d\n" % number for number in range(1000))
    assert stream.lost == 0
    os.close(pipe[0])


def test_who_does_not_read_is_not_waited_for(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "END_S", 0.1)
    before = fill(pipe[1])
    stream = NonblockingOutput(pipe[1])
    stream.write(b"the end")
    assert not stream.settle()  # or it would wait for ever
    assert not stream.settle()  # its patience is spent
    while before > 0:  # somebody reads after all
        before -= len(os.read(pipe[0], before))
    assert os.read(pipe[0], 100) == b"the end"
    os.close(pipe[0])


def test_what_waits_is_bounded(pipe: tuple[int, int]) -> None:
    fill(pipe[1])
    stream = NonblockingOutput(pipe[1])
    for _ in range(3 * streams.WAITING_MOST // 65_536):
        stream.write(b"x" * 65_536)
    assert stream.lost >= streams.WAITING_MOST
    os.close(pipe[0])
    # its thread writes no more: the descriptor's number will be another pipe's
    assert stream.settle()


def test_a_reader_that_goes_is_no_error(pipe: tuple[int, int]) -> None:
    os.close(pipe[0])
    stream = NonblockingOutput(pipe[1])
    assert stream.write(b"nobody reads this") == 17
    assert stream.settle()
    assert stream.lost == 17


def test_a_stream_that_is_no_descriptor_stays_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    streams.never_wait()
    print("seen")
    assert capsys.readouterr().out == "seen\n"


@pytest.mark.parametrize("apart", [False, True])
def test_data_and_notes_on_one_terminal_keep_their_order(
    pipe: tuple[int, int], apart: bool
) -> None:
    """Or what erases a live table would erase the data printed after it. Streams that lead
    elsewhere do not wait for each other.
    """
    write = "from jbclog.cli.streams import never_wait; import sys; never_wait()\n"
    write += "for at in range(200): print(at, file=sys.stderr if at % 2 else sys.stdout)"
    notes = subprocess.PIPE if apart else pipe[1]
    ended = subprocess.run(
        [sys.executable, "-c", write], stdout=pipe[1], stderr=notes, check=True, timeout=200
    )
    assert [int(line) for line in os.read(pipe[0], 1 << 16).split()] == list(
        range(0, 200, 1 + apart)
    )
    assert [int(line) for line in (ended.stderr or b"").split()] == (
        list(range(1, 200, 2)) if apart else []
    )
    os.close(pipe[0])
