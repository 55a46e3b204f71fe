"""A question on the wire of a JBC station, and the shape that its answer must have."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from jbclog.commands.command import Command
from jbclog.protocol.frame import ETX, check_byte
from jbclog.quantities import Value

KNOWN_ANSWERS = 1024  # that are remembered for each question; stations say the same over and over
KNOWN_QUESTIONS = 4096


@dataclass(slots=True)
class Question:
    """A frame to send and the shape that its answer must have."""

    command: Command
    port: int | None
    frame: bytes
    code: str
    digits: int | None  # characters of data that the answer carries; None: any number but none
    answer_start: bytes  # STX, addresses, A and the code
    answer_length: int
    wire_s: float
    tries: int  # how often it may go out
    _texts: dict[bytes, str]
    _values: dict[str, Value]

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
        return value

    def title(self) -> str:
        """How messages name it: ``tip temperature of port 1``."""
        name = self.command.name.replace("_", " ")
        return name if self.port is None else f"{name} of port {self.port}"


@lru_cache(KNOWN_QUESTIONS)
def known_answers(frame: bytes, command: Command, answer_start: bytes) -> tuple[dict[bytes, str], dict[str, Value]]:
    """What was answered to a question so far, as text and as values: one memory for all stations with the same address."""
    return {}, {}
