"""OMEGA's frames: what the manual prints, and what the reader makes of damage."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jbclog.protocol.omega import LONGEST, MOST_HELD, OmegaReader, encode, only_reads, sum_of
from jbclog.protocol.reader import Corrupt

K12C = b"\x02\x4b\x31\x32\x43\x03\x46\x31"  # 003, 11.2, page 5: "STX 'K' '1' '2' 'C' ETX 'F' '1'"
COMPUTED = [  # sums of the text by hand, their low eight bits
    ("A", b"\x02A\x0341"),  # 65 = 41h; the information request of 003, 11.3.1
    ("a0", b"\x02a0\x0391"),  # 97 + 48 = 145 = 91h
    ("B", b"\x02B\x0342"),
    ("C007C", b"\x02C007C\x031D"),  # 67 + 48 + 48 + 55 + 67 = 285 = 11Dh
    ("H0065", b"\x02H0065\x0313"),  # 72 + 48 + 48 + 54 + 53 = 275 = 113h
]
TEXTS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=LONGEST)
CONTROL = st.lists(st.sampled_from([0x00, 0x02, 0x03, 0x41, 0x34, 0x31, 0xFF]), max_size=12).map(bytes)
PIECES = st.one_of(TEXTS.map(encode), CONTROL, st.binary(max_size=20), TEXTS.map(lambda text: encode(text)[:-1]))
STREAMS = st.lists(PIECES, max_size=8).map(b"".join)


def test_the_printed_frame() -> None:
    assert encode("K12C") == K12C
    assert OmegaReader().feed(K12C) == ["K12C"]


@pytest.mark.parametrize(("text", "wire"), COMPUTED)
def test_frames_computed_by_hand(text: str, wire: bytes) -> None:
    assert encode(text) == wire
    assert OmegaReader().feed(wire) == [text]


def test_a_sum_of_more_than_eight_bits_keeps_the_low_ones() -> None:
    """003, 11.2: 1526 is 5F6h, and F6 is sent."""
    text = b"z" * 12 + b">"
    assert sum(text) == 1526
    assert sum_of(text) == b"F6"


@pytest.mark.parametrize("text", ["", "\x03", "é", "x" * (LONGEST + 1)])
def test_what_can_be_no_frame(text: str) -> None:
    with pytest.raises(ValueError, match="printable ASCII"):
        encode(text)


@pytest.mark.parametrize("text", ["A", "B", "C007C", "F", "G"])
def test_what_asks(text: str) -> None:
    assert only_reads(encode(text))
    assert not only_reads(encode(text) + b"\x02")
    assert not only_reads(encode(text)[:-1] + b"0")


@pytest.mark.parametrize("text", ["D007C0", "H0065", "K12C", "a0", "d"])
def test_what_does_more_than_ask(text: str) -> None:
    assert not only_reads(encode(text))


def test_a_frame_in_every_two_pieces() -> None:
    reader = OmegaReader()
    for cut in range(len(K12C)):
        assert reader.feed(K12C[:cut]) == []
        assert reader.feed(K12C[cut:]) == ["K12C"]
    assert (reader.garbage, reader.corrupt) == (0, 0)


@pytest.mark.parametrize("place", range(len(K12C)))
def test_a_lost_byte_costs_only_its_frame(place: int) -> None:
    found = OmegaReader().feed(K12C[:place] + K12C[place + 1 :] + b"\x02a0\x0391")
    assert [one for one in found if isinstance(one, str)] == ["a0"]


def test_a_flipped_bit_is_never_believed() -> None:
    for bit in range(8 * len(K12C)):
        flipped = bytearray(K12C)
        flipped[bit // 8] ^= 1 << bit % 8
        found = OmegaReader().feed(bytes(flipped) + b"\x02a0\x0391")
        assert [one for one in found if isinstance(one, str)] == ["a0"]


def test_a_wrong_sum_is_counted_and_given_with_its_bytes() -> None:
    reader = OmegaReader()
    assert reader.feed(b"?\x02a0\x0390\x02a1\x0392") == [Corrupt(b"\x02a0\x0390"), "a1"]
    assert (reader.corrupt, reader.garbage) == (1, 1)


@given(STREAMS, st.lists(st.integers(1, 30), max_size=60))
def test_any_cutting_gives_the_same(stream: bytes, lengths: list[int]) -> None:
    whole, cut = OmegaReader(), OmegaReader()
    expected = whole.feed(stream)
    found, rest = [], stream
    for length in lengths:
        found += cut.feed(rest[:length])
        rest = rest[length:]
    found += cut.feed(rest)
    assert found == expected
    assert (cut.garbage, cut.corrupt) == (whole.garbage, whole.corrupt)
    assert cut.reset() == whole.reset() <= MOST_HELD
