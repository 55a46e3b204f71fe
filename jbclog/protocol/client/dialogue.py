"""One request to a JBC station in Robot mode, and the rules for accepting an answer.

1. One request is outstanding at a time. An answer is accepted only if check byte, addresses,
   header, code, length and digits match the pending request; every other frame is counted and
   dropped.
2. After a frame with a wrong check byte the answer may still follow. But a corrupt frame as long as
   the answer was the answer, so the client only waits for bytes already on their way.
3. Answers carry no sequence number, so a late one looks like a fresh one. Codes whose answers may
   be on their way are in doubt until the station answers anything else; `robot.py` handles that.
4. Other forms are accepted where the manuals contradict each other, and counted
   (`protocol/commands/decisions.toml`). A form that another answer could have is accepted only
   while nothing is in doubt, and never right after the request that it would properly answer.
5. If a second, different answer to the last question arrives before the next exchange has ended,
   one of the two is another question's: the first is noted in `contradicted`. That holds only if
   no answer to the same question asked before can be on its way, so not after a lost answer.
6. The time-out follows from the number of bytes, the line format and the response times of reads
   seen on this station, up to `MOST_S`. A write gets longer: storing may be slow, and no manual
   prints how slow (docs/reference/contradictions.md, B-13).

Everything that waits is a coroutine without I/O (`core.io_requests`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from math import inf

from jbclog.core.errors import (
    AnswerContradicted,
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
)
from jbclog.core.io_requests import Ask, IoResult, ask, do, listen
from jbclog.core.serial_line import LineFormat
from jbclog.protocol.client.interface import (
    Anomalies,
    Contradiction,
    FloodDetector,
    ignore_end,
    ignore_interruption,
)
from jbclog.protocol.client.question import Question, known_answers
from jbclog.protocol.commands.command import Command, Effect, Scope
from jbclog.protocol.commands.error_tables import COMMUNICATION_ERRORS
from jbclog.protocol.commands.ranges import (
    ACKNOWLEDGED_WITH_VALUE,
    READ_ANSWERED_AS,
    WRITE_ANSWERED_AS,
)
from jbclog.protocol.frame import CorruptFrame, Frame, FrameReader

REPEATS = 2  # a read is sent three times at most
# response time assumed before the first measurement (docs/reference/contradictions.md, B-13)
UNMEASURED_S = 0.3
LEAST_S = 0.1  # minimum allowance: a busy host may need that long to pass bytes on
FAST_S = LEAST_S / 4  # up to this response time the minimum allowance is enough
SETTING_S = 1.0  # minimum for a write: a setting, a tool's state
# minimum for a write that erases, stores, restarts, moves or changes the address
STORING_S = 2.0
MOST_S = 2.0  # maximum: a station that slows down must not stretch every time-out
QUIET_S = 0.02  # silence after which a link counts as drained
MOST_DOUBTED = 64  # requests whose answers may still arrive; no station queues more
UNEXPECTED_LENGTH = 20  # characters assumed for the time-out if the answer's length is not printed

REFUSALS: dict[int, type[Refusal]] = {
    1: NotReceived,
    2: NotReceived,
    3: OutOfRange,
    4: NotSupported,
    5: RobotModeOff,
    6: ModelUnknown,
}

Pair = tuple[int | None, int | None]
"""Source and target address of a frame; both None if it has none."""


class AnsweredByOtherCode(AnswerFormat):
    """The answer has the letters of another command, as from some stations; `data` is its data
    field.
    """

    def __init__(self, text: str, data: str) -> None:
        super().__init__(text)
        self.data = data


def least_s(command: Command) -> float:
    """Return the minimum response time allowed for a write of `command`, in seconds."""
    is_stored = command.effect in (Effect.ERASES, Effect.MOVES) or command.name == "address"
    return STORING_S if is_stored else SETTING_S


class Dialogue:
    """Exchanges with one station, and the state needed to match its answers. `robot.Station` is the
    public subclass.
    """

    # Python shares the keys of 30 attributes at most; beyond that only slots are fast
    __slots__ = (
        "_answer_from_station",
        "_answered",
        "_doubted",
        "_failure",
        "_has_tail",
        "_is_clear",
        "_is_only_one",
        "_is_overdue",
        "_last",
        "_lost",
        "_moving",
        "_pending",
        "_questions",
        "_reader",
        "_until",
        "address",
        "anomalies",
        "contradicted",
        "data",
        "ended",
        "exchanges",
        "first_sent",
        "flow",
        "heard",
        "host_address",
        "interrupt",
        "interrupt_at",
        "line",
        "now",
        "sent",
        "strays",
        "turnaround_s",
    )

    def __init__(self, line: LineFormat, address: int | None, host_address: int) -> None:
        self.line = line
        self.address = address
        self.host_address = host_address
        self.sent = 0.0
        self.first_sent: float | None = None
        self.heard = 0.0
        self.now = 0.0
        self.data = ""
        self.exchanges = 0  # requests sent
        self.turnaround_s: float | None = None  # longest recent response time
        self.strays: Counter[str] = Counter()
        self.anomalies = Anomalies()
        self.flow = FloodDetector()
        self.contradicted: Contradiction | None = None
        self.ended: Callable[[bool], None] = ignore_end
        self.interrupt_at = inf
        self.interrupt: Callable[[], None] = ignore_interruption
        self._reader = FrameReader()
        # codes of requests whose answers may be on their way, oldest first
        self._doubted: list[str] = []
        self._is_clear = True  # nothing was in doubt when the pending request was sent
        # only the pending request can be answered with its code
        self._is_only_one = True
        self._lost: set[str] = set()  # codes whose last request got no answer
        # the last answered read, while another answer to it contradicts the first
        self._answered: Question | None = None
        self._has_tail = False  # the reader holds what may be the beginning of that
        self._pending = self._last = ""  # codes of the pending request and of the previous one
        self._is_overdue = False  # the last request timed out
        self._until = 0.0  # until when the pending request waits for bytes
        self._failure: StationError | None = None  # what came instead of its answer
        # order of addresses in answers, as learnt (docs/reference/contradictions.md, B-6)
        self._answer_from_station = True
        # addresses that may acknowledge the pending change of address
        self._moving: tuple[Pair, ...] = ()
        self._questions: dict[tuple[str, int | None, int | None], Question] = {}

    def question(
        self, command: Command, port: int | None = None, tool: int | None = None
    ) -> Question:
        """Prepare a read of `command`; cached."""
        key = (command.name, port, tool)
        known = self._questions.get(key)
        if known is None:
            known = self._questions[key] = self._make(command, "R", port, tool)
        return known

    def _make(
        self, command: Command, header: str, port: int | None, tool: int | None, data: str = ""
    ) -> Question:
        """Build a request: a read, whose `data` can only be padding, or a write of `data`."""
        code = command.code(port, tool)
        is_write = header == "W"
        digits = 0 if is_write else command.answer_digits
        frame = self._frame(header, code + data, sending=True)
        start = self._frame("A", code, sending=not self._answer_from_station)[:-2]
        length = len(start) + (UNEXPECTED_LENGTH if digits is None else digits) + 2
        wire_s = self.line.seconds(len(frame) + length)
        answers, decoded = known_answers(frame, command, start)
        question = Question(
            command=command,
            port=port,
            frame=frame,
            code=code,
            digits=digits,
            answer_start=start,
            answer_length=length,
            wire_s=wire_s,
            usual=Ask(frame, wire_s + LEAST_S),
            tries=1 if is_write or command.sent_once else 1 + REPEATS,
            is_short=command.scope is Scope.STATION and len(code) == 2,
            answers=answers,
            decoded=decoded,
        )
        answered_as = (WRITE_ANSWERED_AS if is_write else READ_ANSWERED_AS).get(command.name)
        if answered_as is not None:
            question.also_number, letters = answered_as
            question.also = f"{letters}{port}"
        if is_write:
            question.is_write = True
            question.least_s = least_s(command)
            question.repeated = data if command.name in ACKNOWLEDGED_WITH_VALUE else ""
        return question

    def _frame(self, header: str, text: str, *, sending: bool) -> bytes:
        if self.address is None:
            return Frame(header, text).encode()
        source, target = (
            (self.host_address, self.address) if sending else (self.address, self.host_address)
        )
        return Frame(header, text, source, target).encode()

    def patience_s(self, question: Question) -> float:
        """Return the time-out of a request, from the moment it is sent.

        It is short for a write in a flood: no acknowledgement can be found, and other tools wait
        for their orders.
        """
        if question.is_write and (self.flow.is_flooded or self.flow.is_suspect):
            return question.wire_s + LEAST_S
        seen = self.turnaround_s
        from_reads = UNMEASURED_S if seen is None else min(max(LEAST_S, 4 * seen), MOST_S)
        return question.wire_s + max(from_reads, question.least_s)

    def _begin(self, question: Question) -> Ask:
        """Register `question` as pending and return its request. On a flooded link only writes
        pass; a read raises.
        """
        if self.flow.found is not None and not question.is_write:
            raise self.flow.taken()
        if self._reader.held and not self._has_tail:
            self._reader.reset()  # earlier bytes cannot be the answer
        self._has_tail = False
        code = question.code
        doubted = self._doubted
        self._is_only_one = code not in doubted and code not in self._lost
        self._is_clear = not doubted
        self._last = self._pending
        self._pending = code
        doubted.append(code)  # until this or a later request is answered
        if len(doubted) > MOST_DOUBTED:
            del doubted[0]
        self._failure = None
        seen = self.turnaround_s
        if seen is not None and seen <= FAST_S and not question.is_write:
            return question.usual
        return Ask(question.frame, self.patience_s(question))

    async def _exchange(self, question: Question) -> str:
        """Send a request and return the data field of its answer, which is looked for in everything
        that arrives in time: in pieces, in garbage, behind other frames.
        """
        request = self._begin(question)
        patience_s = request.patience_s
        if self.now + patience_s <= self.interrupt_at:
            heard = await do(request)
        else:
            heard = await self._perform_interrupted(request)
        # reading a field of a NamedTuple costs more than all of them at once
        now, chunk, sent, _ = heard
        self.exchanges += 1
        self.sent = sent
        if self.first_sent is None:
            self.first_sent = sent
        reader = self._reader
        flow = self.flow
        end = sent + patience_s
        self._until = end
        is_suspect = flow.came(now, len(chunk), question.answer_length)
        try:
            while chunk:
                received = reader.held + chunk
                data = question.answers.get(received)
                if data is not None and now < flow.quiet_until:
                    # nearly always: just an answer that was accepted before
                    if reader.held:
                        reader.forget()
                    self._note_answer(now, question, question.wire_s, data)
                    return data
                if flow.found is not None:
                    self.now = now
                    raise flow.taken()
                data = self._search(question, now, chunk, is_suspect=is_suspect)
                if data is not None:
                    question.remember(received, data)
                    return data
                self.now = now
                now, chunk, _, _ = await listen(self._until)
                is_suspect = flow.came(now, len(chunk))
            self._is_overdue = self._until == end
            reader.reset()
            raise self._failure or AnswerTimeout(
                f"{question.title()}: no answer within {patience_s:.3f} s"
            )
        except StationError as error:
            self.now = now
            self._note_failure(question, error)
            raise

    async def _perform_interrupted(self, request: Ask) -> IoResult:
        """Perform a request, and interrupt the waiting at `interrupt_at`, even if no answer has
        come yet.
        """
        result = await ask(request.data, max(self.interrupt_at - self.now, 0.0))
        end = result.sent + request.patience_s
        if result.data or result.now >= end:
            return result
        self.interrupt_at = inf
        self.interrupt()
        rest = await listen(end)
        return rest._replace(sent=result.sent)

    def _search(
        self, question: Question, now: float, chunk: bytes, *, is_suspect: bool
    ) -> str | None:
        """Return the data field if `chunk`, received at `now`, completes the answer; else note what
        came instead.
        """
        frames = iter(self._reader.feed(chunk))
        for frame in frames:
            if is_suspect:
                self.strays["flood"] += 1
                self._failure = AnswerFormat(
                    f"{question.title()}: far more came than an answer, and none of it is believed"
                )
                continue
            if isinstance(frame, CorruptFrame):
                self._failure = AnswerCorrupt(
                    f"{question.title()}: wrong check byte in {frame.raw.hex(' ')}"
                )
                if question.digits is None or len(frame.raw) >= question.answer_length:
                    # it was the answer
                    rest_s = QUIET_S + self.line.seconds(question.answer_length)
                    self._until = min(self._until, now + rest_s)
                continue
            answer = self._match(question, frame)
            if answer is None:
                self._compare(frame)
                if not isinstance(self._failure, AnswerCorrupt):
                    self._failure = AnswerFormat(
                        f"{question.title()}: answered by {self._why_no_answer(frame)}"
                    )
                continue
            wire_s = self.line.seconds(len(question.frame) + len(frame.encode()))
            self._note_answer(now, question, wire_s, answer)
            self._look_behind(frames)
            if self.contradicted is not None:
                self.contradicted = None
                raise AnswerContradicted(
                    f"{question.title()}: another answer came right behind A{frame.text}"
                )
            return answer
        return None

    def _why_no_answer(self, frame: Frame) -> str:
        """Describe a frame that is not the answer, with its address if it is another station's."""
        description = f"{frame.header}{frame.text}"
        pair = (frame.source, frame.target)
        own = (self.address, self.host_address)
        expected = [(None, None)] if self.address is None else [own, own[::-1], *self._moving]
        if pair in expected:
            return f"{description}, which is no answer to it"
        if frame.source is None:
            return f"{description} without an address, not from address {self.address:02d}"
        other = next((address for address in pair if address not in own), frame.source)
        asked = "though no address is used" if self.address is None else f"not {self.address:02d}"
        return f"{description} from address {other:02d}, {asked}"

    def _rest_of(self, question: Question, corrupt: CorruptFrame, end: float) -> float:
        """Return until when to listen after a corrupt frame (monotonic seconds): if it is as long
        as the answer, it was the answer.
        """
        if question.digits is not None and len(corrupt.raw) < question.answer_length:
            return end
        return self.now + QUIET_S + self.line.seconds(question.answer_length)

    def _match(self, question: Question, frame: Frame) -> str | None:
        """Return the data if `frame` answers `question`, else None. Raises for refusals and invalid
        data.
        """
        if frame.header in "RW":
            self.strays["echo"] += 1
            return None
        if not self._addresses_fit(question, frame):
            self.strays["address"] += 1
            return None
        if frame.header == "N":
            self._refused(question, frame)
            return None
        data = self._data_in(question, frame.text)
        if data is None:
            self.strays["code"] += 1
        elif question.digits not in (None, len(data)):
            raise AnswerFormat(
                f"{question.title()}: {len(data)} characters of data in A{frame.text}"
            )
        return data

    def _data_in(self, question: Question, text: str) -> str | None:
        """Return the data field of an answer to `question`; None if it answers another command."""
        if text.startswith(question.code):
            data = text[len(question.code) :]
            return (
                self._acknowledgement(question, data)
                if question.digits == 0
                else self._value(question, data)
            )
        if (
            question.also
            and text.startswith(question.also)
            and self._is_clear
            and self._last != question.also
        ):
            self._accept_other_letters(question, text)
            return ""
        return None

    def _acknowledgement(self, question: Question, data: str) -> str | None:
        """Accept an acknowledgement without data, or with the written value
        (docs/reference/contradictions.md, B-43).
        """
        if data and data == question.repeated and self._is_clear:
            self._note_anomaly(ACKNOWLEDGED_WITH_VALUE[question.command.name], question, data)
            return ""
        return None if data else ""

    def _value(self, question: Question, data: str) -> str | None:
        """Return the value's data; None if it answers another command. No data is an
        acknowledgement; six characters are ATT1ddddd for RTT, or ATT0ddddd.

        See docs/reference/protocol.md, Similar codes, and docs/reference/contradictions.md, B-10.
        """
        if question.is_short and len(data) == 6 and data[0] in " 0":
            self._note_anomaly(10, question, data)
            return data[1:]
        return None if not data or (question.digits == 5 and len(data) == 6) else data

    def _accept_other_letters(self, question: Question, text: str) -> None:
        """Handle an answer with another command's letters: it acknowledges a write, but gives no
        value.

        See docs/reference/contradictions.md, B-36 and B-53.
        """
        data = text[len(question.also) :]
        if question.digits:
            raise AnsweredByOtherCode(f"{question.title()}: answered by A{text}", data)
        if data:
            raise AnswerFormat(
                f"{question.title()}: answered by A{text}, which is no acknowledgement"
            )
        self._note_anomaly(question.also_number, question, text)

    def _note_anomaly(self, number: int, question: Question, raw: str) -> None:
        """Count an odd form by its B-number (docs/reference/contradictions.md)."""
        self.anomalies.meet(number, question.title(), raw, question.port)

    def _addresses_fit(self, question: Question, frame: Frame) -> bool:
        """Return True if the addresses, in either order, are this station's. The check byte is the
        same for both orders (B-6).
        """
        pair = (frame.source, frame.target)
        ordered = (self.address, None if self.address is None else self.host_address)
        if pair == ordered:
            return True
        if pair == ordered[::-1]:
            if self._answer_from_station:
                self._answer_from_station = False
                self._questions.clear()
                raw = f"{frame.source:02d}{frame.target:02d}{frame.header}{frame.text}"
                # counted in `_note_answer`, once for each accepted answer
                self.anomalies.meet(6, question.title(), raw, times=0)
            return True
        if pair in self._moving:
            self._note_anomaly(9, question, f"{pair}{frame.header}{frame.text}")
            return True
        return False

    def _refused(self, question: Question, frame: Frame) -> None:
        """Raise the error of an N frame. Ignores one with another code, unless the station did not
        understand its request.
        """
        # R-TT's code may have a blank as third character
        code, digits = frame.text[:-5].rstrip(), frame.text[-5:]
        if not digits.isdigit():
            raise AnswerFormat(f"{question.title()}: N{frame.text} carries no error number")
        number = int(digits)
        if code not in ("", question.code) and number not in (1, 2):
            self.strays["code"] += 1
            return
        if not code:
            self._note_anomaly(11, question, f"N{frame.text}")
        if number == 255:
            self._note_anomaly(54, question, f"N{frame.text}")
        self._settled()
        meaning = COMMUNICATION_ERRORS.get(number, "unknown communication error")
        raise REFUSALS.get(number, Refusal)(
            number, f"{question.title()}: refused with N {number:05d}, {meaning}"
        )

    def _note_answer(self, now: float, question: Question, wire_s: float, data: str) -> None:
        """Register a complete answer at `now`. Only reads count for the response time."""
        self.ended(True)
        self.contradicted = None
        self.now = self.heard = now
        self._settled()
        if not self._answer_from_station:
            self.anomalies.counts[6] += 1
        if question.is_write:
            self._answered = None
            return
        self.data = data
        self._answered = question if self._is_only_one else None
        if self._lost:
            self._lost.discard(question.code)
        took = now - self.sent - wire_s
        seen = self.turnaround_s
        if took < 0.0:
            took = 0.0
        if seen is not None and took <= seen:
            took = seen * 0.999 + took * 0.001  # let the effect of a late answer decay slowly
        self.turnaround_s = took

    def _note_failure(self, question: Question, error: StationError) -> None:
        """Register the end of an exchange without an answer."""
        is_silent = isinstance(error, AnswerTimeout)
        self.ended(not is_silent)
        if not is_silent:
            self._answered = None
        if not isinstance(error, Refusal | AnswerContradicted):
            self._lost.add(question.code)

    def _look_behind(self, frames: Iterable[Frame | CorruptFrame]) -> None:
        """Compare the frames that nobody asked for, behind an answer or without a request."""
        for frame in frames:
            if isinstance(frame, Frame):
                self._compare(frame)
        self._has_tail = bool(self._reader.held)

    def _compare(self, frame: Frame) -> None:
        """Note a contradiction if `frame` is another answer to the last answered read."""
        question = self._answered
        pair = (frame.source, frame.target)
        own = (self.address, None if self.address is None else self.host_address)
        if question is None or self.flow.is_suspect or pair not in (own, own[::-1]):
            return
        if _is_other_answer(question, frame, self.data):
            self.contradicted = Contradiction(question.command, self.heard)
            self._answered = None

    def _settled(self) -> None:
        """Clear earlier doubts: answers come in the order of requests, so none to an earlier
        request is on its way.

        If the pending code is in doubt more than once, the answer may be to an earlier request.
        """
        doubted = self._doubted
        if len(doubted) > 1:
            del doubted[: doubted.index(self._pending) + 1]
            self._is_overdue = bool(doubted)
        else:
            doubted.clear()
            self._is_overdue = False

    async def _drain(self) -> None:
        """Listen until the link has been quiet long enough for any late answer."""
        quiet = max(QUIET_S, self.turnaround_s or 0.0) + self.line.seconds(4)
        # on a link that is never quiet the next request fails
        end = self.now + min(50 * quiet, 2 * MOST_S)
        while self.now < end:
            heard = await listen(self.now + quiet)
            self.now = heard.now
            self.flow.came(heard.now, len(heard.data))
            if not heard.data:
                break
            self.flow.expect_none()
            self.strays["late"] += 1
            self._look_behind(self._reader.feed(heard.data))
        self._reader.reset()


def _is_other_answer(question: Question, frame: Frame, data: str) -> bool:
    """Return True if `frame` is a valid answer to `question`, and not the one with `data`."""
    if frame.header == "N":
        return frame.text[:-5] == question.code and frame.text[-5:].isdigit()
    if frame.header != "A" or not frame.text.startswith(question.code):
        return False
    other = frame.text[len(question.code) :]
    if question.is_short and len(other) == 6 and other[0] in " 0":
        other = other[1:]  # as `_value` accepts it
    if not other or question.digits not in (None, len(other)):
        return False
    decode = question.command.quantity.decode
    try:
        return decode(other) != decode(data)
    except ValueError:
        return False
