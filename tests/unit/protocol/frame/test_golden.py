"""Every frame and every example that the manuals print: its check byte worked out anew, and read by
the reader.

What it means in the product's tables, and that the product writes the same bytes, is in
`../commands/test_golden.py`.
"""

from __future__ import annotations

import pytest

from support.campaigns.each_row import each_row
from support.golden import (
    FRAMES,
    JBC,
    WHOLE,
    Golden,
    framed,
    manual_003,
    manual_004,
    with_check_byte,
)
from support.product import Frame, FrameReader

every = each_row((f"{golden.where} {golden.text}", (golden,)) for golden in FRAMES)


@pytest.mark.parametrize(("where", "page", "printed", "wire"), WHOLE)
def test_the_frames_that_are_printed_whole(
    where: str, page: int, printed: str, wire: bytes
) -> None:
    assert bytes.fromhex(printed.split(maxsplit=2 if "Sending" in printed else 1)[-1]) == wire
    assert with_check_byte(wire[:-1]) == wire
    addresses = (0, 1) if len(wire) == 16 else (None, None)
    assert FrameReader().feed(wire) == [Frame("W", "MAT00375", *addresses)]
    assert wire in [
        form
        for golden in FRAMES
        if golden.where == where
        for form in (golden.bare, golden.addressed)
    ]


@every
def test_the_check_byte_is_the_xor_of_all_before_it(golden: Golden) -> None:
    assert with_check_byte(golden.bare[:-1]) == golden.bare
    assert golden.bare == framed(golden.text)


@every
def test_it_is_read(golden: Golden) -> None:
    header, text = golden.text[0], golden.text[1:]
    pair = (0, 1) if header in "RW" else (1, 0)
    for wire, addresses in ((golden.bare, (None, None)), (golden.addressed, pair)):
        reader = FrameReader()
        assert reader.feed(wire) == [Frame(header, text, *addresses)]
        assert reader.garbage == 0
        assert reader.reset() == 0


@pytest.mark.parametrize(("where", "page", "printed", "addresses"), manual_004.ADDRESSES)
def test_printed_addresses_are_read(
    where: str, page: int, printed: str, addresses: tuple[bytes, ...]
) -> None:
    for address in addresses:
        assert f'"{address.decode("ascii")}"' in printed
        wire = with_check_byte(b"\x02" + address + b"00ASER00000\x03")
        assert FrameReader().feed(wire) == [Frame("A", "SER00000", int(address), 0)]


def test_a_refusal_is_read_with_any_code_or_none() -> None:
    """No N frame is printed, only the numbers that stand in its data
    (docs/reference/contradictions.md, B-11).
    """
    for where, _page, printed, data in (one for manual in JBC for one in manual.REFUSALS):
        assert printed.startswith(data.decode("ascii")), where
        for code in ("TT1", "A12", "SMN", "TT", ""):
            text = code + data.decode("ascii")
            assert FrameReader().feed(framed("N" + text)) == [Frame("N", text)]
            assert FrameReader().feed(framed("N" + text, "0100")) == [Frame("N", text, 1, 0)]


@pytest.mark.parametrize(
    ("wire", "meaning"),
    [
        # the identification is the first command of every run, and its check byte is ETX or STX
        # (docs/reference/protocol.md)
        (b"\x02RSMN\x03\x03", Frame("R", "SMN")),
        (b"\x020001RSMN\x03\x02", Frame("R", "SMN", 0, 1)),
        (b"\x020100ASMN JTSE\x03\x39", Frame("A", "SMN JTSE", 1, 0)),
        (b"\x02AA12\x03\x02", Frame("A", "A12")),
        (b"\x020100AA12\x03\x03", Frame("A", "A12", 1, 0)),
        (b"\x020001RMIT\x03\x02", Frame("R", "MIT", 0, 1)),
        (b"\x02RS11\x03\x00", Frame("R", "S11")),
        # the addressed one's check byte: a misprint must not pass
        (b"\x02NTT100004\x03\x4b", None),
        (b"\x02NTT100004\x03\x4a", Frame("N", "TT100004")),
        (b"\x02ATT00045\x03\x71", Frame("A", "TT00045")),
        (b"\x020001RST1\x03\x64", Frame("R", "ST1", 0, 1)),
        (b"\x020001RTT1\x03\x63", Frame("R", "TT1", 0, 1)),
        (b"\x020100APP100840\x03\x4c", Frame("A", "PP100840", 1, 0)),
        (b"\x020100APE100004\x03\x51", Frame("A", "PE100004", 1, 0)),
        (b"\x020001WST100350\x03\x57", Frame("W", "ST100350", 0, 1)),
        (b"\x020100AST1\x03\x77", Frame("A", "ST1", 1, 0)),
        (b"\x020001WA1200012\x03\x26", Frame("W", "A1200012", 0, 1)),
        (b"\x020001WA12-0050\x03\x3d", Frame("W", "A12-0050", 0, 1)),
        (b"\x020001WA12.0050\x03\x3e", Frame("W", "A12.0050", 0, 1)),
        (b"\x020001WHD101.60\x03\x43", Frame("W", "HD101.60", 0, 1)),
        (b"\x020001WHD199999\x03\x53", Frame("W", "HD199999", 0, 1)),
        (b"\x020001WNVS00000\x03\x2c", Frame("W", "NVS00000", 0, 1)),
        (b"\x020100ANVS\x03\x0a", Frame("A", "NVS", 1, 0)),
        (b"\x020001WSAD00000\x03\x31", Frame("W", "SAD00000", 0, 1)),
        (b"\x020001RTT\x03\x52", Frame("R", "TT", 0, 1)),
        (b"\x020100ATA100011\x03\x55", Frame("A", "TA100011", 1, 0)),
        (b"\x020001WPS100010\x03\x54", Frame("W", "PS100010", 0, 1)),
        (b"\x020001RSER\x03\x16", Frame("R", "SER", 0, 1)),
        (b"\x020100ADL1003E8\x03\x36", Frame("A", "DL1003E8", 1, 0)),
    ],
)
def test_completed_frames(wire: bytes, meaning: Frame | None) -> None:
    found = [one for one in FrameReader().feed(wire) if isinstance(one, Frame)]
    assert found == ([] if meaning is None else [meaning])


# -- OMEGA -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "golden",
    [*manual_003.FRAMES, *manual_003.BY_HAND],
    ids=lambda golden: f"{golden.where} {golden.text}",
)
def test_the_sum_is_that_of_the_text(golden: manual_003.OmegaGolden) -> None:
    """ "The result of adding the decimal values of the characters in the main text" (manual 003,
    11.2).
    """
    total = 0
    for byte in golden.text.encode("ascii"):
        total += byte
    assert golden.wire == b"\x02" + golden.text.encode("ascii") + b"\x03" + b"%02X" % (total % 256)


@pytest.mark.parametrize(("where", "page", "printed", "total", "digits"), manual_003.SUMS)
def test_a_sum_keeps_its_two_last_digits(
    where: str, page: int, printed: str, total: int, digits: bytes
) -> None:
    assert str(total) in printed
    assert b"%02X" % (total % 256) == digits
