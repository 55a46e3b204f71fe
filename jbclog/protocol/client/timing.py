"""How long a station takes: to answer, and to be back after a write."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from jbclog.core.errors import AnswerTimeout, NotSupported, Refusal, StationError, StationSilent
from jbclog.core.io_requests import Steps, Wait
from jbclog.core.wire import LineFormat
from jbclog.protocol.client.confirmed_reads import SETTLE_S
from jbclog.protocol.client.interface import Asking, Client
from jbclog.protocol.client.robot import Station
from jbclog.protocol.commands.command import Command, Scope
from jbclog.protocol.commands.family import Family
from jbclog.protocol.commands.robot import COMMON

# -- turnaround ---------------------------------------------------------------------------------------------------------------
# How long a station itself takes to answer, measured with harmless reads.
#
# What is measured is from the question to the whole answer. What its bytes need at the stated line format is taken off; the rest
# is the response time. Behind a network server, or where the stated rate is too low, an answer can be whole before its bytes could
# have come at that rate: then the response time is 0, and the link is faster than stated.

READS = 12  # enough for a median that one late answer does not move
LEAST_ANSWERED = READS // 2  # with fewer the link is too bad to run on
TOLERANCE = 0.03  # by which a real line may be faster than its rate: the two ends of one may differ by that much


@dataclass(frozen=True, slots=True)
class ResponseTime:
    """What `READS` harmless reads gave, all in µs; made of those that were answered, of which there is one at least.

    `took` are the response times in order of size, none below 0. `whole` is the median from a question to its whole answer,
    `wire` the median of what the bytes of both need at the stated line format.
    """

    took: tuple[float, ...]
    whole: float
    wire: float
    ignored: tuple[str, ...] = ()  # the commands that are not taken here, and were not counted

    @property
    def median(self) -> float:
        return median(self.took)

    @property
    def longest(self) -> float:
        return self.took[-1]

    @property
    def is_faster(self) -> bool:
        """Whether answers come sooner than their bytes could at the stated line format."""
        return self.whole < self.wire * (1 - TOLERANCE)

    def faster_text(self, line: LineFormat) -> str | None:
        """The sentence's end that says so; None where the link is not faster than `line`, the stated format."""
        if not self.is_faster:
            return None
        return (
            f"the link is faster than its stated {line}: a question and its answer take {self.whole / 1000:.2f} ms, "
            f"{self.wire / 1000:.2f} ms at that rate"
        )


def response_time(client: Client, family: Family, port: int) -> Steps[tuple[ResponseTime | None, int]]:
    """Ask `READS` times what is harmless; give the response time and the number of answers. None where nothing was answered.

    What the station does not take is no lost answer: it is left out and named. Once `LEAST_ANSWERED` can no more be reached,
    nothing more is asked.
    """
    names, ignored = list(family.harmless), []
    heard: list[tuple[float, float]] = []
    asked = 0
    while names and asked < READS and asked - len(heard) <= READS - LEAST_ANSWERED:
        name = names[asked % len(names)]
        question = _question(client, family, name, port)
        try:
            yield from client.ask(question)
        except NotSupported:
            names.remove(name)
            ignored.append(name)
            continue
        except StationError:
            asked += 1
            client.unasked((yield Wait(client.now + SETTLE_S)))
            continue
        asked += 1
        heard.append(((client.heard - client.sent) * 1e6, question.wire_s * 1e6))
    return _made_of(heard, ignored), len(heard)


def _made_of(heard: list[tuple[float, float]], ignored: list[str]) -> ResponseTime | None:
    if not heard:
        return None
    took = tuple(sorted(max(whole - wire, 0.0) for whole, wire in heard))
    return ResponseTime(took, median(whole for whole, _ in heard), median(wire for _, wire in heard), tuple(ignored))


def _question(client: Client, family: Family, name: str, port: int) -> Asking:
    command = family.commands[name]
    return client.question(command, None if command.scope is Scope.STATION else port)


# -- after write --------------------------------------------------------------------------------------------------------------
# After a write that takes the station away from its line: a restart, another address. Generators, no I/O.
#
# Both writes go out once, whatever comes of them. Nothing prints what the station answers
# (docs/reference/contradictions.md, B-9, B-40), so an
# acknowledgement and silence are taken alike, and what counts is who answers R-SMN afterwards.

MODEL = next(command for command in COMMON if command.name == "model")
NOT_ACKNOWLEDGED = 40  # B-number
BACK_S = 30.0  # a station that is not back by then is gone
SEEK_S = 0.5  # between two questions to a station that restarts
STEADY = 4  # answers in a row: it may go on answering for a moment before it goes down


def restart(client: Client, command: Command) -> Steps[float]:
    """Write W-RST once and wait until the station is back; give the seconds that took.

    Raises `Refusal` where the station says no, and `StationSilent` where it does not come back.
    """
    began = client.now
    try:
        yield from client.write(command, 0)
    except Refusal:
        raise
    except StationError:  # as good as an acknowledgement
        client.anomalies.meet(NOT_ACKNOWLEDGED, "restart", f"W{command.code()} without an answer")
    yield from settle_restart(client)
    return client.now - began


def settle_restart(client: Client) -> Steps[None]:
    """Wait until a station that was told to restart answers steadily. Raises `StationSilent` where it does not."""
    end, steady = client.now + BACK_S, 0
    while steady < STEADY:
        if client.now > end:
            raise StationSilent(f"the station was told to restart and did not answer again within {BACK_S:g} s")
        client.unasked((yield Wait(client.now + SEEK_S)))
        try:
            yield from client.read(MODEL)
            steady += 1
        except StationError:
            steady = 0


def change_address(station: Station, command: Command, address: int | None) -> Steps[None]:
    """Write W-SAD once and speak to the station at its new address from then on; None is a line without addresses.

    Raises `Refusal` where the station says no, and what `settle_address` raises.
    """
    try:
        yield from station.write(command, address or 0)
    except Refusal:
        raise
    except StationError:
        pass  # who answers at which address is asked below
    yield from settle_address(station, address)


def settle_address(station: Station, address: int | None) -> Steps[None]:
    """Prove by R-SMN that the station answers at `address`.

    Raises `AnswerTimeout` where it does not: either it still answers at its old address, to which `station` then speaks
    again, or it answers at neither.
    """
    old = station.address
    for tried in (address, old, address, old):  # it may still be storing the new one
        station.move_to(tried)
        try:
            yield from station.read(MODEL)
        except StationError:
            continue
        if tried == address:
            return
        raise AnswerTimeout(f"the station still answers at its old address ({_words(old)})")
    raise AnswerTimeout(f"the station answers neither at its new address ({_words(address)}) nor at its old one ({_words(old)})")


def _words(address: int | None) -> str:
    return "none: frames without addresses" if address is None else f"{address:02d}"
