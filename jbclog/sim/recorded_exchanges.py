"""Reads a serial capture: requests with their answers, and the answers that its session
accepted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from math import floor, inf
from typing import NamedTuple

from jbclog.core.capture_rows import CaptureRow, ResultRow
from jbclog.protocol import frame, omega
from jbclog.protocol.commands.command import Effect
from jbclog.protocol.commands.robot import READINGS
from jbclog.protocol.frame import Frame, FrameReader
from jbclog.protocol.omega import OmegaReader

# A write changes later answers. So a capture is divided at its writes into *stretches*: all
# requests in one follow the same writes. A write repeated because its answer was lost begins no new
# stretch. A stretch also begins at the first tick of sampling, where the clocks of capture and
# client are synchronized.

EARLY_S = 1e-3  # tolerance before a tick
ON_TIME = 0.05  # the part of the period in which an undisturbed tick begins


class RecordedGrid(NamedTuple):
    """Sampling grid of a recorded station: when its first tick was due, on the recorder's clock,
    and its period.
    """

    first_s: float
    period_s: float

    def is_on_time(self, at_s: float) -> bool:
        """Return True if a tick is due at this time, or slightly earlier."""
        return (
            at_s - self.first_s >= -EARLY_S
            and (at_s - self.first_s + EARLY_S) % self.period_s < ON_TIME * self.period_s
        )

    def number(self, at_s: float) -> int:
        """Return the number of ticks before the one at this time."""
        return floor((at_s - self.first_s + EARLY_S) / self.period_s)


@dataclass(slots=True)
class Exchange:
    """One recorded request, and what followed until the next; seconds count from the request.

    `at_s` is its time on the recorder's clock; `stretch` the number of its stretch. `was_late`:
    nothing had come when the session stopped waiting, and what came then was not accepted.
    """

    question: bytes
    at_s: float
    stretch: int = 0
    replies: list[tuple[float, bytes]] = field(default_factory=list)
    lost_s: float | None = None  # when the link was lost
    back_s: float = inf
    was_late: bool = False

    def lost(self, after_s: float) -> None:
        """Record that the link was lost, or is still down."""
        self.lost_s, self.back_s = after_s if self.lost_s is None else self.lost_s, inf


def is_write(question: bytes) -> bool:
    """Return True if the request may change anything in the station."""
    return not (frame.only_reads(question) or omega.only_reads(question))


class _Stretches:
    """Numbers stretches. Sampling began at `sampling_s`, if known."""

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


def exchanges(rows: Iterable[CaptureRow], sampling_s: float | None = None) -> Iterator[Exchange]:
    """Yield the exchanges of a capture, in order. Drops bytes before the first request."""
    one, down_since, stretches = None, 0.0, _Stretches(sampling_s)
    for row in rows:
        if isinstance(row, ResultRow):
            if one is not None and not one.replies:
                one.was_late |= (row.what, row.request, row.size) == ("told", "ask", 0)
        elif row.what == "sent":
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
            # between the last failed attempt and this one
            one.back_s = (down_since + row.at_s) / 2 - one.at_s
    if one is not None:
        yield one


@dataclass(slots=True)
class Contents:
    """Summary of a capture: its requests, the first of each stretch, the time of the last, and
    those after which the link was lost.
    """

    known: Counter[bytes] = field(default_factory=Counter)
    firsts: list[bytes] = field(default_factory=list)
    last_s: float = -inf
    sampled: bytes = b""  # the first request of the first tick; empty if unknown
    losses: list[Exchange] = field(default_factory=list)

    @classmethod
    def of(cls, recording: Iterable[Exchange]) -> Contents:
        found = cls()
        for one in recording:
            found.known[one.question] += 1
            if one.stretch >= len(found.firsts):
                found.firsts.append(one.question)
                found.sampled = found.sampled or (
                    one.question if one.stretch and not is_write(one.question) else b""
                )
                if one.stretch >= len(found.firsts):  # it begins with a write
                    found.firsts.append(one.question)
            found.last_s = one.at_s
            if one.lost_s is not None:
                found.losses.append(one)
        return found


# A doubtful answer is read again at once (`session/run/readings.py`), and so is a garbled or a late
# one, with a probe in between. These requests form one group: their answers confirm or contradict
# each other, and a single one may be wrong. A group is replayed in order or skipped as a whole.

# maximum time from an answer to the next read of its group: the recorder's host may have been busy
LOOK_S = 0.25
RETRY_S = 1.0  # the same after a garbled answer: a time-out, and a probe's answer
MOST = 9  # three looks, each with three tries
# up to this number of answers the last one was accepted: without doubt, or there was a third
BELIEVED_AT_ONCE = 2

CLEARED = tuple(command.letters for command in READINGS if command.effect is Effect.CLEARS)


def is_understood(one: Exchange) -> bool:
    """Return True if a correct frame arrived in time."""
    if one.was_late:
        return False
    heard = received(one)
    if frame.only_reads(one.question):
        return any(isinstance(found, Frame) for found in FrameReader().feed(heard))
    if omega.only_reads(one.question):
        return any(isinstance(found, str) for found in OmegaReader().feed(heard))
    return bool(heard)


def has_flags(one: Exchange) -> bool:
    """Return True if the answer has flags that the station clears when they are read."""
    heard = FrameReader().feed(received(one))
    found = next(
        (answer for answer in heard if isinstance(answer, Frame) and answer.header == "A"), None
    )
    return found is not None and found.text.startswith(CLEARED) and found.text[3:].strip("0") != ""


def received(one: Exchange) -> bytes:
    """Return all bytes of the answer."""
    return b"".join(data for _, data in one.replies)


@dataclass(slots=True)
class RetryGroup:
    """The requests of one group, in order; never empty. `number` counts requests up to its last."""

    all: list[Exchange]
    number: int
    is_understood: bool

    @property
    def at_s(self) -> float:
        return self.all[0].at_s

    @property
    def question(self) -> bytes:
        return self.all[0].question

    @property
    def stretch(self) -> int:
        return self.all[0].stretch

    @property
    def has_flags(self) -> bool:
        return any(has_flags(one) for one in self.all)

    def includes(self, one: Exchange, number: int) -> bool:
        last, behind = self.all[-1], number - self.number
        if (
            (one.question, one.stretch) != (self.question, self.stretch)
            or last.lost_s is not None
            or len(self.all) == MOST
        ):
            return False
        gap_s = one.at_s - last.at_s - (last.replies[-1][0] if last.replies else 0.0)
        return gap_s < LOOK_S if behind == 1 else gap_s < RETRY_S and not self.is_over(number - 1)

    def is_over(self, number: int) -> bool:
        """Return True if a request after that number cannot belong to this group."""
        return number - self.number >= (1 if self.is_understood else 2)

    def add(self, one: Exchange, number: int) -> None:
        self.all.append(one)
        self.number, self.is_understood = number, is_understood(one)

    def believed(self, before: Exchange | None) -> Exchange | None:
        """Return the accepted answer, or `before` if none of these was."""
        last = self.all[-1]
        if before is None:
            return last if last.replies else None
        if not is_understood(last):
            return before
        others = [received(one) for one in self.all[:-1] if is_understood(one)]
        is_proven = len(others) < BELIEVED_AT_ONCE or received(last) in (*others, received(before))
        return last if is_proven else before


def retry_groups(
    recording: Iterable[Exchange], ticks: RecordedGrid | None = None, sampled: bytes = b""
) -> Iterator[RetryGroup]:
    """Yield the groups of a capture, in order of their starts. Ticks begin with the request
    `sampled`.
    """
    waiting: list[RetryGroup] = []
    for number, one in enumerate(recording):
        group = next((group for group in waiting if group.includes(one, number)), None)
        if group is None or (one.question == sampled and _is_next_tick(ticks, group, one)):
            waiting.append(RetryGroup([one], number, is_understood(one)))
        else:
            group.add(one, number)
        while waiting and waiting[0].is_over(number):
            yield waiting.pop(0)
    yield from waiting


def _is_next_tick(ticks: RecordedGrid | None, group: RetryGroup, one: Exchange) -> bool:
    """Whether a tick begins here, which matters if a station has only one signal."""
    return (
        ticks is not None
        and ticks.is_on_time(one.at_s)
        and ticks.number(one.at_s) != ticks.number(group.at_s)
    )
