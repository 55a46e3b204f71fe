"""The client of one JBC station in Robot mode: which requests are repeated, and which answers need
confirmation.

The rules:

1. A read is repeated at most `REPEATS` times. A command that clears, moves or erases something is
   sent once (docs/reference/faults.md, F-2 and F-39), and so is every write: reading back decides
   whether it succeeded. Only N 1 and N 2 prove that a write was not executed, so a setting refused
   by them is sent again, unless the caller does that; N 99999 and N 255 are sent again once.
2. After a request without an answer the client drains the link, and a probe with another code must
   be answered before the same code is sent again (docs/reference/faults.md, F-5).
3. R-DC may be answered as ACD, which is R-CD's answer (docs/reference/contradictions.md, B-36). A
   late or repeated ACD must never become a count of dispensed cycles. So ACD is accepted only if no
   answer can be on its way, not right after R-CD, only from a station that never sent ADC, and only
   if it comes twice, with a drained link and a probe in between.
4. W-HD may be acknowledged as ALD (docs/reference/contradictions.md, B-53) under the first two of
   these conditions; reading back proves it.

`dialogue.py` separates an answer from everything else on the link. Everything that waits is a
coroutine without I/O.
"""

from __future__ import annotations

from itertools import cycle, islice

from jbclog.core.errors import (
    AnswerContradicted,
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
from jbclog.core.io_requests import IoResult, Steps
from jbclog.core.quantities import Value
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.dialogue import (
    LEAST_S,
    REPEATS,
    AnsweredByOtherCode,
    Dialogue,
    Pair,
)
from jbclog.protocol.client.interface import Permit, PreparedRead, permit_all
from jbclog.protocol.client.question import Question
from jbclog.protocol.commands.command import Command, Effect
from jbclog.protocol.commands.error_tables import UNDEFINED_ERRORS
from jbclog.protocol.commands.ranges import WITHOUT_DATA
from jbclog.protocol.commands.robot import COMMON

PROBES = 2  # unanswered probes after which a station counts as silent
# rounds of probes, plus one for each earlier request, while the station answers but perhaps earlier
# requests
MOST_ROUNDS = 3
PROBE_COMMANDS = [
    command
    for command in COMMON
    if command.name in ("model", "station_error", "maximum_temperature")
]
BADLY_FORMED = 2  # communication error
# refused by some stations (docs/reference/contradictions.md, B-19)
EXTRACTOR_ORDER = ("status", "00010")

UNCERTAIN = (AnswerTimeout, AnswerCorrupt, AnswerFormat)
"""Errors after which an answer may still be on its way: the bytes may have been noise, an echo or
another answer.
"""


class Station(Dialogue):
    """The client of a station; for the attributes see `interface.Client`. `address` is None on a
    link without addresses.
    """

    __slots__ = ("_padded", "_takes_bare", "_without_data", "permit")

    def __init__(self, line: LineFormat, address: int | None = 1, host_address: int = 0) -> None:
        super().__init__(line, address, host_address)
        self.permit: Permit = permit_all
        self._padded: Question | None = None  # R-TT with a blank, if the station needs it
        self._takes_bare = False  # the station answered R-TT without a blank
        self._without_data: set[str] = set()  # orders that this station accepts only without data

    @property
    def garbage_bytes(self) -> int:
        return self._reader.garbage

    async def read(
        self, command: Command, port: int | None = None, tool: int | None = None
    ) -> Value:
        return await self.ask(self.question(command, port, tool))

    def ask(self, question: PreparedRead) -> Steps[Value]:
        """Read a value by a prepared read."""
        assert isinstance(question, Question)
        return self._ask_short(question) if question.is_short else self._ask(question)

    async def _ask(self, question: Question) -> Value:
        """Ask until an answer is accepted, at most `question.tries` times."""
        last_data = None
        tries_left = question.tries
        while tries_left:
            tries_left -= 1
            if question.code in self._doubted:
                await self._settle(question)
            try:
                data = await self._exchange(question)
                value, odd = question.decoded.get(data) or question.decode(data)
            except ValueError as error:  # a complete answer, so none is on its way
                failure: StationError = AnswerFormat(f"{question.title()}: {error}")
            except AnsweredByOtherCode as error:
                if error.data == last_data:
                    return self._accept_repeated(question, error.data)
                last_data = error.data
                failure = error
                self._is_overdue = True  # drain the link first
            except (*UNCERTAIN, NotReceived) as error:
                failure = error
            except Refusal as error:
                if error.code not in UNDEFINED_ERRORS or tries_left < REPEATS:  # once more
                    raise
                failure = error
            else:
                if odd is not None:
                    self._note_anomaly(odd, question, data)
                question.also = ""  # it has used its own letters: no others are accepted
                return value
            if not tries_left:
                raise failure
        raise AssertionError("no try at all")

    def _accept_repeated(self, question: Question, data: str) -> Value:
        """Accept an answer that came twice under the letters of another command."""
        self._settled()
        self.data = data
        self._note_anomaly(question.also_number, question, f"A{question.also}{data}")
        try:
            value, _ = question.decode(data)
        except ValueError as error:
            raise AnswerFormat(f"{question.title()}: {error}") from error
        return value

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
        """Write a value. An acknowledgement proves nothing: read back. With `hurry`, wait for it no
        longer than for a read.

        Repeats a write that the station did not understand, unless `once`. Raises `Refusal` if the
        station refuses, and `AnswerTimeout` or another `StationError` if the outcome is not known.
        Sends even on a flooded link, because the write may stop a tool.
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
            await self._write(question, again=command.effect is Effect.NONE and not once)
        except NotReceived as refusal:
            if refusal.code != BADLY_FORMED or not data or command.name not in WITHOUT_DATA:
                raise
            await self._write_without_data(command)
        except OutOfRange:
            if (command.name, data) == EXTRACTOR_ORDER:
                self._note_anomaly(19, question, data)
            raise
        finally:
            self._moving = ()

    async def _write(self, question: Question, *, again: bool) -> None:
        """Send a write. `again`: repeat one that was not understood, and so not executed."""
        for tries_left in reversed(range(1 + REPEATS if again else 1)):
            try:
                await self._exchange(question)
                return
            except NotReceived:
                if not tries_left:
                    raise

    async def _write_without_data(self, command: Command) -> None:
        question = self._make(command, "W", None, None)
        await self._write(question, again=False)
        self._without_data.add(command.name)
        self._note_anomaly(WITHOUT_DATA[command.name], question, f"W{question.code}")

    def _pairs(self, address: Value) -> tuple[Pair, ...]:
        """Return further addresses that may acknowledge a change to `address`
        (docs/reference/contradictions.md, B-9).
        """
        new = address if isinstance(address, int) and address else None
        return (
            ((None, None),)
            if new is None
            else ((None, None), (new, self.host_address), (self.host_address, new))
        )

    def move_to(self, address: int | None) -> None:
        """Use another address from now on; None: no addresses."""
        self.address = address
        self._questions.clear()
        self._padded = None
        self._reader.reset()
        self._doubted.clear()
        self._is_overdue = False

    def unasked(self, heard: IoResult) -> None:
        """Register bytes received without a request, and their time."""
        self.now = heard.now
        if heard.data or heard.now >= self.flow.quiet_until:
            self.flow.came(heard.now, len(heard.data))
        if heard.data:
            self.strays["unasked"] += 1
            self._look_behind(self._reader.feed(heard.data))

    async def _ask_short(self, question: Question) -> Value:
        """Send R-TT bare; if it was never answered and is refused or times out, send it with a
        blank (B-10).
        """
        if self._padded is not None:
            value = await self._ask(self._padded)
            self.anomalies.counts[10] += 1
            return value
        try:
            value = await self._ask(question)
        except (NotReceived, NotSupported, AnswerTimeout) as error:
            if (
                self._takes_bare
                or isinstance(error, StationSilent)
                or getattr(error, "code", 0) == 1
            ):
                raise
            return await self._ask_padded(question, error)
        self._takes_bare = True
        return value

    async def _ask_padded(self, question: Question, why: StationError) -> Value:
        padded = self._make(question.command, "R", None, None, " ")
        padded.tries = 1
        try:
            value = await self._ask(padded)
        except StationSilent:
            raise
        except StationError as error:
            if isinstance(why, NotSupported):
                raise why from error
            raise NotSupported(
                4, f"{question.title()}: neither R{question.code} nor R{question.code} with a blank"
            ) from why
        padded.tries = question.tries
        self._padded = padded
        self._note_anomaly(10, question, f"R{question.code} ")
        return value

    async def _settle(self, doubted: Question) -> None:
        """Ensure that no answer to `doubted` is on its way: drain the link if one is overdue, then
        get a probe answered.

        Raises `StationSilent` if the probes time out, and the last error if no answer is
        acceptable.
        """
        failure: StationError = AnswerTimeout(
            f"{doubted.title()}: answers to earlier questions may still come"
        )
        unanswered = 0  # in a row
        # each answered probe may settle just one earlier request
        most = MOST_ROUNDS * PROBES + len(self._doubted)
        for probe in islice(cycle(self._probes(doubted.code)), most):
            if self._is_overdue:
                await self._drain()
            try:
                await self._exchange(probe)
            except (Refusal, AnswerContradicted):
                pass  # they prove it as well
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
        """Return up to `PROBES` harmless reads with codes other than `doubted`."""
        return [self.question(command) for command in PROBE_COMMANDS if command.letters != doubted][
            :PROBES
        ]
