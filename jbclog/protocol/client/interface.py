"""The interface of a station's client, independent of its protocol; flood detection; counts of
anomalies.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple, Protocol

from jbclog.core.errors import LinkFlooded
from jbclog.core.io_requests import IoResult, wait
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command

# A flood is far more bytes on a link than the answers that are due. The rules:
#
# 1. A link is flooded if more than `MOST_TIMES` the bytes of the due answers arrive in one second,
#    whatever its baud rate. At least `LEAST_DUE` bytes a second count as due. A second begins with
#    the first bytes after the last one; if no bytes are reported for longer, as while a session
#    waits, the rule applies to that whole time. Late answers stay due, because a station or a
#    server that was stuck may send them all at once.
# 2. In a flood any answer may be a copy of an old one. So once more than `SUSPECT` bytes and more
#    than `MOST_TIMES` the due bytes have arrived, no answer is accepted, even before the second is
#    over.
# 3. A flooded link is quiet again if less than a flood arrives within `QUIET_S` of reopening it
#    (`expect_quiet`).
#
# Only bytes and times count, so a replayed run behaves the same.

SECOND: Final = 1.0
MOST_TIMES: Final = 10
LEAST_DUE: Final = 16  # bytes a second: one usual answer
SUSPECT: Final = 512  # bytes; more than a burst of noise
QUIET_S: Final = 0.25


class FloodDetector:
    """Detects floods on one link. `is_flooded`: the last complete second was a flood.

    Before `quiet_until` bytes that are due cannot be part of a flood. An answer of exactly the due
    bytes is then only added to `in_order`.
    """

    __slots__ = (
        "_begun",
        "_came",
        "_due",
        "_late",
        "found",
        "in_order",
        "is_flooded",
        "quiet_until",
    )

    def __init__(self) -> None:
        self.is_flooded = False
        self._restart()

    def _restart(self) -> None:
        self.found: LinkFlooded | None = None  # a flood not raised yet
        self._begun: float | None = None
        self._came = self._due = self._late = self.in_order = 0
        self.quiet_until = -inf

    def came(self, now: float, size: int, due: int = 0) -> bool:
        """Count `size` bytes received at `now` (monotonic seconds) for a request with an answer of
        `due` bytes; return True if no answer among them may be accepted.
        """
        if size == due and now < self.quiet_until:
            self.in_order += size
            return False
        came = self._came + size + self.in_order
        due += self._due + self.in_order
        self._came = came
        self._due = due
        self.in_order = 0
        if now < self.quiet_until and came <= due:
            return False
        begun = self._begun
        if begun is None:
            self._begun = begun = now
        elif now - begun >= SECOND:
            self._judge(now - begun)
            self._begin(now)
            begun = now
        is_usual = self.found is None and self._came <= MOST_TIMES * self._due + self._late
        self.quiet_until = begun + SECOND if is_usual else -inf
        return self._came > SUSPECT and not is_usual

    @property
    def is_suspect(self) -> bool:
        """True if too much has arrived in the current second to accept any answer."""
        return (
            self._came > max(SUSPECT, MOST_TIMES * self._due + self._late) or self.found is not None
        )

    def taken(self) -> LinkFlooded:
        """Return the flood to raise, and start counting again."""
        found = self.found
        assert found is not None
        self._restart()
        return found

    def expect_none(self) -> None:
        """Raise a flood that was found."""
        if self.found is not None:
            raise self.taken()

    def calm(self) -> None:
        """Start counting again: the link has been reopened and is quiet."""
        self.is_flooded = False
        self._restart()

    def _judge(self, seconds: float) -> None:
        limit = MOST_TIMES * max(self._due, round(LEAST_DUE * seconds)) + self._late
        self.is_flooded = self._came > limit
        if self.is_flooded:
            self.found = LinkFlooded(self._came, self._due, seconds, limit)

    def _begin(self, now: float) -> None:
        self._begun, self._late = now, max(0, self._late + self._due - self._came)
        self._came = self._due = 0


async def expect_quiet(client: Client) -> None:
    """Listen on a reopened link that was flooded. Raises `LinkFlooded` if it still is."""
    began = client.now
    heard = await wait(began + QUIET_S)
    client.unasked(heard)
    seconds = max(heard.now - began, QUIET_S)
    limit = round(MOST_TIMES * LEAST_DUE * seconds)
    client.flow.calm()
    if len(heard.data) > limit:
        client.flow.is_flooded = True
        raise LinkFlooded(len(heard.data), 0, seconds, limit)


# Anomalies are answers that depart from the recommended form and are accepted
# (docs/reference/contradictions.md).


@dataclass(frozen=True, slots=True)
class Anomaly:
    """The first anomaly of its kind. `number` is the B-number, `place` names the request, `raw` is
    the answer.
    """

    number: int
    place: str
    raw: str
    port: int | None = None


class Anomalies:
    """Anomalies of one station: `counts` by B-number, `pending` those not reported yet."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()
        self.pending: list[Anomaly] = []
        self._reported: set[int] = set()

    def meet(
        self, number: int, place: str, raw: str, port: int | None = None, *, times: int = 1
    ) -> None:
        """Count an anomaly `times` times; add the first of its kind to `pending`."""
        self.counts[number] += times
        if number not in self._reported:
            self._reported.add(number)
            self.pending.append(Anomaly(number, place, raw, port))

    def take(self) -> list[Anomaly]:
        """Return the anomalies not reported yet, and clear them."""
        pending, self.pending = self.pending, []
        return pending


