"""The client of one JBC station in Robot mode: questions, answers, and how far an answer may be believed.

The rules:

1. One question is outstanding at a time. An answer is believed only when its check byte, addresses, header,
   code, length and digits are those of the pending question; anything else on the line is counted and dropped.
2. A read is asked again at most `REPEATS` times. What clears, moves or erases something is sent once (faults.md,
   rows 2 and 39), and so is every write: whether it took is a matter of reading back.
3. Answers carry no sequence number, so a late one looks like a fresh one. After a question without its answer the line
   is drained and a probe with another code must be answered before the same code is asked again (faults.md, row 5).
4. How long an answer may take follows from the bytes, the line format and the turnaround seen on this station.

Everything here is a generator that does no I/O (`effects`).
"""

from __future__ import annotations

from collections import Counter

from jbclog.commands.command import Command
from jbclog.commands.robot import COMMON, COMMUNICATION_ERRORS
from jbclog.effects import Ask, Heard, Listen, Steps
from jbclog.errors import (
    AnswerCorrupt,
    AnswerFormat,
    AnswerTimeout,
    ModelUnknown,
    NotReceived,
    NotSupported,
    OutOfRange,
    Refusal,
    RobotModeOff,
    StationError,
    StationSilent,
)
from jbclog.protocol.frame import Frame
from jbclog.protocol.reader import Corrupt, FrameReader
from jbclog.quantities import Value
from jbclog.station.client import Asking
from jbclog.station.question import Question, known_answers
from jbclog.wire import LineFormat

REPEATS = 2  # a read goes out three times at most
UNMEASURED_S = 0.3  # turnaround allowed before any was seen (digest B-13)
LEAST_S = 0.1  # turnaround allowed at the least: a busy host may well need that long to hand bytes over
QUIET_S = 0.02  # a line that was silent this long after a bad answer is drained
PROBES = 2  # questions a silent station gets before it counts as silent
UNEXPECTED_LENGTH = 20  # characters allowed for an answer of unprinted length, for its time-out

PROBE_COMMANDS = [command for command in COMMON if command.name in ("model", "station_error", "maximum_temperature")]

UNCERTAIN = (AnswerTimeout, AnswerCorrupt, AnswerFormat)
"""After these an answer may still be under way: what came may have been noise, an echo or an answer to something else."""

REFUSALS: dict[int, type[Refusal]] = {
    1: NotReceived,
    2: NotReceived,
    3: OutOfRange,
    4: NotSupported,
    5: RobotModeOff,
    6: ModelUnknown,
}


