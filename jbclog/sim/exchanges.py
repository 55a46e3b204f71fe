"""What passed over a recorded wire as questions, each with what came of it, and the stretches that they fall into.

A write changes what the answers after it say. So a tape is divided at its writes: what lies in one *stretch* was answered
with the same writes behind it. The same write again, because its answer was lost, begins no new stretch. Nor is the
first tick of sampling a write, but a stretch begins there, too: it is where the tape's clock and the client's are set.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import floor, inf
from typing import NamedTuple

from jbclog.core.wire_capture import Passed, Row
from jbclog.protocol import frame, omega

EARLY_S = 1e-3  # that the first question of a tick may seem to lie before it
ON_TIME = 0.05  # of a period after its due time, in which a tick's first question is asked where nothing is in its way


class Ticks(NamedTuple):
    """The grid on which a recorded station was sampled: when its first tick was due, on the recorder's clock, and its period."""

    first_s: float
    period_s: float

    def is_on_time(self, at_s: float) -> bool:
        """Whether a moment is that at which a tick was due, or hardly later."""
        return at_s - self.first_s >= -EARLY_S and (at_s - self.first_s + EARLY_S) % self.period_s < ON_TIME * self.period_s

    def number(self, at_s: float) -> int:
        """How many ticks lie before the one that a moment belongs to."""
        return floor((at_s - self.first_s + EARLY_S) / self.period_s)


@dataclass(slots=True)
class Exchange:
    """One question as it was recorded, and what came of it until the next; seconds count from the question.

    `at_s` is when it was asked, on the recorder's clock; `stretch` the number of the stretch that it lies in.
    """

    question: bytes
    at_s: float
    stretch: int = 0
    replies: list[tuple[float, bytes]] = field(default_factory=list)
    lost_s: float | None = None  # when the link was lost after it
    back_s: float = inf

    def lost(self, after_s: float) -> None:
        """The link was lost, or was still away."""
        self.lost_s, self.back_s = after_s if self.lost_s is None else self.lost_s, inf


def is_write(question: bytes) -> bool:
    """Whether it may change anything at the station."""
    return not (frame.only_reads(question) or omega.only_reads(question))


class _Stretches:
    """Numbers exchanges by what came before them. Sampling began at `sampling_s`, where that is known."""

    def __init__(self, sampling_s: float | None) -> None:
        self._sampling_s = sampling_s
        self._written = b""
        self._number = 0

    def of(self, question: bytes, at_s: float) -> int:
        is_first = self._sampling_s is not None and at_s >= self._sampling_s - EARLY_S
        if is_first:
            self._sampling_s, self._written = None, b""
        is_new = is_write(question) and question != self._written
        self._written = question if is_new else self._written
        self._number += is_first or is_new
        return self._number


def exchanges(rows: Iterable[Row], sampling_s: float | None = None) -> Iterator[Exchange]:
    """The exchanges on a tape, in order. What came before the first question belongs to none."""
    one, down_since, stretches = None, 0.0, _Stretches(sampling_s)
    for row in rows:
        if not isinstance(row, Passed):
            continue
        if row.what == "sent":
            if one is not None:
                yield one
            one = Exchange(row.data, row.at_s, stretches.of(row.data, row.at_s))
        elif one is None:
            continue
        elif row.what == "heard":
            one.replies.append((row.at_s - one.at_s, row.data))
        elif row.what in ("lost", "failed"):
            one.lost(row.at_s - one.at_s)
            down_since = row.at_s
        elif row.what == "opened" and one.lost_s is not None and one.back_s == inf:
            one.back_s = (down_since + row.at_s) / 2 - one.at_s  # it came back between the last try that failed and this one
    if one is not None:
        yield one


@dataclass(slots=True)
class Contents:
    """What a tape holds as a whole: its questions, the first of each stretch, and when the last was asked."""

    known: Counter[bytes] = field(default_factory=Counter)
    firsts: list[bytes] = field(default_factory=list)
    last_s: float = -inf
    sampled: bytes = b""  # the first question of the first tick; nothing where that is not known

    @classmethod
    def of(cls, tape: Iterable[Exchange]) -> Contents:
        found = cls()
        for one in tape:
            found.known[one.question] += 1
            if one.stretch >= len(found.firsts):
                found.firsts.append(one.question)
                found.sampled = found.sampled or (one.question if one.stretch and not is_write(one.question) else b"")
                if one.stretch >= len(found.firsts):  # the tape begins with a write
                    found.firsts.append(one.question)
            found.last_s = one.at_s
        return found