Permit = Callable[[Command, Value, int | None, int | None], None]
"""Called before each write with command, value, port and tool; raises `WriteForbidden` to prevent
it.
"""


def permit_all(_command: Command, _value: Value, _port: int | None, _tool: int | None) -> None:
    """Permit every write."""


class Contradiction(NamedTuple):
    """An answer to a read of `command`, accepted at `heard`, after which another one arrived that
    differs.
    """

    command: Command
    heard: float


def ignore_end(_is_answered: bool) -> None:
    """Do nothing at the end of an exchange."""


def ignore_interruption() -> None:
    """Do nothing while an answer is awaited."""


class PreparedRead(Protocol):
    """A read prepared once and sent often; opaque except for its command, duration and name."""

    @property
    def command(self) -> Command: ...

    @property
    def wire_s(self) -> float: ...

    def title(self) -> str:
        """Name for messages: ``tip temperature of port 1``."""


class Client(Protocol):
    """A client of one station, as coroutines without I/O (`core.io_requests`).

    Times are monotonic seconds. `sent` and `heard`: the last request was sent, its answer complete.
    `now`: time of the last result. `first_sent`: `ask` first sent something since the session set
    it to None. `data`: raw data field of the last answer that has one. `strays` counts frames
    without a request, by kind; `anomalies` accepted deviations from the recommended form. `permit`
    is called before each write. `flow` detects floods: reads raise `LinkFlooded`. `ended` is called
    when an exchange has ended, with False if nothing came, while `heard` and `data` are still those
    of the last one. Once anything has come, no further answer to the last one is looked for.
    `contradicted` is the last
    accepted answer if another one contradicts it. If a request would wait for its answer beyond
    `interrupt_at` (inf: never), `interrupt` is called then, once, and the waiting continues; an
    OMEGA may answer later than that, and its client does not interrupt.
    """

    permit: Permit

    now: float
    sent: float
    heard: float
    first_sent: float | None
    exchanges: int
    data: str
    strays: Counter[str]
    anomalies: Anomalies
    flow: FloodDetector
    ended: Callable[[bool], None]
    interrupt_at: float
    interrupt: Callable[[], None]
    contradicted: Contradiction | None

    @property
    def garbage_bytes(self) -> int:
        """Bytes outside of any frame."""

    def question(
        self, command: Command, port: int | None = None, tool: int | None = None
    ) -> PreparedRead:
        """Prepare a read of `command`."""

    async def read(
        self, command: Command, port: int | None = None, tool: int | None = None
    ) -> Value:
        """Read a value. Raises `StationError` if no try succeeds, `StationSilent` if the station is
        silent.
        """

    async def ask(self, question: PreparedRead) -> Value:
        """Read a value by a prepared read of this client. Raises as `read` does."""

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

        Repeats a setting that the station did not understand, unless `once`. Raises whatever
        `permit` raises, before sending anything.
        """

    def unasked(self, heard: IoResult) -> None:
        """Register bytes received without a request, and their time."""
