"""A text file that is not UTF-8: which encoding it is in, where, and what to do."""

from __future__ import annotations

import pytest

from jbclog.core.encodings import not_utf8

SERIALS = "SN-1\r\nSN-2\r\n"
UTF_16 = ('is UTF-16 ("Unicode" in Windows and Excel); save it as UTF-8', None)
UTF_32 = ("is UTF-32; save it as UTF-8", None)


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (SERIALS.encode(), None),
        (SERIALS.encode("utf-8-sig"), None),
        ("Jörg µ °C “quoted”".encode(), None),
        (b"", None),
        (b"SN\x00", None),  # one zero byte in a text is no UTF-16
        (SERIALS.encode("utf-16"), UTF_16),
        (b"\xfe\xff" + SERIALS.encode("utf-16-be"), UTF_16),
        (SERIALS.encode("utf-16-le"), UTF_16),
        (SERIALS.encode("utf-16-be"), UTF_16),
        ("# Löttemperatur 350 °C\n".encode("utf-16-le"), UTF_16),
        (SERIALS.encode("utf-32"), UTF_32),
        (SERIALS.encode("utf-32-be"), UTF_32),
        (
            "SN-1\r\nSN-2 Löt\r\n".encode("latin-1"),
            ('byte 0xF6 at column 7 is not UTF-8 ("ö" in Latin-1); save the file as UTF-8', 2),
        ),
        (
            "a\rb\rµ 5 °C".encode() + b"\xb0",  # line ends of an old Macintosh
            ('byte 0xB0 at column 7 is not UTF-8 ("°" in Latin-1); save the file as UTF-8', 3),
        ),
        (
            "“SN-1”".encode("cp1252"),
            ('byte 0x93 at column 1 is not UTF-8 ("“" in Latin-1); save the file as UTF-8', 1),
        ),
        (b"SN-1\n\x81", ("byte 0x81 at column 1 is not UTF-8; save the file as UTF-8", 2)),
        (
            "SN-°".encode()[:-1],  # cut off within a character
            ('byte 0xC2 at column 4 is not UTF-8 ("Â" in Latin-1); save the file as UTF-8', 1),
        ),
    ],
)
def test_the_encoding_is_named(data: bytes, told: tuple[str, int | None] | None) -> None:
    assert not_utf8(data) == told
