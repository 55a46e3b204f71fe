"""A request to a JBC station, and the form of its answer. Caches checked answers, because stations
repeat themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from jbclog.core.io_requests import Ask
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.ranges import odd_form
from jbclog.protocol.frame import ETX, check_byte

KNOWN_ANSWERS = 1024  # cached for each request
KNOWN_QUESTIONS = 4096


Known = tuple[dict[bytes, tuple[str, Value]], dict[str, Value], dict[str, int]]
"""Caches: complete answers in the recommended form -> data field and value; data field -> value;
odd data field -> B-number.
"""


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
    # checked complete answers without any anomaly
    known: dict[bytes, tuple[str, Value]]
    _values: dict[str, Value]
    odd: dict[str, int]  # B-numbers of accepted data fields in an odd form
    also: str = ""
    also_number: int = 0
    repeated: str = ""
    is_write: bool = False
    least_s: float = 0.0

    def text_in(self, data: bytes) -> str | None:
        """Return the data field if `data` is exactly the complete answer."""
        return (
            data[len(self.answer_start) : -2].decode("ascii", "replace")
            if self._is_whole_answer(data)
            else None
        )

    def answer_in(self, data: bytes) -> tuple[str, Value] | None:
        """Return the data field and its value if `data` is exactly the complete, valid answer."""
        text = self.text_in(data)
        if text is None:
            return None
        try:
            answer = text, self.value_of(text)
        except ValueError:
            return None
        if not self.also and self.odd_row(text) is None and len(self.known) < KNOWN_ANSWERS:
            self.known[data] = answer
        return answer

    def _is_whole_answer(self, data: bytes) -> bool:
        return (
            len(data) == self.answer_length
            and data.startswith(self.answer_start)
            and data[-2] == ETX
            and check_byte(data[:-1]) == data[-1]
        )

    def value_of(self, text: str) -> Value:
        """Decode a data field. Raises `ValueError` if it is invalid."""
        value = self._values.get(text)
        if value is None:
            value = self.command.quantity.decode(text)
            if len(self._values) < KNOWN_ANSWERS:
                self._values[text] = value
            self._check_form(text)
        return value

    def _check_form(self, text: str) -> None:
        row = odd_form(self.command.name, text)
        if row is not None and len(self.odd) < KNOWN_ANSWERS:
            self.odd[text] = row

    def odd_row(self, text: str) -> int | None:
        """Return the B-number of an odd data field; None for the recommended form."""
        return (
            self.odd.get(text)
            if len(self.odd) < KNOWN_ANSWERS
            else odd_form(self.command.name, text)
        )

    def title(self) -> str:
        """Name for messages: ``tip temperature of port 1``."""
        name = self.command.name.replace("_", " ")
        return name if self.port is None else f"{name} of port {self.port}"


@lru_cache(KNOWN_QUESTIONS)
def known_answers(frame: bytes, command: Command, answer_start: bytes) -> Known:
    """Return the caches of a request, shared by all stations with the same address."""
    return {}, {}, {}
