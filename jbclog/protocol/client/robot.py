"""The client of one JBC station in Robot mode: what is asked again, what never is, and which answers need a second look.

The rules:

1. A read is asked again at most `REPEATS` times. What clears, moves or erases something is sent once
   (docs/reference/faults.md, F-2 and F-39), and so is every write: whether it took is a matter of
   reading back. Only N 1 and N 2 prove that a write was not done, so a setting that they refuse is sent again, unless its sender
   does that himself; N 99999 is asked again once.
2. After a question without its answer the line is drained and a probe with another code must be answered before the same
   code is asked again (docs/reference/faults.md, F-5).
3. R-DC may be answered as ACD, and ACD is R-CD's answer (docs/reference/contradictions.md, B-36). A late or
   repeated ACD must never become a count of
   dispensed cycles. So ACD is taken only while no answer at all may be under way, not right behind R-CD, only from a
   station that never said ADC, and only when it says the same again after a drained line and a probe.
4. W-HD may be acknowledged as ALD (docs/reference/contradictions.md, B-53) under the first two of these
   conditions; its proof is the reading back.

How one answer is told from all else on the line is in `dialogue.py`. Everything here is a generator that does no I/O.
"""

from __future__ import annotations

from itertools import cycle, islice

from jbclog.core.errors import (
    AnswerCorrupt,
    AnswerFormat,
    AnswerTimeout,
    NotReceived,
    NotSupported,
    OutOfRange,
    Refusal,
    StationError,
    StationSilent,
)
from jbclog.core.io_requests import Heard, Steps
from jbclog.core.quantities import Value
from jbclog.core.wire import LineFormat
from jbclog.protocol.client.dialogue import LEAST_S, REPEATS, AnsweredOtherwise, Dialogue, Pair, Question
from jbclog.protocol.client.interface import Asking, Permit, anything
from jbclog.protocol.commands.command import Command, Effect
from jbclog.protocol.commands.ranges import WITHOUT_DATA
from jbclog.protocol.commands.robot import COMMON

PROBES = 2  # questions a silent station gets before it counts as silent
MOST_ROUNDS = 3  # of these, beside one for each earlier question, where it does answer and may be answering what was asked before
PROBE_COMMANDS = [command for command in COMMON if command.name in ("model", "station_error", "maximum_temperature")]
BADLY_FORMED, UNDEFINED = 2, 99999  # communication errors
EXTRACTOR_ORDER = ("status", "00010")  # which some stations may refuse (docs/reference/contradictions.md, B-19)

UNCERTAIN = (AnswerTimeout, AnswerCorrupt, AnswerFormat)
"""After these an answer may still be under way: what came may have been noise, an echo or an answer to something else."""


