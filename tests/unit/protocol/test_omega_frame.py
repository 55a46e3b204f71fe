"""OMEGA's frames as they are written; how they are read is in
`tests/unit/protocol/frame/test_omega.py`.
"""

from __future__ import annotations

import pytest

from support.golden import manual_003
from support.product import (
    LONGEST_OMEGA_FRAME,
    encode_omega,
    omega_sum_of,
    only_omega_reads,
)


@pytest.mark.parametrize(
    "golden",
    [*manual_003.FRAMES, *manual_003.BY_HAND],
    ids=lambda golden: f"{golden.where} {golden.text}",
)
def test_it_is_written(golden: manual_003.OmegaGolden) -> None:
    assert encode_omega(golden.text) == golden.wire


def test_a_sum_of_more_than_eight_bits_keeps_the_low_ones() -> None:
    """003, 11.2: 1526 is 5F6h, and F6 is sent."""
    text = b"z" * 12 + b">"
    assert sum(text) == 1526
    assert omega_sum_of(text) == b"F6"


@pytest.mark.parametrize("text", ["", "\x03", "é", "x" * (LONGEST_OMEGA_FRAME + 1)])
def test_what_can_be_no_frame(text: str) -> None:
    with pytest.raises(ValueError, match="printable ASCII"):
        encode_omega(text)


@pytest.mark.parametrize("text", ["A", "B", "C007C", "F", "G"])
def test_what_asks(text: str) -> None:
    assert only_omega_reads(encode_omega(text))
    assert not only_omega_reads(encode_omega(text) + b"\x02")
    assert not only_omega_reads(encode_omega(text)[:-1] + b"0")


@pytest.mark.parametrize("text", ["D007C0", "H0065", "K12C", "a0", "d"])
def test_what_does_more_than_ask(text: str) -> None:
    assert not only_omega_reads(encode_omega(text))
