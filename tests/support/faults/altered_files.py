"""Files with bytes altered in every way that a disk, a copy or a hand has: for campaigns that count
what came of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

SECTOR = 512


class Altered(NamedTuple):
    """What was done, and what the file holds then."""

    how: str
    data: bytes


def bits_flipped(data: bytes, stride: int = 1) -> Iterator[Altered]:
    for bit in range(0, 8 * len(data), stride):
        altered = bytearray(data)
        altered[bit // 8] ^= 1 << bit % 8
        yield Altered(f"bit {bit % 8} of byte {bit // 8} flipped", bytes(altered))


def bytes_replaced(data: bytes, stride: int = 1) -> Iterator[Altered]:
    for place in range(0, len(data), stride):
        for value in {0x00, 0xFF, data[place] ^ 0x20, (data[place] + 1) & 0xFF} - {data[place]}:
            yield Altered(
                f"byte {place} made {value:02x}", data[:place] + bytes([value]) + data[place + 1 :]
            )


def cut_off(data: bytes, stride: int = 1) -> Iterator[Altered]:
    for length in range(0, len(data), stride):
        yield Altered(f"cut off after {length} bytes", data[:length])


def percents_cut_off(data: bytes, stride: int = 1) -> Iterator[Altered]:
    for percent in range(0, 100, stride):
        length = len(data) * percent // 100
        yield Altered(f"cut off after {percent} %", data[:length])


def sectors_zeroed(data: bytes, stride: int = SECTOR) -> Iterator[Altered]:
    for place in range(0, len(data), stride):
        zeros = bytes(len(data[place : place + SECTOR]))
        if data[place : place + SECTOR] != zeros:
            yield Altered(
                f"zeros from byte {place} on", data[:place] + zeros + data[place + SECTOR :]
            )


def pieces_moved(data: bytes, stride: int = SECTOR) -> Iterator[Altered]:
    """A piece lost from the middle, and one that is there twice."""
    for place in range(0, len(data) - 1, stride):
        length = min(100, len(data) - place)
        yield Altered(
            f"{length} bytes lost from byte {place} on", data[:place] + data[place + length :]
        )
        yield Altered(
            f"{length} bytes twice from byte {place} on", data[: place + length] + data[place:]
        )


@dataclass
class Count:
    """What came of a campaign: alterations tried, those that cost something, those that showed
    something wrong.
    """

    fault: str
    tried: int = 0
    lost: int = 0
    wrong: int = 0

    def add(self, *, lost: bool = False, wrong: bool = False) -> None:
        self.tried, self.lost, self.wrong = self.tried + 1, self.lost + lost, self.wrong + wrong

    def told(self) -> str:
        return f"{self.fault}: tried {self.tried}, lost {self.lost}, wrong {self.wrong}"


def zeros(data: bytearray, place: int) -> None:
    """A block of the disk from `place` on that was never written."""
    data[place : place + 512] = bytes(len(data[place : place + 512]))


def cut(data: bytearray, place: int) -> None:
    del data[place:]
