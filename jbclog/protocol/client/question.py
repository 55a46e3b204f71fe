"""A question on the wire of a JBC station, and the shape that its answer must have."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.tolerated import odd_form
from jbclog.protocol.frame import ETX, check_byte

KNOWN_ANSWERS = 1024  # that are remembered for each question; stations say the same over and over
KNOWN_QUESTIONS = 4096


Known = tuple[dict[bytes, str], dict[str, Value], dict[str, int]]
"""The data fields of whole answers, the values of data fields, and the rows of docs/reference/contradictions.md of odd ones."""


@dataclass(slots=True)
class Question:
    """A frame to send and the shape that its answer must have.

    `digits` are the characters of data that the answer carries; None: any number but none. `is_short` is R-TT, whose code
    has two letters. `also` is another code under which some stations answer it, with its B-number; empty where
    there is none. `repeated` is data that an acknowledgement may carry. `least_s` is the turnaround that is allowed at the least.
    """

    command: Command
    port: int | None
    frame: bytes
    code: str
    digits: int | None
    answer_start: bytes  # STX, addresses, A and the code
    answer_length: int
    wire_s: float
    tries: int  # how often it may go out
    is_short: bool
    _texts: dict[bytes, str]
    _values: dict[str, Value]
    odd: dict[str, int]  # the B-numbers by which data fields that mean something are odd
    also: str = ""
    also_number: int = 0
    repeated: str = ""
    least_s: float = 0.0

    def text_in(self, data: bytes) -> str | None:
        """The data field where `data` is the whole answer in one piece and nothing else: nearly always so."""
        known = self._texts.get(data)
        if known is not None:  # the very bytes of an answer that was checked before
            return known
        if not self._is_whole_answer(data):
            return None
        text = data[len(self.answer_start) : -2].decode("ascii", "replace")
        if len(self._texts) < KNOWN_ANSWERS:
            self._texts[data] = text
        return text

    def _is_whole_answer(self, data: bytes) -> bool:
        return (
            len(data) == self.answer_length
            and data.startswith(self.answer_start)
            and data[-2] == ETX
            and check_byte(data[:-1]) == data[-1]
        )

    def value_of(self, text: str) -> Value:
        """What a data field means. Raises `ValueError` where it means nothing."""
        value = self._values.get(text)
        if value is None:
            value = self.command.quantity.decode(text)
            if len(self._values) < KNOWN_ANSWERS:
                self._values[text] = value
            self._look_at_form(text)
        return value

    def _look_at_form(self, text: str) -> None:
        row = odd_form(self.command.name, text)
        if row is not None and len(self.odd) < KNOWN_ANSWERS:
            self.odd[text] = row

    def odd_row(self, text: str) -> int | None:
        """The B-number by which a data field that means something is odd; None where it is as recommended."""
        return self.odd.get(text) if len(self.odd) < KNOWN_ANSWERS else odd_form(self.command.name, text)

    @property
    def is_write(self) -> bool:
        """Whether it changes something; it is allowed longer then."""
        return self.least_s > 0

    def title(self) -> str:
        """How messages name it: ``tip temperature of port 1``."""
        name = self.command.name.replace("_", " ")
        return name if self.port is None else f"{name} of port {self.port}"


@lru_cache(KNOWN_QUESTIONS)
def known_answers(frame: bytes, command: Command, answer_start: bytes) -> Known:
    """What was answered to a question so far: one memory for all stations with the same address."""
    return {}, {}, {}
