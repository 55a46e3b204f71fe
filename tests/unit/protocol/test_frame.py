"""Frames that cannot be: refused in the encoder, not believed in the parser."""

from __future__ import annotations

import pytest

from support.product import Frame, parse_frame


@pytest.mark.parametrize(
    ("frame", "why"),
    [
        (Frame("X", "SMN"), "not one of R, W, A, N"),
        (Frame("", "SMN"), "not one of R, W, A, N"),
        (Frame("RW", "SMN"), "not one of R, W, A, N"),
        (Frame("r", "SMN"), "not one of R, W, A, N"),
        (Frame("W", "ST100350\r"), "not printable"),
        (Frame("W", "ST1\x02"), "not printable"),
        (Frame("W", "ST1\x7f"), "not printable"),
        (Frame("W", "ST1٣"), "not printable"),
        (Frame("R", "SMN", 0, 100), "between 0 and 99"),
        (Frame("R", "SMN", -1, 1), "between 0 and 99"),
        (Frame("R", "SMN", 0, None), "both addresses or none"),
        (Frame("R", "SMN", None, 1), "both addresses or none"),
    ],
)
def test_a_frame_that_cannot_be_sent(frame: Frame, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        frame.encode()


@pytest.mark.parametrize(
    ("content", "frame"),
    [
        (b"RSMN", Frame("R", "SMN")),
        (b"0001RSMN", Frame("R", "SMN", 0, 1)),
        (b"0100ASMN  DDR", Frame("A", "SMN  DDR", 1, 0)),
        (b"9920N00004", Frame("N", "00004", 99, 20)),
        (b"A", Frame("A", "")),
    ],
)
def test_what_stands_between_stx_and_etx(content: bytes, frame: Frame) -> None:
    assert parse_frame(content) == frame


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"0001",
        b"0001X",
        b"001RSMN",
        b"00001RSMN",
        b"00 1RSMN",
        b"-001RSMN",
        b"rSMN",
        b" RSMN",
        b"1234567",
        "0001RSMÑ".encode(),
        b"\xff",
    ],
)
def test_what_cannot_be_a_frame(content: bytes) -> None:
    assert parse_frame(content) is None
