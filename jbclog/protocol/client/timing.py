"""Measure a station's response time, and wait after a write that interrupts the link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

from jbclog.core.errors import AnswerTimeout, NotSupported, Refusal, StationError, StationSilent
from jbclog.core.io_requests import wait
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.confirmed_reads import SETTLE_S
from jbclog.protocol.client.interface import Client, PreparedRead
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.robot import COMMON

# Response time is the time from request to complete answer, minus the transmission time of both at
# the stated line format. Behind a network server, or if the stated rate is too low, an answer can
# arrive sooner than that: then the response time is 0, and the link is faster than stated.

READS = 12  # their median tolerates a late answer
LEAST_ANSWERED = READS // 2  # with fewer answers the link is too bad for a run
LEAST_READS = 3  # if other signals were read anyway
TOLERANCE = 0.03  # tolerance of the baud rate, both ends together


class AnswerTime(NamedTuple):
    """Time from request to complete answer, and its transmission time at the stated line format, in
    µs.
    """

    whole: float
    wire: float

    @property
    def response(self) -> float:
        """Response time in µs, never below 0."""
        return max(self.whole - self.wire, 0.0)


@dataclass(frozen=True, slots=True)
class ResponseTime:
    """Result of harmless reads and of what was read anyway, in µs; at least one was answered.

    `took` are the response times, sorted, none below 0. `whole` is the median time from request to
    complete answer, `wire` the median transmission time of both at the stated line format. `least`
    is the shortest response time of the harmless reads alone.
    """

    took: tuple[float, ...]
    whole: float
    wire: float
    ignored: tuple[str, ...] = ()  # commands that the station does not support; not counted
    least: float = 0.0

    @property
    def median(self) -> float:
        """The median of `took`, or `least` if that is longer: what was read anyway is mostly
        settings, which a station may send sooner than it measures.
        """
        return max(median(self.took), self.least)

    @property
    def longest(self) -> float:
        return self.took[-1]

    @property
    def is_faster(self) -> bool:
        """True if answers arrive sooner than the stated line format allows."""
        return self.whole < self.wire * (1 - TOLERANCE)

    def faster_text(self, line: LineFormat) -> str | None:
        """Describe by how much the link is faster than `line`, the stated format; None if it is
        not.
        """
        if not self.is_faster:
            return None
        return (
            f"the link is faster than its stated {line}: a question and its answer take"
            f" {self.whole / 1000:.2f} ms, {self.wire / 1000:.2f} ms at that rate"
        )


async def response_time(
    client: Client,
    family: Family,
    port: int,
    seen: Sequence[AnswerTime] = (),
    *,
    apart_s: float = 0.0,
) -> tuple[ResponseTime | None, int]:
    """Measure the response time with `READS` harmless reads, each `apart_s` after the previous
    answer. Returns the response time, None without any answer, and the number of answers.

    `seen` are answers to other signals of `port` that were read anyway and also count, unless a
    read is not answered. With `seen`, all reads are of a fast signal, and fewer are enough: only
    `LEAST_READS` beside `LEAST_ANSWERED` or more. Skips and names commands that the station does
    not support. Stops once `LEAST_ANSWERED` is out of reach.
    """
    names = list(family.harmless)
    ignored = list[str]()
    if seen:
        names.sort(key=family.is_fast, reverse=True)
    heard = list[AnswerTime]()
    asked = 0
    lost = 0
    enough = LEAST_READS if len(seen) >= LEAST_ANSWERED else READS - len(seen)
    while names and asked < (READS if lost else enough) and lost <= READS - LEAST_ANSWERED:
        name = names[0 if seen else asked % len(names)]
        command = family.commands[name]
        question = client.question(command, None if command.scope is Scope.STATION else port)
        if apart_s:
            client.unasked(await wait(client.now + apart_s))
        try:
            await client.ask(question)
        except NotSupported:
            names.remove(name)
            ignored.append(name)
            continue
        except StationError:
            lost += 1
            client.unasked(await wait(client.now + SETTLE_S))
        else:
            heard.append(answer_time(client, question))
        asked += 1
    counted = len(seen) if heard and not lost else 0
    return _response_time_of(seen, heard, ignored), len(heard) + counted


def answer_time(client: Client, question: PreparedRead) -> AnswerTime:
    """Return the timing of the answer to `question` that `client` has just received."""
    return AnswerTime((client.heard - client.sent) * 1e6, question.wire_s * 1e6)


def _response_time_of(
    seen: Sequence[AnswerTime], heard: Sequence[AnswerTime], ignored: list[str]
) -> ResponseTime | None:
    """Combine what was read anyway with the harmless reads; None without any answer."""
    both = [*seen, *heard]
    if not both:
        return None
    return ResponseTime(
        tuple(sorted(answer.response for answer in both)),
        median(answer.whole for answer in both),
        median(answer.wire for answer in both),
        tuple(ignored),
        min((answer.response for answer in heard), default=0.0),
    )


# W-RST and W-SAD interrupt the link. Both are sent once. No manual prints their answer
# (docs/reference/contradictions.md, B-9, B-40), so an acknowledgement and silence are equivalent;
# only a later answer to R-SMN counts.

MODEL = next(command for command in COMMON if command.name == "model")
NOT_ACKNOWLEDGED = 40  # B-number
BACK_S = 30.0  # a station that takes longer counts as gone
SEEK_S = 0.5  # between two reads from a restarting station
STEADY = 4  # answers in a row: it may answer for a moment before it restarts


async def restart(client: Client, command: Command) -> float:
    """Write W-RST once and wait until the station is back; return the seconds.

    Raises `Refusal` if the station refuses, and `StationSilent` if it does not come back.
    """
    began = client.now
    try:
        await client.write(command, 0)
    except Refusal:
        raise
    except StationError:  # equivalent to an acknowledgement
        client.anomalies.meet(NOT_ACKNOWLEDGED, "restart", f"W{command.code()} without an answer")
    await settle_restart(client)
    return client.now - began


async def settle_restart(client: Client) -> None:
    """Wait until a restarting station answers steadily. Raises `StationSilent`."""
    end = client.now + BACK_S
    steady = 0
    while steady < STEADY:
        if client.now > end:
            raise StationSilent(f"no answer within {BACK_S:g} s of the restart")
        client.unasked(await wait(client.now + SEEK_S))
        try:
            await client.read(MODEL)
            steady += 1
        except StationError:
            steady = 0


async def change_address(station: Station, command: Command, address: int | None) -> None:
    """Write W-SAD once and use the new address from then on; None means no addresses.

    Raises `Refusal` if the station refuses, and what `settle_address` raises.
    """
    try:
        await station.write(command, address or 0)
    except Refusal:
        raise
    except StationError:
        pass  # `settle_address` finds out
    await settle_address(station, address)


async def settle_address(station: Station, address: int | None) -> None:
    """Confirm by R-SMN that the station answers at `address`.

    Raises `AnswerTimeout` if it does not. If it answers at its old address, `station` uses that
    again.
    """
    old = station.address
    for tried in (address, old, address, old):  # it may still be storing the new address
        station.move_to(tried)
        try:
            await station.read(MODEL)
        except StationError:
            continue
        if tried == address:
            return
        raise AnswerTimeout(f"the station still answers at its old address ({_shown(old)})")
    raise AnswerTimeout(
        f"the station answers neither at its new address ({_shown(address)}) nor at its old one"
        f" ({_shown(old)})"
    )


def _shown(address: int | None) -> str:
    return "none: frames without addresses" if address is None else f"{address:02d}"