class Station:
    """A station on a line. `address` is None on a line without addresses.

    `sent` and `heard` are the moments (monotonic seconds) at which the last question left and its answer was whole; `now` is
    the last moment that anything was heard of, or not.
    `data` is the data field of the last answer to a read, as it came. `strays` counts by kind what was on the line and
    answered nothing.
    """

    def __init__(self, line: LineFormat, address: int | None = 1, host_address: int = 0) -> None:
        self.line = line
        self.address = address
        self.host_address = host_address
        self.sent = 0.0
        self.first_sent: float | None = None
        self.heard = 0.0
        self.now = 0.0
        self.exchanges = 0  # questions sent
        self.data = ""
        self.turnaround_s: float | None = None  # the longest seen lately
        self.strays: Counter[str] = Counter()
        self._reader = FrameReader()
        self._doubted: set[str] = set()  # codes to which an answer may be under way
        self._is_overdue = False  # the time of the last question was over before its answer came
        self._answer_from_station = True  # the order of addresses in answers is learnt (digest B-6)
        self._questions: dict[tuple[str, int | None, int | None], Question] = {}

    @property
    def garbage_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._reader.garbage

    # -- what a session asks for ----------------------------------------------------------------------------------

    def read(self, command: Command, port: int | None = None, tool: int | None = None) -> Steps[Value]:
        """Read a value. Raises `StationError` when no try gave one; `StationSilent` when nothing answers any more."""
        return self.ask(self.question(command, port, tool))

    def ask(self, question: Asking) -> Steps[Value]:
        """The same with a question that this client made before; the path of every sample."""
        assert isinstance(question, Question)
        tries = question.tries
        while True:
            tries -= 1
            if question.code in self._doubted:
                yield from self._settle(question)
            try:
                self.data = yield from self._exchange(question)
                return question.value_of(self.data)
            except ValueError as error:  # a whole answer to this question, so nothing is under way
                failure: StationError = AnswerFormat(f"{question.title()}: {error}")
            except (*UNCERTAIN, NotReceived) as error:
                failure = error
            if not tries:
                raise failure

    def write(self, command: Command, value: Value, port: int | None = None, tool: int | None = None) -> Steps[None]:
        """Write a value once. An acknowledgement is not proof: read back.

        Raises `Refusal` where the station says no, `AnswerTimeout` or another `StationError` where what it says is
        not known; then it may or may not have been done. It goes out whatever came before: it may be what stops a tool.
        """
        yield from self._exchange(self._make(command, "W", port, tool, command.quantity.encode(value)))

    def _settle(self, doubted: Question) -> Steps[None]:
        """An answer to `doubted` may still come: have another code answered, on a drained line where one is overdue.

        Raises `StationSilent` where nothing answers, and where something does that cannot be believed, what it met.
        """
        failure: StationError = AnswerTimeout()
        for probe in self._probes(doubted.code):
            if self._is_overdue:
                yield from self._drain()
            try:
                yield from self._exchange(probe)
                return
            except Refusal:  # that, too, proves that the station has done with what was asked before
                return
            except UNCERTAIN as error:
                failure = error
        if isinstance(failure, AnswerTimeout):
            raise StationSilent(f"no answer to {PROBES + 1} questions in a row")
        raise failure

    def move_to(self, address: int | None) -> None:
        """Speak to the station at another address from now on; None: without addresses."""
        self.address = address
        self._questions.clear()
        self._reader.reset()
        self._settled()

    def unasked(self, heard: Heard) -> None:
        """Take note of the moment, and of bytes that came although nothing was asked."""
        self.now = heard.now
        if heard.data:
            self.strays["unasked"] += 1
            self._reader.feed(heard.data)
            self._reader.reset()

    # -- questions -------------------------------------------------------------------------------------------------

    def question(self, command: Command, port: int | None = None, tool: int | None = None) -> Question:
        """The read of `command`, made once and kept."""
        key = (command.name, port, tool)
        known = self._questions.get(key)
        if known is None:
            known = self._questions[key] = self._make(command, "R", port, tool)
        return known

    def _make(self, command: Command, header: str, port: int | None, tool: int | None, data: str = "") -> Question:
        code = command.code(port, tool)
        return self._shape(command, port, header, code, data, 0 if header == "W" else command.answer_digits)

    def _probes(self, doubted: str) -> list[Question]:
        """Harmless reads, none of which has the code in doubt, each another code than the one before."""
        return [self.question(command) for command in PROBE_COMMANDS if command.letters != doubted][:PROBES]

    def _shape(self, command: Command, port: int | None, header: str, code: str, data: str, digits: int | None) -> Question:
        frame = self._frame(header, code + data, sending=True)
        start = self._frame("A", code, sending=not self._answer_from_station)[:-2]
        length = len(start) + (UNEXPECTED_LENGTH if digits is None else digits) + 2
        tries = 1 if command.asked_once else 1 + REPEATS
        wire_s = self.line.seconds(len(frame) + length)
        return Question(command, port, frame, code, digits, start, length, wire_s, tries, *known_answers(frame, command, start))

    def _frame(self, header: str, text: str, *, sending: bool) -> bytes:
        if self.address is None:
            return Frame(header, text).encode()
        source, target = (self.host_address, self.address) if sending else (self.address, self.host_address)
        return Frame(header, text, source, target).encode()

    # -- one exchange ----------------------------------------------------------------------------------------------

    def patience_s(self, question: Question) -> float:
        """How long the answer may take from the moment the question is handed over."""
        seen = self.turnaround_s
        return question.wire_s + (UNMEASURED_S if seen is None else max(LEAST_S, 4 * seen))

    def _exchange(self, question: Question) -> Steps[str]:
        """Ask once; give the data field of the answer."""
        self._reader.reset()  # what came before the question cannot answer it
        self._doubted.add(question.code)  # until that or any other is answered
        heard = yield Ask(question.frame, self.patience_s(question))
        self.exchanges += 1
        self.sent = heard.sent
        if self.first_sent is None:
            self.first_sent = heard.sent
        text = question.text_in(heard.data)
        if text is None:
            return (yield from self._gather(question, heard))
        self._note_time(heard.now, question.wire_s)
        return text

    def _gather(self, question: Question, heard: Heard) -> Steps[str]:
        """The answer out of whatever comes: in pieces, among garbage, after frames that answer nothing."""
        until = heard.sent + self.patience_s(question)
        unanswered: StationError = AnswerTimeout(f"{question.title()}: no answer within {until - heard.sent:.3f} s")
        while heard.data:
            self.now = heard.now
            for found in self._reader.feed(heard.data):
                if isinstance(found, Corrupt):
                    raise AnswerCorrupt(f"{question.title()}: wrong check byte in {found.raw.hex(' ')}")
                data = self._match(question, found)
                if data is not None:
                    self._note_time(heard.now, self.line.seconds(len(question.frame) + len(found.encode())))
                    return data
                unanswered = AnswerFormat(f"{question.title()}: answered by {found.header}{found.text}, which is no answer to it")
            heard = yield Listen(until)
        self.now = heard.now
        self._is_overdue = True
        self._reader.reset()
        raise unanswered

    def _match(self, question: Question, frame: Frame) -> str | None:
        """The data of `frame` if it answers `question`, None if it answers nothing; refusals and bad data raise."""
        if frame.header in "RW":
            self.strays["echo"] += 1
            return None
        if not self._addresses_fit(frame):
            self.strays["address"] += 1
            return None
        if frame.header == "N":
            self._refused(question, frame)
            return None
        data = frame.text[len(question.code) :]
        if not frame.text.startswith(question.code) or self._is_another_kind(question, data):
            self.strays["code"] += 1
            return None
        if question.digits in (None, len(data)):
            return data
        raise AnswerFormat(f"{question.title()}: {len(data)} characters of data in A{frame.text}")

    @staticmethod
    def _is_another_kind(question: Question, data: str) -> bool:
        """An acknowledgement for a read, a value for a write, or ATT1ddddd for RTT (digest A.12, B-10)."""
        wanted = question.digits
        return (wanted == 0) != (not data) or (wanted == 5 and len(data) == 6)

    def _addresses_fit(self, frame: Frame) -> bool:
        """Either order names this station (digest B-6); the check byte cannot tell them apart."""
        if frame.source is None or self.address is None:
            return frame.source is None and self.address is None
        ordered = (self.address, self.host_address)
        pair = (frame.source, frame.target)
        if pair == ordered[::-1] and self._answer_from_station:
            self._answer_from_station = False
            self._questions.clear()
        return pair in (ordered, ordered[::-1])

    def _refused(self, question: Question, frame: Frame) -> None:
        """Raise what an N frame says; one with another code answers something else, unless nothing can be read in it."""
        code, digits = frame.text[:-5], frame.text[-5:]
        if not digits.isdigit():
            raise AnswerFormat(f"{question.title()}: N{frame.text} carries no error number")
        number = int(digits)
        if code not in ("", question.code) and number not in (1, 2):
            self.strays["code"] += 1
            return
        self._settled()
        meaning = COMMUNICATION_ERRORS.get(number, "unknown communication error")
        raise REFUSALS.get(number, Refusal)(number, f"{question.title()}: refused with N {number:05d}, {meaning}")

    def _note_time(self, now: float, wire_s: float) -> None:
        self.now = self.heard = now
        self._settled()
        took = max(now - self.sent - wire_s, 0.0)
        seen = self.turnaround_s
        if seen is None or took > seen:
            self.turnaround_s = took
        else:
            self.turnaround_s = seen * 0.999 + took * 0.001  # forget a single late answer slowly

    def _settled(self) -> None:
        """The station has answered: answers come in the order of questions, so none to an earlier one is under way."""
        self._doubted.clear()
        self._is_overdue = False

    def _drain(self) -> Steps[None]:
        """Listen until the line has been quiet long enough for any late answer to have come."""
        quiet = max(QUIET_S, self.turnaround_s or 0.0) + self.line.seconds(4)
        end = self.now + 50 * quiet  # a line that never falls silent makes the next question fail
        while self.now < end:
            heard = yield Listen(self.now + quiet)
            self.now = heard.now
            if not heard.data:
                break
            self.strays["late"] += 1
            self._reader.feed(heard.data)
        self._reader.reset()
