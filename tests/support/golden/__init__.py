"""Frames as the manuals print them: the referee between the client, the simulator and the tables.

Each row is typed from a manual, byte by byte: the printed text between STX and ETX, without the hyphens and blanks of
typography ("A-ST1- 00350"), and the check byte behind, worked out by hand where only the text is printed. Nothing here
comes from the encoder. The frames are those without addresses; `addressed` puts the addresses in.
"""

from __future__ import annotations

from typing import NamedTuple

from jbclog.quantities import Value

ROBOT, STATION = b"00", b"01"  # "Factory Settings" (seeds 002 and 004)


class Golden(NamedTuple):
    """`where` is seed and section, `printed` a quotation; the rest is what it means in our tables."""

    where: str
    printed: str
    bare: bytes
    command: str
    port: int | None = None
    tool: int | None = None
    value: Value | None = None
    written_otherwise: bool = False  # read like this, but we write another form of the value

    @property
    def seed(self) -> str:
        return self.where[:3]

    @property
    def text(self) -> str:
        """Header, command and data."""
        return self.bare[1:-2].decode("ascii")

    @property
    def addressed(self) -> bytes:
        """The same between the factory addresses; the answer's source is the station (digest B-6)."""
        pair = ROBOT + STATION if self.text[0] in "RW" else STATION + ROBOT
        return with_check_byte(self.bare[:1] + pair + self.bare[1:-1])


def with_check_byte(covered: bytes) -> bytes:
    """ "The logic function XOR for the whole frame, excluding the BCC" (seed 002, "Frame Fields"); not the product's."""
    check = 0
    for byte in covered:
        check ^= byte
    return covered + bytes([check])
