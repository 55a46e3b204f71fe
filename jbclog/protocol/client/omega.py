"""The client of one Apollo Seiko OMEGA: questions, answers, silence, and what comes late.

The rules:

1. One question is outstanding at a time. An answer is believed only when its sum holds and it begins with the question's letter
   in lower case, for a condition with its number behind that, and has the length that belongs to it. a alone, without its
   digit, is one, too: 003, 11.3.1 prints no more.
2. What the controller refuses it ignores, and a frame with a wrong sum it drops (003, 11.2): both look like a lost answer. So
   after a silence something else is asked that has been answered before, A if possible. Answered, the line is good: what was
   silent three times over was refused (`Ignored`). Silent too, nothing is there (`StationSilent`). A controller that has never
   answered anything else but this question has nothing to be asked in between: it is waited for, and silent after three tries.
3. The same question also proves that no answer is under way any more, because answers come in the order of questions: no letter
   is asked again before it, or before `GONE_S` are over. Right behind itself a letter is asked only once the line was quiet for
   `QUIET_S`: an answer that came twice would pass for the next.
4. A read goes out three times at most. D and H move the machine and go out once; whether D took is a matter of reading back.
5. h and i come when a joint is done, in the middle of anything. They answer nothing and are kept in `by_itself`.
6. An answer may take its bytes and `ALLOWED_S`; 003, 11.1 prints 0 to 250 ms.

Everything here is a generator that does no I/O (`core.io_requests`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from typing import NamedTuple

from jbclog.core.errors import AnswerCorrupt, AnswerFormat, AnswerTimeout, Ignored, StationError, StationSilent
from jbclog.core.io_requests import Ask, Heard, Listen, Steps
from jbclog.core.quantities import Value
from jbclog.core.wire import AROUND, LineFormat
from jbclog.protocol.client.interface import Anomalies, Asking, Flow, Permit, anything
from jbclog.protocol.commands.command import Command
from jbclog.protocol.commands.omega import LATE, OMEGA, Digit
from jbclog.protocol.frame import Corrupt
from jbclog.protocol.omega import OmegaReader, encode

REPEATS = 2  # a read goes out three times at most
ALLOWED_S = 0.4  # of turnaround, whatever was seen: the printed 250 ms, and a busy host (docs/reference/contradictions.md, B-47)
MOST_S = 1.0  # of turnaround, however slow answers were
GONE_S = 2.0  # an answer that has not come by then never will
QUIET_S = 0.03
PROBES = 2  # questions that a silent controller gets before it counts as silent
COMPLETION_S = 120.0  # for a joint, from H to h or i
LOOK_S = 1.0  # how often it is looked whether the controller is still there, meanwhile
RECORD = 50  # characters of the longest answer that has no length of its own (docs/reference/protocol.md, Condition record)

PROBE_COMMANDS = [command for command in OMEGA if command.name in ("information", "temperature_control", "set_temperature_state")]
UNCERTAIN = (AnswerTimeout, AnswerCorrupt, AnswerFormat)
"""After these an answer may still be under way."""


class Said(NamedTuple):
    """What the controller said by itself: when it was whole, and its letter."""

    at: float
    letter: str


@dataclass(frozen=True, slots=True)
class OmegaQuestion:
    """A frame to send and how its answer must begin."""

    command: Command
    frame: bytes
    answer: str  # the letter, and the number of a condition
    digits: int | None  # characters behind the letter; None: any number
    may_lack: bool  # whether an answer without them is one, too
    answer_length: int  # characters that the whole answer may have
    wire_s: float
    tries: int
    name: str

    @property
    def letter(self) -> str:
        return self.answer[0]

    def fits(self, text: str) -> bool:
        """Whether an answer that begins as it must has a length that it may have."""
        return self.digits in (None, len(text) - 1) or (self.may_lack and len(text) == 1)

    def title(self) -> str:
        """How messages name it: ``temperature control``, ``condition 101``."""
        return self.name


class OmegaStation:
    """An OMEGA on a line of its own. What its attributes mean `Client` says; `by_itself` is for whoever takes it out to tell it."""

    def __init__(self, line: LineFormat) -> None:
        self.line = line
        self.now = self.sent = self.heard = 0.0
        self.first_sent: float | None = None
        self.exchanges = 0
        self.data = ""
        self.permit: Permit = anything
        self.turnaround_s = 0.0  # the longest seen lately
        self.strays: Counter[str] = Counter()
        self.anomalies = Anomalies()
        self.flow = Flow()
        self.by_itself: list[Said] = []
        self.without_digit: set[str] = set()  # letters of answers that have come without what should stand behind them
        self._reader = OmegaReader()
        self._doubted: dict[str, float] = {}  # letters of answers that may be under way, and until when
        self._last = ""  # the letter of the last answer
        self._answered: set[str] = set()  # letters of answers that have come, ever
        self._questions: dict[str, OmegaQuestion] = {}

    @property
    def garbage_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._reader.garbage

    # -- what a session asks for ----------------------------------------------------------------------------------

    def read(self, command: Command, port: int | None = None, tool: int | None = None) -> Steps[Value]:
        """Read a value. Raises `StationError` when no try gave one; `StationSilent` when nothing answers any more."""
        return self.ask(self.question(command, port, tool))

    def ask(self, question: Asking) -> Steps[Value]:
        """The same with a question that this client made before. Raises `Ignored` where only this one is not answered."""
        assert isinstance(question, OmegaQuestion)
        failures: list[StationError] = []
        is_proven = False  # whether something else was answered behind a silence
        for _ in range(question.tries):
            if self._is_doubted(question.letter):
                if not (yield from self._settle(question.letter)):
                    yield from self._listen_until(self._doubted[question.letter])
            elif question.letter == self._last:
                yield from self._listen_until(self.heard + QUIET_S)
            try:
                self.data = yield from self._exchange(question)
                self._note_length(question)
                return question.command.quantity.decode(self.data)
            except ValueError as error:  # a whole answer to this question, so nothing is under way
                failures.append(AnswerFormat(f"{question.title()}: {error}"))
            except UNCERTAIN as error:
                failures.append(error)
                if self._answered == {question.letter}:
                    continue  # there is nothing else to ask: the next try waits until no answer can come any more
                is_proven = yield from self._settle(question.letter)
                if not is_proven:
                    raise StationSilent(f"no answer to {question.title()}, and none to anything else") from error
        if not all(isinstance(failure, AnswerTimeout) for failure in failures):
            raise failures[-1]
        if is_proven:
            raise _ignored(question)
        raise StationSilent(f"no answer to {question.title()} in {question.tries} tries, and it has never answered anything else")

    def write(
        self,
        command: Command,
        value: Value,
        port: int | None = None,
        tool: int | None = None,
        *,
        hurry: bool = False,
        once: bool = False,
    ) -> Steps[None]:
        """Write a value `once`, as always here. An acknowledgement is not proof: read back. Nothing here can `hurry`.

        Of H the end is waited for, `COMPLETION_S` at most. Raises `Ignored` where D was not answered and the next question was,
        and another `StationError` where what was done with it is not known.
        """
        self.permit(command, value, port, tool)
        question = self._shape(command, command.code() + command.quantity.encode(value), command.letters.lower())
        known = len(self.by_itself)
        try:
            yield from self._exchange(question)
        except AnswerTimeout as error:
            if not (yield from self._settle(question.letter)):
                raise StationSilent(f"no answer to {question.title()}, and none to anything else") from error
            if question.letter not in LATE:
                raise _ignored(question) from error
            yield from self._await_completion(question, known)

    def unasked(self, heard: Heard) -> None:
        """Take note of the moment, and of what came although nothing was asked."""
        self._hear(heard)
        self._sort(None, heard)

    def _hear(self, heard: Heard) -> None:
        self.now = heard.now
        self.flow.came(heard.now, len(heard.data))

    def _expect_no_flood(self) -> None:
        """Raise `LinkFlooded` where far more has come over the last second than answers are."""
        if self.flow.found is not None:
            raise self.flow.taken()

    # -- questions -------------------------------------------------------------------------------------------------

    def question(self, command: Command, port: int | None = None, tool: int | None = None) -> OmegaQuestion:
        """The read of `command`, made once and kept. There is one port and no tool, and neither stands in a question."""
        code = command.code()
        known = self._questions.get(code)
        if known is None:
            known = self._questions[code] = self._shape(command, code, code[0].lower() + code[1:])
        return known

    def _shape(self, command: Command, text: str, answer: str) -> OmegaQuestion:
        frame, digits, number = encode(text), command.answer_digits, text[1:5]
        length = AROUND + 1 + (RECORD if digits is None else digits)
        wire_s = self.line.seconds(len(frame) + length)
        name = command.name.replace("_", " ") + (f" {int(number, 16)}" if number else "")
        may_lack = isinstance(command.quantity, Digit) and command.quantity.may_lack
        tries = 1 if command.asked_once else 1 + REPEATS
        return OmegaQuestion(command, frame, answer, digits, may_lack, length, wire_s, tries, name)

    def _note_length(self, question: OmegaQuestion) -> None:
        """Reckon with the answer as it comes: one without its digit is a character shorter."""
        if question.may_lack and not self.data and question.letter not in self.without_digit:
            self.without_digit.add(question.letter)
            shorter = question.wire_s - self.line.seconds(question.digits or 0)
            self._questions[question.command.code()] = replace(question, wire_s=shorter)

    # -- doubt -----------------------------------------------------------------------------------------------------

    def _is_doubted(self, letter: str) -> bool:
        """Whether an answer with this letter may still come to a question that was given up."""
        return self._doubted.get(letter, self.now) > self.now

    def _settle(self, letter: str) -> Steps[bool]:
        """Have something else answered, so that no answer with `letter` is under way. False where nothing answers."""
        probes = [self.question(command) for command in PROBE_COMMANDS]
        others = [probe for probe in probes if probe.letter != letter and not self._is_doubted(probe.letter)]
        if self._answered:
            others = [probe for probe in others if probe.letter in self._answered]
        for probe in others[:PROBES]:
            try:
                yield from self._exchange(probe)
                return True
            except UNCERTAIN:
                continue
        return False

    def _listen_until(self, moment: float) -> Steps[None]:
        """Nothing is asked before `moment`; what comes until then answers nothing."""
        while self.now < moment:
            heard = yield Listen(moment)
            self._hear(heard)
            self._sort(None, heard)

    # -- one exchange ----------------------------------------------------------------------------------------------

    def patience_s(self, question: OmegaQuestion) -> float:
        """How long the answer may take from the moment the question is handed over."""
        return question.wire_s + min(max(ALLOWED_S, 2 * self.turnaround_s), MOST_S)

    def _exchange(self, question: OmegaQuestion) -> Steps[str]:
        """Send it, and give what stands behind the letter of its answer. Raises one of `UNCERTAIN`."""
        self._expect_no_flood()
        patience_s = self.patience_s(question)
        heard = yield Ask(question.frame, patience_s)
        self.flow.came(heard.now, len(heard.data), question.answer_length)
        self.exchanges += 1
        self.sent, until = heard.sent, heard.sent + patience_s
        if self.first_sent is None:
            self.first_sent = heard.sent
        unanswered: StationError = AnswerTimeout(f"{question.title()}: no answer within {patience_s:.3f} s")
        while heard.data:
            self._expect_no_flood()
            self.now = heard.now
            try:
                found = self._sort(question, heard)
            except UNCERTAIN as error:
                unanswered, found = error, []
            if found:
                self._note_answer(question, heard.now)
                return found[0]
            heard = yield Listen(until)
            self.flow.came(heard.now, len(heard.data))
        self.now = heard.now
        self._reader.reset()
        self._doubted[question.letter] = self.sent + GONE_S
        raise unanswered

    def _sort(self, question: OmegaQuestion | None, heard: Heard) -> list[str]:
        """What of the bytes answers `question`: data fields. What was said by itself is kept, all else is counted.

        Raises `AnswerCorrupt` and `AnswerFormat` for what may have been the answer.
        """
        answers: list[str] = []
        damaged: StationError | None = None
        for found in self._reader.feed(heard.data):
            if self.flow.is_suspect:
                self.strays["flood"] += 1
            elif isinstance(found, Corrupt):
                self.strays["sum"] += 1
                damaged = AnswerCorrupt(f"wrong sum in {found.raw.hex(' ')}")
            elif found in LATE:
                self.by_itself.append(Said(heard.now, found))
                if question is not None and question.letter in LATE:
                    answers.append("")
            elif question is None or not found.startswith(question.answer):
                self.strays[self._kind_of(found, asked=question is not None)] += 1
            elif question.fits(found):
                answers.append(found[1:])
            else:
                damaged = AnswerFormat(f"{question.title()}: {len(found) - 1} characters behind the letter of {found}")
        if question is not None and damaged is not None and not answers:
            raise damaged
        return answers

    def _kind_of(self, text: str, *, asked: bool) -> str:
        if text[0].isupper():
            return "echo"
        if self._is_doubted(text[0]):
            return "late"
        return "code" if asked else "unasked"

    def _note_answer(self, question: OmegaQuestion, now: float) -> None:
        """It has answered: answers come in the order of questions, so none to an earlier one is under way."""
        self.now = self.heard = now
        self._doubted.clear()
        self._last = question.letter
        self._answered.add(question.letter)
        took = max(now - self.sent - question.wire_s, 0.0)
        self.turnaround_s = took if took > self.turnaround_s else self.turnaround_s * 0.99 + took * 0.01

    def _await_completion(self, question: OmegaQuestion, known: int) -> Steps[None]:
        """Wait for h or i, asking now and then whether the controller is still there.

        Raises `AnswerTimeout` where neither comes: whether a joint is being made, or none, nothing tells.
        """
        end = self.now + COMPLETION_S
        while len(self.by_itself) == known:
            if self.now >= end:
                raise AnswerTimeout(
                    f"{question.title()}: neither h nor i within {COMPLETION_S:g} s; an unknown number is ignored without an answer"
                )
            heard = yield Listen(min(end, self.now + LOOK_S))
            self._hear(heard)
            self._sort(None, heard)
            if not heard.data and not (yield from self._settle(question.letter)):
                raise StationSilent(f"{question.title()}: it was sent, and now nothing answers any more")


def _ignored(question: OmegaQuestion) -> Ignored:
    return Ignored(f"{question.title()}: ignored, while the next question was answered; so OMEGA refuses what it does not take")
