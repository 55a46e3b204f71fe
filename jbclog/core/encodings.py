"""Say in which encoding people saved a text file that should be UTF-8."""

from __future__ import annotations

import codecs
from typing import Final, NamedTuple

# the marks of UTF-32 first: that of UTF-16 is the beginning of one of them
_MARKS: Final = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)
_LOOKED_AT: Final = 4096  # bytes
_MOST: Final = 0.6  # share of zero bytes; other text has none
# Windows' superset of Latin-1, in which Western editors save what is not Unicode
_WESTERN: Final = "cp1252"


class NotUtf8(NamedTuple):
    """Why bytes are no UTF-8, and the line, from 1; None if the whole file is in another
    encoding.
    """

    text: str
    line: int | None


def not_utf8(data: bytes) -> NotUtf8 | None:
    """Return why the bytes of a text file are no UTF-8, and what to do; None if they are."""
    wide = _wide_encoding(data)
    if wide is not None:
        hint = ' ("Unicode" in Windows and Excel)' if wide == "UTF-16" else ""
        return NotUtf8(f"is {wide}{hint}; save it as UTF-8", None)
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        text = f"{_byte_text(data, error.start)}; save the file as UTF-8"
        return NotUtf8(text, _line_of(data, error.start))
    return None


def _wide_encoding(data: bytes) -> str | None:
    """Return the name of an encoding with two or four bytes for each character."""
    for mark, name in _MARKS:
        if data.startswith(mark):
            return name
    start = data[:_LOOKED_AT]
    if _nul_share(start[1::4]) > _MOST and _nul_share(start[2::4]) > _MOST:
        return "UTF-32"
    # Western text has a zero in every second byte
    if _nul_share(start[::2]) > _MOST or _nul_share(start[1::2]) > _MOST:
        return "UTF-16"
    return None


def _nul_share(data: bytes) -> float:
    return data.count(0) / len(data) if data else 0.0


def _line_of(data: bytes, place: int) -> int:
    before = data[:place].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return before.count(b"\n") + 1


def _byte_text(data: bytes, place: int) -> str:
    """Return what the byte at `place`, which is no UTF-8, can be, and its column."""
    start = max(data.rfind(b"\n", 0, place), data.rfind(b"\r", 0, place)) + 1
    column = len(data[start:place].decode("utf-8", "replace")) + 1
    byte = data[place : place + 1]
    try:
        character = byte.decode(_WESTERN)
    except UnicodeDecodeError:
        return f"byte 0x{byte.hex().upper()} at column {column} is not UTF-8"
    return f'byte 0x{byte.hex().upper()} at column {column} is not UTF-8 ("{character}" in Latin-1)'