class Station(Dialogue):
    """A station on a line. `address` is None on a line without addresses.

    `sent` and `heard` are the moments (monotonic seconds) at which the last question left and its answer was whole; `now` is
    the last moment that anything was heard of, or not.
    `data` is the data field of the last answer to a read, as it came. `strays` counts by kind what was on the line and
    answered nothing, `anomalies` what was taken although it is not as recommended.
    """

    def __init__(self, line: LineFormat, address: int | None = 1, host_address: int = 0) -> None:
        super().__init__(line, address, host_address)
        self.data = ""
        self.permit: Permit = anything
        self._padded: Question | None = None  # R-TT with a blank, once the station wanted it
        self._takes_bare = False  # R-TT without one was answered
        self._own_code: set[str] = set()  # codes that were answered under their own letters
        self._without_data: set[str] = set()  # orders that this station takes without data only

    @property
    def garbage_bytes(self) -> int:
        """Bytes that belonged to no frame."""
        return self._reader.garbage

    def read(self, command: Command, port: int | None = None, tool: int | None = None) -> Steps[Value]:
        """Read a value. Raises `StationError` when no try gave one; `StationSilent` when nothing answers any more."""
        return self.ask(self.question(command, port, tool))

    def ask(self, question: Asking) -> Steps[Value]:
        """The same with a question that this client made before; the path of every sample."""
        assert isinstance(question, Question)
        return self._ask_short(question) if question.is_short else self._ask(question)

    def _ask(self, question: Question) -> Steps[Value]:
        tries, said = question.tries, None
        while True:
            tries -= 1
            if question.code in self._doubted:
                yield from self._settle(question)
            try:
                self.data = text = yield from self._exchange(question)
                value = question.value_of(text)
            except ValueError as error:  # a whole answer to this question, so nothing is under way
                failure: StationError = AnswerFormat(f"{question.title()}: {error}")
            except AnsweredOtherwise as error:
                if error.data == said:
                    return self._believed(question, error.data)
                said, failure = error.data, error
                self._is_overdue = True  # so that the line is drained first
            except (*UNCERTAIN, NotReceived) as error:
                failure = error
            except Refusal as error:
                if error.code != UNDEFINED or tries < REPEATS:
                    raise
                failure = error
            else:
                if question.odd or question.also:
                    self._note_form(question, text)
                return value
            if not tries:
                raise failure

    def _note_form(self, question: Question, text: str) -> None:
        """Count an odd form. Who has once answered under its own letters is not believed under others."""
        row = question.odd_row(text)
        if row is not None:
            self._meet(row, question, text)
        if question.also:
            self._own_code.add(question.code)
            question.also = ""

    def _believed(self, question: Question, data: str) -> Value:
        """What was said twice under the letters of another command."""
        self._settled()
        self.data = data
        self._meet(question.also_number, question, f"A{question.also}{data}")
        try:
            return question.value_of(data)
        except ValueError as error:
            raise AnswerFormat(f"{question.title()}: {error}") from error

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
        """Write a value. An acknowledgement is not proof: read back. In a `hurry` it is waited for as a read's answer is.

        One that the station did not understand was not done and is sent again, unless it is to go out `once`, whatever comes.
        Raises `Refusal` where the station says no, `AnswerTimeout` or another `StationError` where what it says is
        not known; then it may or may not have been done. It goes out whatever came before: it may be what stops a tool.
        """
        self.permit(command, value, port, tool)
        data = command.quantity.encode(value)
        if command.name in self._without_data:
            self.anomalies.counts[WITHOUT_DATA[command.name]] += 1
            data = ""
        self._moving = self._pairs(value) if command.name == "address" else ()
        question = self._make(command, "W", port, tool, data)
        if hurry:
            question.least_s = LEAST_S
        try:
            yield from self._write(question, again=command.effect is Effect.NONE and not once)
        except NotReceived as refusal:
            if refusal.code != BADLY_FORMED or not data or command.name not in WITHOUT_DATA:
                raise
            yield from self._write_without_data(command)
        except OutOfRange:
            if (command.name, data) == EXTRACTOR_ORDER:
                self._meet(19, question, data)
            raise
        finally:
            self._moving = ()

    def _write(self, question: Question, *, again: bool) -> Steps[None]:
        """`again`: where the station did not understand it, so that it was not done."""
        for tries_left in reversed(range(1 + REPEATS if again else 1)):
            try:
                yield from self._exchange(question)
                return
            except NotReceived:
                if not tries_left:
                    raise

    def _write_without_data(self, command: Command) -> Steps[None]:
        question = self._make(command, "W", None, None)
        yield from self._write(question, again=False)
        self._without_data.add(command.name)
        self._meet(WITHOUT_DATA[command.name], question, f"W{question.code}")

    def _pairs(self, address: Value) -> tuple[Pair, ...]:
        """The addresses beside the present ones that a change to `address` may be acknowledged under.

        docs/reference/contradictions.md, B-9.
        """
        new = address if isinstance(address, int) and address else None
        return ((None, None),) if new is None else ((None, None), (new, self.host_address), (self.host_address, new))

    def move_to(self, address: int | None) -> None:
        """Speak to the station at another address from now on; None: without addresses."""
        self.address = address
        self._questions.clear()
        self._padded = None
        self._reader.reset()
        self._doubted.clear()
        self._is_overdue = False

    def unasked(self, heard: Heard) -> None:
        """Take note of the moment, and of bytes that came although nothing was asked."""
        self.now = heard.now
        self.flow.came(heard.now, len(heard.data))
        if heard.data:
            self.strays["unasked"] += 1
            self._reader.feed(heard.data)  # and forgotten with the next question

    # -- R-TT, which has two letters where there should be three (docs/reference/contradictions.md, B-10) --------------

    def _ask_short(self, question: Question) -> Steps[Value]:
        """Bare; where that is refused or not answered, and never was, once with a blank."""
        if self._padded is not None:
            value = yield from self._ask(self._padded)
            self.anomalies.counts[10] += 1
            return value
        try:
            value = yield from self._ask(question)
        except (NotReceived, NotSupported, AnswerTimeout) as error:
            if self._takes_bare or isinstance(error, StationSilent) or getattr(error, "code", 0) == 1:
                raise
            return (yield from self._ask_padded(question, error))
        self._takes_bare = True
        return value

    def _ask_padded(self, question: Question, why: StationError) -> Steps[Value]:
        padded = self._make(question.command, "R", None, None, " ")
        padded.tries = 1
        try:
            value = yield from self._ask(padded)
        except StationSilent:
            raise
        except StationError as error:
            if isinstance(why, NotSupported):
                raise why from error
            raise NotSupported(4, f"{question.title()}: neither R{question.code} nor R{question.code} with a blank") from why
        padded.tries = question.tries
        self._padded = padded
        self._meet(10, question, f"R{question.code} ")
        return value

    # -- when an answer may still be under way -----------------------------------------------------------------------

    def _settle(self, doubted: Question) -> Steps[None]:
        """An answer to `doubted` may still come: have another code answered, on a drained line where one is overdue.

        Raises `StationSilent` where nothing answers, and where something does that cannot be believed, what it met.
        """
        failure: StationError = AnswerTimeout(f"{doubted.title()}: answers to earlier questions may still come")
        unanswered = 0  # in a row
        most = MOST_ROUNDS * PROBES + len(self._doubted)  # an answered probe may settle no more than one earlier question
        for probe in islice(cycle(self._probes(doubted.code)), most):
            if self._is_overdue:
                yield from self._drain()
            try:
                yield from self._exchange(probe)
            except Refusal:
                pass  # that, too, proves that the station has done with what was asked before
            except UNCERTAIN as error:
                failure, unanswered = error, unanswered + 1
                if unanswered == PROBES:
                    break
                continue
            unanswered = 0
            if doubted.code not in self._doubted:
                return
        if unanswered == PROBES and isinstance(failure, AnswerTimeout):
            raise StationSilent(f"no answer to {PROBES + 1} questions in a row")
        raise failure

    def _probes(self, doubted: str) -> list[Question]:
        """Harmless reads, none of which has the code in doubt, each another code than the one before."""
        return [self.question(command) for command in PROBE_COMMANDS if command.letters != doubted][:PROBES]
