"""A request to a JBC station, and the form of its answer. Accepted answers are kept, because
stations repeat themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from jbclog.core.io_requests import Ask
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.ranges import odd_form
from jbclog.protocol.frame import STX

KNOWN_ANSWERS = 1024  # cached for each request
KNOWN_QUESTIONS = 4096


Decoded = tuple[Value, int | None]
"""The value of a data field, and the B-number of its form; None for the recommended form."""


@dataclass(slots=True)
class Question:
    """A frame to send and the form of its answer.

    `digits` is the number of data characters; None: any above 0. `is_short` is R-TT, whose code has
    two letters. `also` is another code under which some stations answer ("" for none),
    `also_number` its B-number. `repeated` is data that an acknowledgement may carry. `least_s` is
    the minimum response time allowed for.
    """

    command: Command
    port: int | None
    frame: bytes
    code: str
    digits: int | None
    answer_start: bytes  # STX, addresses, A and the code
    answer_length: int
    wire_s: float
    usual: Ask  # the request with the time-out of nearly every read
    tries: int  # at most
    is_short: bool
    answers: dict[bytes, str]  # data fields of complete answers that were accepted before
    decoded: dict[str, Decoded]
    also: str = ""
    also_number: int = 0
    repeated: str = ""
    is_write: bool = False
    least_s: float = 0.0

    def remember(self, received: bytes, data: str) -> None:
        """Keep the data field of an accepted answer if `received` is nothing but that, and no
        beginning of another frame.
        """
        is_whole = len(received) == self.answer_length and received.startswith(self.answer_start)
        if is_whole and received[-1] != STX and len(self.answers) < KNOWN_ANSWERS:
            self.answers[received] = data

    def decode(self, data: str) -> Decoded:
        """Decode a data field. Raises `ValueError` if it is invalid."""
        decoded = self.command.quantity.decode(data), odd_form(self.command.name, data)
        if len(self.decoded) < KNOWN_ANSWERS:
            self.decoded[data] = decoded
        return decoded

    def title(self) -> str:
        """Name for messages: ``tip temperature of port 1``."""
        name = self.command.name.replace("_", " ")
        return name if self.port is None else f"{name} of port {self.port}"


@lru_cache(KNOWN_QUESTIONS)
def known_answers(
    frame: bytes, command: Command, answer_start: bytes
) -> tuple[dict[bytes, str], dict[str, Decoded]]:
    """Return `answers` and `decoded` of a request, shared by all stations with the same address."""
    return {}, {}
