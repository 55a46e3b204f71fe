"""What holds for the readers whatever comes, tried with streams that nobody thought of."""

from __future__ import annotations

import random
import tracemalloc
from collections.abc import Callable
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.golden import summed, wire_of, with_check_byte
from support.product import (
    MOST_HELD,
    MOST_HELD_OF_OMEGA,
    CorruptFrame,
    Frame,
    FrameReader,
    OmegaReader,
)

GARBAGE_BYTES = 256

Reader = FrameReader | OmegaReader
Told = Frame | str


class System(NamedTuple):
    """One protocol: its reader, what a good frame gives, and its bytes by the manual's rule."""

    reader: Callable[[], Reader]
    frames: st.SearchStrategy[Told]
    wire: Callable[[Told], bytes]
    most_held: int


def _printable(least: int) -> st.SearchStrategy[str]:
    return st.text(
        st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=least, max_size=20
    )


ADDRESSES = st.one_of(st.just((None, None)), st.tuples(st.integers(0, 99), st.integers(0, 99)))
JBC = System(
    FrameReader,
    st.builds(
        lambda header, text, pair: Frame(header, text, *pair),
        st.sampled_from("RWAN"),
        _printable(2),
        ADDRESSES,
    ),
    wire_of,
    MOST_HELD,
)
OMEGA = System(OmegaReader, _printable(1), summed, MOST_HELD_OF_OMEGA)

both = pytest.mark.parametrize("system", [JBC, OMEGA], ids=["jbc", "omega"])

CONTROL = st.lists(
    st.sampled_from([0x00, 0x02, 0x03, 0x10, 0x11, 0x13, 0x15, 0x41, 0x30, 0xFF]), max_size=12
).map(bytes)
FRAMED = _printable(2).map(lambda text: b"\x02" + text.encode("ascii") + b"\x03")
LOSES_AN_STX = _printable(3).map(lambda text: _ending_in_stx(text)[:-1])
"""A frame whose own check byte is an STX, and lost."""


def _ending_in_stx(text: str) -> bytes:
    """A frame with this text and one character more, by which its check byte becomes an STX, if a
    printable one does.
    """
    check = with_check_byte(b"\x02" + text.encode("ascii") + b"\x03")[-1] ^ 0x02
    return with_check_byte(b"\x02" + text.encode("ascii") + bytes([check]) + b"\x03")


def _pieces(system: System) -> st.SearchStrategy[bytes]:
    whole = system.frames.map(system.wire)
    return st.one_of(
        st.binary(max_size=30),
        CONTROL,
        FRAMED,
        LOSES_AN_STX,
        whole,
        whole.map(lambda wire: wire[:-1]),
    )


def _streams(system: System) -> st.SearchStrategy[bytes]:
    return st.lists(_pieces(system), max_size=8).map(b"".join)


def _good(found: list[Frame | CorruptFrame] | list[str | CorruptFrame]) -> list[Told]:
    return [one for one in found if not isinstance(one, CorruptFrame)]


@both
@given(data=st.data())
def test_what_was_sent_is_what_is_read(system: System, data: st.DataObject) -> None:
    frames = data.draw(st.lists(system.frames, max_size=8))
    one = system.reader()
    assert one.feed(b"".join(system.wire(frame) for frame in frames)) == frames
    assert one.garbage == one.reset() == 0


@both
@given(data=st.data(), lengths=st.lists(st.integers(1, 30), max_size=60))
def test_any_cutting_gives_the_same(
    system: System, data: st.DataObject, lengths: list[int]
) -> None:
    stream = data.draw(_streams(system))
    whole, cut = system.reader(), system.reader()
    expected = list(whole.feed(stream))
    found, rest = [], stream
    for length in lengths:
        found += cut.feed(rest[:length])
        rest = rest[length:]
    found += cut.feed(rest)
    assert found == expected
    assert cut.garbage == whole.garbage
    assert cut.reset() == whole.reset()


@both
@given(data=st.data())
def test_byte_by_byte_gives_the_same(system: System, data: st.DataObject) -> None:
    stream = data.draw(_streams(system))
    cut = system.reader()
    assert [found for byte in stream for found in cut.feed(bytes([byte]))] == system.reader().feed(
        stream
    )


@both
@given(data=st.data())
def test_every_byte_is_accounted_for(system: System, data: st.DataObject) -> None:
    stream = data.draw(_streams(system))
    one = system.reader()
    found = one.feed(stream)
    in_frames = [system.wire(frame) for frame in _good(found)]
    # STX: the next begins
    in_corrupt = sum(
        len(one.raw) - (one.raw[-1] == 0x02) for one in found if isinstance(one, CorruptFrame)
    )
    held = one.reset()
    total = sum(len(wire) for wire in in_frames) + in_corrupt + one.garbage
    # may stand for the STX of the next frame as well
    shared = sum(wire[-1] == 0x02 for wire in in_frames)
    assert len(stream) <= total <= len(stream) + shared
    assert held <= system.most_held


@both
@given(data=st.data())
def test_nothing_is_believed_that_does_not_stand_there(system: System, data: st.DataObject) -> None:
    stream, place = data.draw(_streams(system)), 0
    for frame in _good(system.reader().feed(stream)):
        wire = system.wire(frame)
        place = stream.index(wire, place) + len(wire) - (wire[-1] == 0x02)


@both
@given(data=st.data())
def test_the_first_good_frame_behind_garbage_is_given(system: System, data: st.DataObject) -> None:
    """With no exception, whatever the garbage is and ends in."""
    garbage = data.draw(st.one_of(st.binary(max_size=GARBAGE_BYTES), _streams(system)))[
        -GARBAGE_BYTES:
    ]
    frame = data.draw(system.frames)
    assert _good(system.reader().feed(garbage + system.wire(frame)))[-1:] == [frame]


@given(_printable(3), JBC.frames)
def test_also_where_its_stx_stands_for_a_lost_check_byte(text: str, frame: Frame) -> None:
    damaged = _ending_in_stx(text)
    found = _good(FrameReader().feed(damaged[:-1] + wire_of(frame)))
    assert found[-1] == frame
    assert _good(FrameReader().feed(damaged + wire_of(frame)))[-1] == frame


@both
@given(data=st.data())
def test_after_a_reset_nothing_old_is_left(system: System, data: st.DataObject) -> None:
    stream, frame = data.draw(_streams(system)), data.draw(system.frames)
    one = system.reader()
    one.feed(stream)
    one.reset()
    assert one.feed(system.wire(frame)) == [frame]


@both
@pytest.mark.parametrize("count", [200_000, pytest.param(10_000_000, marks=pytest.mark.campaign)])
def test_random_bytes_take_no_memory(
    system: System, count: int, counted: Callable[..., None]
) -> None:
    """Noise between frames (docs/reference/faults.md, F-1): the memory stays flat, and every byte
    is garbage or in a frame.
    """
    source, one = random.Random(count), system.reader()
    believed = sum(len(_good(one.feed(source.randbytes(500)))) for _ in range(20))
    tracemalloc.start()
    fed = 10_000
    first = tracemalloc.get_traced_memory()[0]
    while fed < count:
        chunk = (
            bytes(source.choices(b"\x02\x03RWAN0123456789\x00\xff", k=500))
            if fed % 3
            else source.randbytes(500)
        )
        believed += len(_good(one.feed(chunk)))
        fed += 500
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    if count > 200_000:
        counted(random_bytes=fed, frames_by_chance=believed)
    assert peak - first < 100_000
    assert one.garbage > count / 2
    assert one.reset() <= system.most_held
    assert believed < count / 1000
