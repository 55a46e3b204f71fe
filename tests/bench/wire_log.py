"""The log that virtual stations keep of their links, as evidence of the pacing."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from common import LINE, percentile


class Exchange(NamedTuple):
    """A question and its answer at the station: monotonic seconds, and the characters of both."""

    asked: float
    answered: float
    characters: int


@dataclass(frozen=True, slots=True)
class Use:
    """The traffic on one link between two moments."""

    exchanges: int
    seconds: float
    bytes_s: float  # time of the bytes of all exchanges
    shortest: Exchange
    idle_us: tuple[float, float]  # of the link per exchange: 10th percentile, median

    @property
    def percent(self) -> float:
        """The share of time with bytes on the link."""
        return self.bytes_s / self.seconds * 100

    @property
    def a_second(self) -> float:
        return self.exchanges / self.seconds


def use_of(log: Path, began: float, seconds: float) -> Use:
    """Return the exchanges of the one station in `log` within `seconds` of `began`."""
    found = [one for one in exchanges(log) if began <= one.asked < began + seconds]
    taken = sum(LINE.seconds(one.characters) for one in found)
    idle_us = [
        (after.asked - one.asked - LINE.seconds(one.characters)) * 1e6
        for one, after in pairwise(found)
    ]
    return Use(
        len(found),
        seconds,
        taken,
        min(found, key=slack_s),
        (percentile(idle_us, 10), percentile(idle_us, 50)),
    )


def slack_s(exchange: Exchange) -> float:
    """Return the time beyond that of the bytes; a negative one means that the pacing is wrong."""
    return exchange.answered - exchange.asked - LINE.seconds(exchange.characters)


def exchanges(log: Path) -> Iterator[Exchange]:
    asked, characters = 0.0, 0
    for line in log.read_text().splitlines():
        note = json.loads(line)
        size = len(note["hex"]) // 2
        if note["kind"] == "question":
            asked, characters = note["t"], size
        elif note["kind"] == "answer":
            yield Exchange(asked, note["t"], characters + size)
