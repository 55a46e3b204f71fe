"""The client of one Apollo Seiko OMEGA: requests, answers, silence, and late messages.

The rules:

1. One request is outstanding at a time. An answer is accepted only if its sum is correct, it begins
   with the request's letter in lower case, for a condition followed by its number, and its length
   is right. An "a" without its digit is accepted too: 003, 11.3.1 prints no more.
2. The controller ignores what it refuses, and drops a frame with a wrong sum (003, 11.2): both look
   like a lost answer. So after silence the client sends another request that has been answered
   before, A if possible. If that is answered, the link works, and a request without an answer in
   three tries was refused (`Ignored`). If not, the controller is gone (`StationSilent`). If no
   other request has ever been answered, each try waits, and three silent tries mean silence.
3. The same probe proves that no answer is on its way, because answers come in the order of
   requests: a letter is not sent again before it, or before `GONE_S`. Right after itself a letter
   is sent only once the link was quiet for `QUIET_S`: a repeated answer would pass for the next.
4. A read is sent three times at most. D and H move the machine and are sent once; reading back
   decides whether D succeeded.
5. The controller sends h and i when a joint is completed, at any time. They answer nothing and are
   kept in `completions`.
6. A second, different answer to the last question contradicts the first, as in `dialogue.py`.
7. The time-out is transmission time plus `ALLOWED_S`; 003, 11.1 prints 0 to 250 ms.

Everything that waits is a coroutine without I/O (`core.io_requests`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

from jbclog.core.errors import (
    AnswerContradicted,
    AnswerCorrupt,
    AnswerFormat,
    AnswerTimeout,
    Ignored,
    StationError,
    StationSilent,
)
from jbclog.core.io_requests import IoResult, ask, listen
from jbclog.core.quantities import Value
from jbclog.core.serial_line import FRAMING, LineFormat
from jbclog.protocol.client.interface import (
    Anomalies,
    Contradiction,
    FloodDetector,
    Permit,
    PreparedRead,
    ignore_end,
    ignore_interruption,
    permit_all,
)
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.omega import COMPLETION_MESSAGES, OMEGA, Digit
from jbclog.protocol.frame import CorruptFrame
from jbclog.protocol.omega import OmegaReader, encode

REPEATS = 2  # a read is sent three times at most
# response time allowed for: the printed 250 ms, and a busy host (docs/reference/contradictions.md,
# B-47)
ALLOWED_S = 0.4
MOST_S = 1.0  # maximum response time allowed for
GONE_S = 2.0  # no answer arrives later than this
QUIET_S = 0.03
PROBES = 2  # unanswered probes after which a controller counts as silent
COMPLETION_S = 120.0  # for a joint, from H to h or i
LOOK_S = 1.0  # between two probes during a joint
# characters of the longest answer of variable length (docs/reference/protocol.md, Condition record)
RECORD = 50

PROBE_COMMANDS = [
    command
    for command in OMEGA
    if command.name in ("information", "temperature_control", "set_temperature_state")
]
UNCERTAIN = (AnswerTimeout, AnswerCorrupt, AnswerFormat)
"""Errors after which an answer may still be on its way."""


class Completion(NamedTuple):
    """An unsolicited message of the controller: the time it was complete, and its letter."""

    at: float
    letter: str


@dataclass(frozen=True, slots=True)
class OmegaQuestion:
    """A frame to send, and the expected beginning of its answer."""

    command: Command
    frame: bytes
    answer: str  # the letter, and a condition's number
    digits: int | None  # characters after the letter; None: any number
    may_lack: bool  # an answer without them is accepted
    answer_length: int  # maximum characters of the complete answer
    wire_s: float
    tries: int
    name: str

    @property
    def letter(self) -> str:
        return self.answer[0]

    def fits(self, text: str) -> bool:
        """Return True if an answer with the right beginning has an allowed length."""
        return self.digits in (None, len(text) - 1) or (self.may_lack and len(text) == 1)

    def title(self) -> str:
        """Name for messages: ``temperature control``, ``condition 101``."""
        return self.name


class OmegaStation:
    """The client of an OMEGA; for the attributes see `interface.Client`. The session empties
    `completions`.
    """

    def __init__(self, line: LineFormat) -> None:
        self.line = line
        self.now = self.sent = self.heard = 0.0
        self.first_sent: float | None = None
        self.exchanges = 0
        self.data = ""
        self.permit: Permit = permit_all
        self.turnaround_s = 0.0  # longest recent response time
        self.strays: Counter[str] = Counter()
        self.anomalies = Anomalies()
        self.flow = FloodDetector()
        self.contradicted: Contradiction | None = None
        self.ended: Callable[[bool], None] = ignore_end
        self.interrupt_at = inf
        self.interrupt: Callable[[], None] = ignore_interruption
        self.completions: list[Completion] = []
        self.without_digit: set[str] = set()  # letters of answers that came without their digit
        self._reader = OmegaReader()
        # letters of answers that may be on their way, and until when
        self._doubted: dict[str, float] = {}
        self._last = ""  # the letter of the last answer
        self._lost: set[str] = set()  # letters of requests whose last try got no answer
        # the last answered read, while another answer to it contradicts the first
        self._last_read: OmegaQuestion | None = None
        self._answered: set[str] = set()  # letters of all answers so far
        self._questions: dict[str, OmegaQuestion] = {}

    @property
    def garbage_bytes(self) -> int:
        return self._reader.garbage

    async def read(
        self, command: Command, port: int | None = None, tool: int | None = None
    ) -> Value:
        return await self.ask(self.question(command, port, tool))

    async def ask(self, question: PreparedRead) -> Value:
        """Read a value by a prepared read. Raises `Ignored` if only this request is not
        answered.
        """
        assert isinstance(question, OmegaQuestion)
        failures: list[StationError] = []
        is_proven = False  # another request was answered after a silence
        for _ in range(question.tries):
            if self._is_doubted(question.letter):
                if not await self._settle(question.letter):
                    await self._listen_until(self._doubted[question.letter])
            elif question.letter == self._last:
                await self._listen_until(self.heard + QUIET_S)
            try:
                await self._exchange(question)
                self._note_length(question)
                return question.command.quantity.decode(self.data)
            except ValueError as error:  # a complete answer, so none is on its way
                failures.append(AnswerFormat(f"{question.title()}: {error}"))
            except UNCERTAIN as error:
                failures.append(error)
                if self._answered == {question.letter}:
                    # no other request to send: wait until no answer can arrive
                    continue
                is_proven = await self._settle(question.letter)
                if not is_proven:
                    raise StationSilent(
                        f"no answer to {question.title()}, and none to anything else"
                    ) from error
        if not all(isinstance(failure, AnswerTimeout) for failure in failures):
            raise failures[-1]
        if is_proven:
            raise _ignored(question)
        raise StationSilent(
            f"no answer to {question.title()} in {question.tries} tries, and it has never answered"
            " anything else"
        )

    async def write(
        self,
        command: Command,
        value: Value,
        port: int | None = None,
        tool: int | None = None,
        *,
        hurry: bool = False,
        once: bool = False,
    ) -> None:
        """Write a value, always once. An acknowledgement proves nothing: read back. `hurry` has no
        effect.

        After H, wait up to `COMPLETION_S` for its end. Raises `Ignored` if D was not answered but
        the next request was, and another `StationError` if the result is not known.
        """
        self.permit(command, value, port, tool)
        question = self._shape(
            command, command.code() + command.quantity.encode(value), command.letters.lower()
        )
        known = len(self.completions)
        try:
            await self._exchange(question, is_read=False)
        except AnswerTimeout as error:
            if not await self._settle(question.letter):
                raise StationSilent(
                    f"no answer to {question.title()}, and none to anything else"
                ) from error
            if question.letter not in COMPLETION_MESSAGES:
                raise _ignored(question) from error
            await self._await_completion(question, known)

    def unasked(self, heard: IoResult) -> None:
        """Register bytes received without a request, and their time."""
        self._hear(heard)
        self._sort(None, heard)

    def _hear(self, heard: IoResult) -> None:
        self.now = heard.now
        self.flow.came(heard.now, len(heard.data))

    def question(
        self, command: Command, port: int | None = None, tool: int | None = None
    ) -> OmegaQuestion:
        """Prepare a read of `command`. OMEGA requests have neither port nor tool."""
        code = command.code()
        known = self._questions.get(code)
        if known is None:
            known = self._questions[code] = self._shape(command, code, code[0].lower() + code[1:])
        return known

    def _shape(self, command: Command, text: str, answer: str) -> OmegaQuestion:
        frame = encode(text)
        digits = command.answer_digits
        number = text[1:5]
        length = FRAMING + 1 + (RECORD if digits is None else digits)
        wire_s = self.line.seconds(len(frame) + length)
        name = command.name.replace("_", " ") + (f" {int(number, 16)}" if number else "")
        may_lack = isinstance(command.quantity, Digit) and command.quantity.may_lack
        tries = 1 if command.sent_once else 1 + REPEATS
        return OmegaQuestion(command, frame, answer, digits, may_lack, length, wire_s, tries, name)

    def _note_length(self, question: OmegaQuestion) -> None:
        """Adjust the expected duration to an answer without its digit."""
        if question.may_lack and not self.data and question.letter not in self.without_digit:
            self.without_digit.add(question.letter)
            shorter = question.wire_s - self.line.seconds(question.digits or 0)
            self._questions[question.command.code()] = replace(question, wire_s=shorter)

    def _is_doubted(self, letter: str) -> bool:
        """Return True if an answer with this letter may still arrive."""
        return self._doubted.get(letter, self.now) > self.now

    async def _settle(self, letter: str) -> bool:
        """Get a probe answered, so that no answer with `letter` is on its way; return False if none
        is answered.
        """
        probes = [self.question(command) for command in PROBE_COMMANDS]
        others = [
            probe
            for probe in probes
            if probe.letter != letter and not self._is_doubted(probe.letter)
        ]
        if self._answered:
            others = [probe for probe in others if probe.letter in self._answered]
        for probe in others[:PROBES]:
            try:
                await self._exchange(probe)
                return True
            except AnswerContradicted:
                return True
            except UNCERTAIN:
                continue
        return False

    async def _listen_until(self, moment: float) -> None:
        """Send nothing before `moment`; bytes until then answer nothing."""
        while self.now < moment:
            heard = await listen(moment)
            self._hear(heard)
            self._sort(None, heard)

    def patience_s(self, question: OmegaQuestion) -> float:
        """Return the time-out of a request, from the moment it is sent."""
        return question.wire_s + min(max(ALLOWED_S, 2 * self.turnaround_s), MOST_S)

    async def _exchange(self, question: OmegaQuestion, *, is_read: bool = True) -> None:
        """Send a request; put the text after its answer's letter into `data`. Raises
        `UNCERTAIN`.
        """
        self.flow.expect_none()
        patience_s = self.patience_s(question)
        heard = await ask(question.frame, patience_s)
        self.flow.came(heard.now, len(heard.data), question.answer_length)
        self.exchanges += 1
        self.sent = heard.sent
        until = heard.sent + patience_s
        if self.first_sent is None:
            self.first_sent = heard.sent
        unanswered: StationError = AnswerTimeout(
            f"{question.title()}: no answer within {patience_s:.3f} s"
        )
        while heard.data:
            self.flow.expect_none()
            self.now = heard.now
            try:
                answers = self._sort(question, heard)
            except UNCERTAIN as error:
                unanswered = error
                answers = []
            if answers:
                self._note_answer(question, heard.now, answers[0], is_read=is_read)
                for data in answers[1:]:
                    self._compare(question.letter + data)
                if self.contradicted is not None:
                    self.contradicted = None
                    raise AnswerContradicted(f"{question.title()}: two answers came together")
                return
            heard = await listen(until)
            self.flow.came(heard.now, len(heard.data))
        is_silent = isinstance(unanswered, AnswerTimeout)
        self.ended(not is_silent)
        if not is_silent:
            self._last_read = None
        self._lost.add(question.letter)
        self.now = heard.now
        self._reader.reset()
        self._doubted[question.letter] = self.sent + GONE_S
        raise unanswered

    def _sort(self, question: OmegaQuestion | None, heard: IoResult) -> list[str]:
        """Return data fields that answer `question`; keep unsolicited messages, count everything
        else.

        Raises `AnswerCorrupt` and `AnswerFormat` for what may have been the answer.
        """
        answers: list[str] = []
        damaged: StationError | None = None
        for text in self._reader.feed(heard.data):
            if self.flow.is_suspect:
                self.strays["flood"] += 1
            elif isinstance(text, CorruptFrame):
                self.strays["sum"] += 1
                damaged = AnswerCorrupt(f"wrong sum in {text.raw.hex(' ')}")
            elif text in COMPLETION_MESSAGES:
                self.completions.append(Completion(heard.now, text))
                if question is not None and question.letter in COMPLETION_MESSAGES:
                    answers.append("")
            elif question is None or not text.startswith(question.answer):
                self.strays[self._kind_of(text, asked=question is not None)] += 1
                self._compare(text)
            elif question.fits(text):
                answers.append(text[1:])
            else:
                damaged = AnswerFormat(
                    f"{question.title()}: {len(text) - 1} characters behind the letter of {text}"
                )
        if question is not None and damaged is not None and not answers:
            raise damaged
        return answers

    def _kind_of(self, text: str, *, asked: bool) -> str:
        if text[0].isupper():
            return "echo"
        if self._is_doubted(text[0]):
            return "late"
        return "code" if asked else "unasked"

    def _note_answer(
        self, question: OmegaQuestion, now: float, data: str, *, is_read: bool
    ) -> None:
        """Clear earlier doubts: answers come in order, so none to an earlier request is on its
        way.
        """
        self.ended(True)
        self.contradicted = None
        is_only_one = question.letter not in self._lost
        self._last_read = question if is_read and is_only_one else None
        self._lost.discard(question.letter)
        if is_read:
            self.data = data
        self.now = self.heard = now
        self._doubted.clear()
        self._last = question.letter
        self._answered.add(question.letter)
        took = max(now - self.sent - question.wire_s, 0.0)
        self.turnaround_s = (
            took if took > self.turnaround_s else self.turnaround_s * 0.99 + took * 0.01
        )

    def _compare(self, text: str) -> None:
        """Note a contradiction if `text` is another answer to the last answered read."""
        question = self._last_read
        if question is None or not text.startswith(question.answer) or not question.fits(text):
            return
        decode = question.command.quantity.decode
        try:
            is_other = decode(text[1:]) != decode(self.data)
        except ValueError:
            return
        if is_other:
            self.contradicted = Contradiction(question.command, self.heard)
            self._last_read = None

    async def _await_completion(self, question: OmegaQuestion, known: int) -> None:
        """Wait for h or i, probing now and then.

        Raises `AnswerTimeout` if neither comes: a joint may still be in progress.
        """
        end = self.now + COMPLETION_S
        while len(self.completions) == known:
            if self.now >= end:
                raise AnswerTimeout(
                    f"{question.title()}: neither h nor i within {COMPLETION_S:g} s; an unknown"
                    " number is ignored without an answer"
                )
            heard = await listen(min(end, self.now + LOOK_S))
            self._hear(heard)
            self._sort(None, heard)
            if not heard.data and not await self._settle(question.letter):
                raise StationSilent(
                    f"{question.title()}: sent, but the controller does not answer any more"
                )


def _ignored(question: OmegaQuestion) -> Ignored:
    return Ignored(
        f"{question.title()}: ignored, while the next question was answered; so OMEGA refuses what"
        " it does not take"
    )
