"""How long bytes take: the arithmetic of an asynchronous serial line, without any port."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

BAUDRATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000)
"""The rates that manual 000 prints (2.1); the newer units have 19200 only."""

_FORMAT = re.compile(r"8([NEO])([12])")

AROUND = 4  # characters of a frame beside code and data: STX, header, ETX and check byte; of OMEGA's STX, ETX and two of the sum
ADDRESSES = 4  # more of them where the line has addresses (manual 002, "Data Link Layer")
CODE, DIGITS = 3, 5  # of the usual question and its answer


SCHEMES: Final = ("socket", "rfc2217", "loop", "hwgrep")
"""The kinds of url that may be opened. pyserial knows more; spy:// writes any file that its url names, alt:// loads code."""


def scheme_of(url: str) -> str:
    """The kind of port that a url names, in small letters; empty for a device."""
    scheme, is_url, _ = url.partition("://")
    return scheme.lower() if is_url else ""


@dataclass(frozen=True, slots=True)
class LineFormat:
    """Baud rate, parity and stop bits, as in ``19200`` and ``8N1``."""

    baudrate: int = 19200
    format: str = "8N1"

    def __post_init__(self) -> None:
        if not _FORMAT.fullmatch(self.format):
            raise ValueError(f"{self.format!r} is not a line format such as 8N1, 8E1 or 8O2")
        if self.baudrate <= 0:
            raise ValueError(f"{self.baudrate} is not a baud rate")

    def __str__(self) -> str:
        return f"{self.baudrate} {self.format}"

    @property
    def parity(self) -> str:
        return self.format[1]

    @property
    def stop_bits(self) -> int:
        return int(self.format[2])

    @property
    def character_s(self) -> float:
        """Seconds that one character takes: start bit, eight data bits, parity, stop bits."""
        return (9 + (self.parity != "N") + self.stop_bits) / self.baudrate

    def seconds(self, characters: int) -> float:
        """Seconds that `characters` take."""
        return characters * self.character_s

    def read_s(self, addressed: bool = True) -> float:
        """Seconds of one read and its five-digit answer, without turnaround: 14.06 ms at 19200 8N1."""
        return self.seconds(2 * (AROUND + CODE + (ADDRESSES if addressed else 0)) + DIGITS)
