"""How long bytes take: the arithmetic of an asynchronous serial line, without any port."""

from __future__ import annotations

import re
from dataclasses import dataclass

BAUDRATES = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000)
"""The rates that seed 000 prints (2.1); the newer units have 19200 only."""

_FORMAT = re.compile(r"8([NEO])([12])")

READ_BYTES, ANSWER_BYTES = 11, 16  # an addressed read and its five-digit answer (seed 002, "Data Link Layer")
UNADDRESSED_SAVES = 4


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
        saved = 0 if addressed else 2 * UNADDRESSED_SAVES
        return self.seconds(READ_BYTES + ANSWER_BYTES - saved)
