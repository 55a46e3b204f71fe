"""OMEGA's frames: what the manual prints is read, and what the reader makes of damage; more in
`test_reader_properties.py`.
"""

from __future__ import annotations

import pytest

from support.golden import manual_003
from support.product import CorruptFrame, OmegaReader

K12C = b"\x02\x4b\x31\x32\x43\x03\x46\x31"  # 003, 11.2, page 5: "STX 'K' '1' '2' 'C' ETX 'F' '1'"


@pytest.mark.parametrize(
    "golden",
    [*manual_003.FRAMES, *manual_003.BY_HAND],
    ids=lambda golden: f"{golden.where} {golden.text}",
)
def test_what_is_printed_or_worked_out_by_hand_is_read(golden: manual_003.OmegaGolden) -> None:
    reader = OmegaReader()
    assert reader.feed(golden.wire) == [golden.text]
    assert (reader.garbage, reader.corrupt, reader.reset()) == (0, 0, 0)


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
    assert reader.feed(b"?\x02a0\x0390\x02a1\x0392") == [CorruptFrame(b"\x02a0\x0390"), "a1"]
    assert (reader.corrupt, reader.garbage) == (1, 1)
