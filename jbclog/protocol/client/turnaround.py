"""How long a station itself takes to answer, measured with harmless reads.

What is measured is from the question to the whole answer. What its bytes need at the stated line format is taken off; the rest
is the response time. Behind a network server, or where the stated rate is too low, an answer can be whole before its bytes could
have come at that rate: then the response time is 0, and the link is faster than stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from jbclog.core.errors import NotSupported, StationError
from jbclog.core.io_requests import Steps, Wait
from jbclog.core.line_format import LineFormat
from jbclog.protocol.client.interface import Asking, Client
from jbclog.protocol.client.patient_reads import SETTLE_S
from jbclog.protocol.commands.command import Scope
from jbclog.protocol.commands.family import Family

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
