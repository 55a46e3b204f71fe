"""What holds for the reader whatever comes, tried with streams that nobody thought of."""

from __future__ import annotations

import random
import tracemalloc

import pytest
from golden import with_check_byte
from hypothesis import given
from hypothesis import strategies as st

from jbclog.protocol.frame import Frame
from jbclog.protocol.reader import MOST_HELD, Corrupt, FrameReader

PRINTABLE = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=2, max_size=20)
ADDRESSES = st.one_of(st.just((None, None)), st.tuples(st.integers(0, 99), st.integers(0, 99)))
FRAMES = st.builds(lambda header, text, pair: Frame(header, text, *pair), st.sampled_from("RWAN"), PRINTABLE, ADDRESSES)
CONTROL = st.lists(st.sampled_from([0x00, 0x02, 0x03, 0x11, 0x13, 0x41, 0x30, 0xFF]), max_size=12).map(bytes)
GARBAGE = st.one_of(st.binary(max_size=30), CONTROL, PRINTABLE.map(lambda text: b"\x02" + text.encode() + b"\x03"))
PIECES = st.one_of(FRAMES.map(Frame.encode), GARBAGE, FRAMES.map(lambda frame: frame.encode()[:-1]))
STREAMS = st.lists(PIECES, max_size=8).map(b"".join)


def _frames(found: list[Frame | Corrupt]) -> list[Frame]:
    return [one for one in found if isinstance(one, Frame)]


@given(st.lists(FRAMES, max_size=8))
def test_what_was_sent_is_what_is_read(frames: list[Frame]) -> None:
    reader = FrameReader()
    assert reader.feed(b"".join(frame.encode() for frame in frames)) == frames
    assert reader.garbage == reader.reset() == 0


@given(STREAMS, st.lists(st.integers(1, 30), max_size=60))
def test_any_cutting_gives_the_same(stream: bytes, lengths: list[int]) -> None:
    whole, cut = FrameReader(), FrameReader()
    expected = whole.feed(stream)
    found, rest = [], stream
    for length in lengths:
        found += cut.feed(rest[:length])
        rest = rest[length:]
    found += cut.feed(rest)
    assert found == expected
    assert cut.garbage == whole.garbage
    assert cut.reset() == whole.reset()


@given(STREAMS)
def test_every_byte_is_accounted_for(stream: bytes) -> None:
    reader = FrameReader()
    found = reader.feed(stream)
    in_frames = sum(len(frame.encode()) for frame in _frames(found))
    in_corrupt = sum(len(one.raw) - (one.raw[-1] == 0x02) for one in found if isinstance(one, Corrupt))  # STX: the next begins
    held = reader.reset()
    assert in_frames + in_corrupt + reader.garbage == len(stream)
    assert held <= MOST_HELD


@given(STREAMS)
def test_nothing_is_believed_that_does_not_stand_there(stream: bytes) -> None:
    place = 0
    for frame in _frames(FrameReader().feed(stream)):
        wire = frame.encode()
        place = stream.index(wire, place) + len(wire)
        assert with_check_byte(wire[:-1]) == wire


@given(GARBAGE, FRAMES)
def test_the_first_good_frame_behind_garbage_is_given(garbage: bytes, frame: Frame) -> None:
    before = _frames(FrameReader().feed(garbage + b"\x02"))
    after = _frames(FrameReader().feed(garbage + frame.encode()))
    if before and before[-1].encode()[-1] == 0x02:  # its STX stood for the lost check byte of a frame in the garbage
        assert after[: len(before)] == before
    else:
        assert frame in after


@given(GARBAGE, FRAMES)
def test_the_second_good_frame_behind_garbage_is_given_always(garbage: bytes, frame: Frame) -> None:
    assert _frames(FrameReader().feed(garbage + 2 * frame.encode()))[-1] == frame


@given(STREAMS, FRAMES)
def test_after_a_reset_nothing_old_is_left(stream: bytes, frame: Frame) -> None:
    reader = FrameReader()
    reader.feed(stream)
    reader.reset()
    assert reader.feed(frame.encode()) == [frame]


@pytest.mark.parametrize("count", [200_000, pytest.param(10_000_000, marks=pytest.mark.campaign)])
def test_random_bytes_take_no_memory(count: int) -> None:
    """Noise between frames (faults.md, row 1): the memory stays flat, and every byte is garbage or in a frame."""
    source, reader = random.Random(count), FrameReader()
    believed = sum(len(_frames(reader.feed(source.randbytes(500)))) for _ in range(20))
    tracemalloc.start()
    fed = 10_000
    first = tracemalloc.get_traced_memory()[0]
    while fed < count:
        chunk = bytes(source.choices(b"\x02\x03RWAN0123456789\x00\xff", k=500)) if fed % 3 else source.randbytes(500)
        believed += len(_frames(reader.feed(chunk)))
        fed += 500
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak - first < 100_000
    assert reader.garbage > count / 2
    assert reader.reset() <= MOST_HELD
    assert believed < count / 1000
