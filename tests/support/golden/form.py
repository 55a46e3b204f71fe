"""The shapes in which the examples stand, and the few lines that work out a check byte."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, Protocol

ROBOT, STATION = b"00", b"01"  # "Factory Settings" (manuals 002 and 004)


class Special(Enum):
    """A value that is no number."""

    OFF = "99999"


OFF = Special.OFF
Meaning = int | float | str | tuple[int, ...] | Special


class Golden(NamedTuple):
    """A frame; behind its bytes what it means: command, port, tool, value."""

    where: str
    page: int
    printed: str
    bare: bytes
    command: str
    port: int | None = None
    tool: int | None = None
    value: Meaning | None = None
    written_otherwise: bool = False  # read like this, but another form of the value is written

    @property
    def manual(self) -> str:
        return self.where[:3]

    @property
    def text(self) -> str:
        """Header, command and data."""
        return self.bare[1:-2].decode("ascii")

    @property
    def addressed(self) -> bytes:
        """The same between the factory addresses; the answer's source is the station
        (docs/reference/contradictions.md, B-6).
        """
        pair = ROBOT + STATION if self.text[0] in "RW" else STATION + ROBOT
        return with_check_byte(self.bare[:1] + pair + self.bare[1:-1])


class Field(NamedTuple):
    """A control field: header and code."""

    where: str
    page: int
    printed: str
    text: bytes


class Listed(NamedTuple):
    """The data field of a command for one row of a list."""

    where: str
    page: int
    printed: str
    data: bytes
    command: str
    value: Meaning
    written_otherwise: bool = False


def with_check_byte(covered: bytes) -> bytes:
    """ "The logic function XOR for the whole frame, excluding the BCC" (manual 002, "Frame
    Fields"); not the product's.
    """
    check = 0
    for byte in covered:
        check ^= byte
    return covered + bytes([check])


def framed(text: str, addresses: str = "") -> bytes:
    """Any text as a frame, by the manuals' rule; `addresses` are the four digits of source and
    target.
    """
    return with_check_byte(b"\x02" + (addresses + text).encode("ascii") + b"\x03")


class Told(Protocol):
    """A frame as a reader tells it; addresses are None on a line without."""

    header: str
    text: str
    source: int | None
    target: int | None


def wire_of(frame: Told) -> bytes:
    """The bytes that such a frame must have had, by the manuals' rule."""
    addresses = "" if frame.source is None else f"{frame.source:02d}{frame.target:02d}"
    return framed(frame.header + frame.text, addresses)


def summed(text: str) -> bytes:
    """Any text as a frame of the OMEGA (manual 003, 11.2): behind ETX the sum of its characters,
    the last two digits of it.
    """
    content = text.encode("ascii")
    return b"\x02" + content + b"\x03" + b"%02X" % (sum(content) % 256)
