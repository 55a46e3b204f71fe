"""The data of the page's interactive view, read as its script reads it, but in Python."""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SpanWith = tuple[float, float, Any]


@dataclass
class ZoomData:
    """Seconds are since `head["start"]`."""

    head: dict[str, Any]
    seconds: Floats
    values: dict[str, Floats]
    why: list[str]
    low: dict[str, Floats] = field(default_factory=dict)
    high: dict[str, Floats] = field(default_factory=dict)
    lanes: dict[str, list[SpanWith]] = field(default_factory=dict)
    held: list[SpanWith] = field(default_factory=list)


class Numbers:
    """Zigzag varints, one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def next(self) -> int:
        value = shift = 0
        while True:
            byte = self._data[self._at]
            self._at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return -((value + 1) >> 1) if value & 1 else value >> 1

    def runs(self) -> list[int]:
        found: list[int] = []
        for _ in range(self.next()):
            value = self.next()
            found += [value] * self.next()
        return found

    def known(self) -> Floats:
        there, last, found = self.runs(), 0, list[float]()
        for one in there:
            last += self.next() if one else 0
            found.append(last if one else np.nan)
        return np.array(found, dtype=np.float64)

    @property
    def left(self) -> int:
        return len(self._data) - self._at


def zoom_data(text: str) -> ZoomData:
    raw = base64.b64decode(text, validate=True)
    length = int.from_bytes(raw[:4], "little")
    head, numbers = json.loads(raw[4 : 4 + length]), Numbers(raw[4 + length :])
    seconds = np.cumsum(numbers.runs()) * head["step"]
    found = ZoomData(head, seconds, {name: numbers.known() for name in head["columns"]}, [])
    found.why = [head["words"][code] for code in numbers.runs()]
    for name in head["columns"] if head["stretches"] else ():
        found.low[name] = numbers.known()
        found.high[name] = np.array(
            [low if np.isnan(low) else low + numbers.next() for low in found.low[name]]
        )
    for name, count in head["lanes"]:
        found.lanes[name] = [(a, b, head["words"][code]) for a, b, code in _spans(numbers, count)]
    found.held = _spans(numbers, head["settings"])
    assert numbers.left == 0
    return found


def _spans(numbers: Numbers, count: int) -> list[SpanWith]:
    start, found = 0, list[SpanWith]()
    for _ in range(count):
        start += numbers.next()
        found.append((start / 1000, (start + numbers.next()) / 1000, numbers.next()))
    return found
