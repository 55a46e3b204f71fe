"""The reader on every kind of damage that a line does."""

from __future__ import annotations

import pytest

from support.campaigns.each_row import each_row
from support.golden import FRAMES as GOLDEN
from support.golden import wire_of, with_check_byte
from support.product import (
    LONGEST_FRAME,
    MOST_HELD,
    SHORTEST_FRAME,
    CorruptFrame,
    Frame,
    FrameReader,
)

FRAMES = sorted({wire for golden in GOLDEN for wire in (golden.bare, golden.addressed)})
every_frame = each_row((repr(wire), (wire,)) for wire in FRAMES)
TIP = b"\x020100ATT100183\x03\x4a"
TIP_FRAME = Frame("A", "TT100183", 1, 0)


def _frames(found: list[Frame | CorruptFrame]) -> list[Frame]:
    return [one for one in found if isinstance(one, Frame)]


def _read(wire: bytes) -> list[Frame]:
    return _frames(FrameReader().feed(wire))


def test_frames_back_to_back() -> None:
    reader = FrameReader()
    assert [wire_of(frame) for frame in _frames(reader.feed(b"".join(FRAMES)))] == FRAMES
    assert reader.garbage == 0


@every_frame
def test_a_frame_in_every_two_pieces(wire: bytes) -> None:
    reader = FrameReader()
    for cut in range(len(wire)):
        assert reader.feed(wire[:cut]) == []
        assert [wire_of(frame) for frame in _frames(reader.feed(wire[cut:]))] == [wire]
    assert reader.garbage == 0


@every_frame
def test_a_lost_byte_costs_only_its_frame(wire: bytes) -> None:
    """Whichever byte is lost, the frame behind is given; and what is given of the damaged one is
    nothing, or was true.
    """
    for place in range(len(wire)):
        found = _read(wire[:place] + wire[place + 1 :] + TIP)
        lost_check_byte_stood_for_by_stx = place == len(wire) - 1 and wire[-1] == 0x02
        assert found == [
            *([Frame(*_meaning(wire))] if lost_check_byte_stood_for_by_stx else []),
            TIP_FRAME,
        ]


def _meaning(wire: bytes) -> tuple[str, str, int | None, int | None]:
    (frame,) = _read(wire)
    return frame.header, frame.text, frame.source, frame.target


@every_frame
def test_a_flipped_bit_is_never_believed(wire: bytes) -> None:
    """Exhaustive, and the frame behind is given whatever the flip made of this one."""
    for bit in range(8 * len(wire)):
        flipped = bytearray(wire)
        flipped[bit // 8] ^= 1 << bit % 8
        assert _read(bytes(flipped)) == []
        assert _read(bytes(flipped) + TIP) == [TIP_FRAME]


@every_frame
def test_a_doubled_byte_costs_only_its_frame(wire: bytes) -> None:
    for place in range(len(wire)):
        found = _read(wire[: place + 1] + wire[place:] + TIP)
        assert found[-1] == TIP_FRAME
        # a doubled STX or check byte does no harm
        assert all(wire_of(frame) == wire for frame in found[:-1])


@every_frame
def test_the_rest_of_a_frame_whose_beginning_was_missed(wire: bytes) -> None:
    for place in range(1, len(wire)):
        assert _read(wire[place:] + TIP) == [TIP_FRAME]


@pytest.mark.parametrize(
    "noise",
    [
        b"",
        b"\x00\xff\x7f",
        b"\x02",
        b"\x02\x02\x02",
        b"\x03\x03",
        b"\x02\x03",
        b"\x02\x03\x01",  # STX, ETX and their right check byte: too short to be a frame
        b"\x02RS\x03\x00",
        b"\x02RSMN",
        b"\x02RSMN\x03",
        b"\x02RSMN\x03\x7f",
        b"\x02RSMN\n\x03\x03",
        b"\x020100ATT1001",
        b"\x02" + b"0" * (LONGEST_FRAME + 1),
        b"\x02" + b"0" * 10_000,
        b"\x13\x11",
    ],
)
def test_a_frame_behind_noise(noise: bytes) -> None:
    assert _read(noise + TIP) == [TIP_FRAME]


def test_a_whole_frame_that_means_nothing_does_not_cost_the_next_one_its_stx() -> None:
    """Right check byte, no header; and the check byte is the STX of the frame behind."""
    nonsense = with_check_byte(b"\x02xy|~\x03")
    assert nonsense[-1] == 0x02
    found = FrameReader().feed(nonsense[:-1] + TIP)
    assert found == [CorruptFrame(nonsense), TIP_FRAME]


def test_garbage_is_counted_to_the_byte() -> None:
    reader = FrameReader()
    reader.feed(b"noise" + TIP + b"\x02half" + TIP + b"\x02\x03" + TIP)
    assert reader.garbage == 5 + 5 + 2
    reader.feed(b"\x020100ATT")
    assert reader.garbage == 12  # it may still become a frame
    assert reader.reset() == 8
    assert reader.garbage == 20


def test_a_corrupt_frame_is_told_with_all_its_bytes() -> None:
    reader = FrameReader()
    wrong = TIP[:-1] + b"\x4b"
    assert reader.feed(wrong + TIP) == [CorruptFrame(wrong), TIP_FRAME]
    assert reader.garbage == 0


def test_the_longest_and_the_shortest() -> None:
    for length in (SHORTEST_FRAME, LONGEST_FRAME):
        wire = with_check_byte(b"\x02" + b"A".ljust(length, b"x") + b"\x03")
        assert [wire_of(frame) for frame in _read(wire)] == [wire]
    for length in (SHORTEST_FRAME - 1, LONGEST_FRAME + 1):
        assert (
            FrameReader().feed(with_check_byte(b"\x02" + b"A".ljust(length, b"x") + b"\x03")) == []
        )


def test_what_is_held_is_bounded() -> None:
    reader = FrameReader()
    reader.feed(b"\x02" + b"0" * LONGEST_FRAME + b"\x03")
    assert reader.reset() == MOST_HELD
    for noise in (
        b"\x02" + b"0" * 100_000,
        b"\x02" * 100_000,
        b"\x02ab\x03" * 50_000,
        b"\xff" * 100_000,
    ):
        reader.feed(noise)
        assert reader.reset() <= MOST_HELD
