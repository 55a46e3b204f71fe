"""What a session can ask of the client of a station, whatever its protocol, and what the client keeps count of."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from jbclog.core.errors import LinkFlooded
from jbclog.core.io_requests import Heard, Steps, Wait
from jbclog.core.quantities import Value
from jbclog.protocol.commands.command import Command

# -- flow ---------------------------------------------------------------------------------------------------------------------
# How many bytes come over a link, held against those of the answers that are due: far more of them is a flood.
#
# The rules:
#
# 1. A link is flooded when over one second more than `MOST_TIMES` the bytes of the answers that are due come over it, however fast
#    it is. Where little or nothing is due, `LEAST_DUE` bytes a second are reckoned. A second begins with the first bytes that are
#    told behind the last one; where nothing is told for longer, as while a session waits, the same holds for all of that time.
#    Answers that are late stay due: a station or a server that was stuck may give them all at once, each of them once.
# 2. Among so many bytes any answer may be a copy of an old one. So before the second is over already, from `SUSPECT` bytes on,
#    no answer is believed while more than `MOST_TIMES` of what is due has come.
#
# 3. A link that was flooded is quiet again once `QUIET_S` behind its opening have brought less than a flood does (`expect_quiet`).
#
# It knows bytes and moments only, so a run that is lived through again comes to the same.

SECOND: Final = 1.0
MOST_TIMES: Final = 10
LEAST_DUE: Final = 16  # bytes a second: one usual answer
SUSPECT: Final = 512  # bytes: more than noise brings at once
QUIET_S: Final = 0.25


class Flow:
    """The bytes of one link. `is_flooded`: the last second that was over brought a flood."""

    __slots__ = ("_begun", "_came", "_due", "_late", "found", "is_flooded")

    def __init__(self) -> None:
        self._begun: float | None = None
        self._came = self._due = self._late = 0
        self.is_flooded = False
        self.found: LinkFlooded | None = None  # a flood that nobody has been told of

    def came(self, now: float, size: int, due: int = 0) -> bool:
        """`size` bytes were told at `now` (monotonic seconds), behind a question with an answer of `due` bytes.

        Whether no answer among them is to be believed.
        """
        self._came += size
        self._due += due
        if self._begun is None:
            self._begun = now
        elif now - self._begun >= SECOND:
            self._judge(now - self._begun)
            self._begin(now)
        return self._came > SUSPECT and self.is_suspect

    @property
    def is_suspect(self) -> bool:
        """Whether so much has come since the second began that no answer is to be believed."""
        return self._came > max(SUSPECT, MOST_TIMES * self._due + self._late) or self.found is not None

    def taken(self) -> LinkFlooded:
        """The flood that was found, for whoever raises it; what comes from here on is counted anew."""
        found, self.found = self.found, None
        assert found is not None
        self._begun = None
        self._came = self._due = self._late = 0
        return found

    def calm(self) -> None:
        """The link has been opened anew, and is quiet: what came before counts no more."""
        self.is_flooded, self.found, self._begun = False, None, None
        self._came = self._due = self._late = 0

    def _judge(self, seconds: float) -> None:
        limit = MOST_TIMES * max(self._due, round(LEAST_DUE * seconds)) + self._late
        self.is_flooded = self._came > limit
        if self.is_flooded:
            self.found = LinkFlooded(self._came, self._due, seconds, limit)

    def _begin(self, now: float) -> None:
        self._begun, self._late = now, max(0, self._late + self._due - self._came)
        self._came = self._due = 0


def expect_quiet(client: Client) -> Steps[None]:
    """Ask nothing for a while on a link that was flooded and is open again. Raises `LinkFlooded` where it still is."""
    began = client.now
    heard = yield Wait(began + QUIET_S)
    client.unasked(heard)
    seconds = max(heard.now - began, QUIET_S)
    limit = round(MOST_TIMES * LEAST_DUE * seconds)
    client.flow.calm()
    if len(heard.data) > limit:
        client.flow.is_flooded = True
        raise LinkFlooded(len(heard.data), 0, seconds, limit)


# -- anomalies ----------------------------------------------------------------------------------------------------------------
# What a station does otherwise than recommended, and is taken all the same: counted, and reported once.
#
# docs/reference/contradictions.md has every form.


@dataclass(frozen=True, slots=True)
class Anomaly:
    """The first of its kind. `number` is the B-number, `place` says where it was met, `raw` is what came."""

    number: int
    place: str
    raw: str
    port: int | None = None


class Anomalies:
    """All that one station was met with: `counts` by B-number, `untold` what nobody has been told of yet."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()
        self.untold: list[Anomaly] = []
        self._told: set[int] = set()

    def meet(self, number: int, place: str, raw: str, port: int | None = None, *, times: int = 1) -> None:
        """Count it `times` times, and put the first of its kind on the list of what is to be told."""
        self.counts[number] += times
        if number not in self._told:
            self._told.add(number)
            self.untold.append(Anomaly(number, place, raw, port))

    def take(self) -> list[Anomaly]:
        """What has not been told yet; it counts as told from now on."""
        untold, self.untold = self.untold, []
        return untold


# -- interface ----------------------------------------------------------------------------------------------------------------

Permit = Callable[[Command, Value, int | None, int | None], None]
"""Asked before each write with its command, value, port and tool; raises `WriteForbidden`, and then nothing is sent."""


def anything(_command: Command, _value: Value, _port: int | None, _tool: int | None) -> None:
    """Permits every write: a person who types one has said what is meant."""


class Asking(Protocol):
    """A read made once and asked often. Who made it knows its bytes; others its name and how long it takes."""

    @property
    def command(self) -> Command: ...

    @property
    def wire_s(self) -> float: ...

    def title(self) -> str:
        """How messages name it: ``tip temperature of port 1``."""


class Client(Protocol):
    """One client of one station, as generators that do no I/O (`core.io_requests`).

    Times are monotonic seconds. `sent` and `heard` are the moments at which the last question left and its answer was
    whole; `now` is the last moment that anything was heard of, or not. `first_sent` is the first question sent since
    somebody set it to None. `data` is the data field of the last answer that carried one, as it came. `strays` counts by
    kind what was on the line and answered nothing, `anomalies` what was taken although it is not as recommended.
    `permit` is asked before each write. `flow` is what came over the link against what was due: reads raise `LinkFlooded`.
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
    flow: Flow

    @property
    def garbage_bytes(self) -> int:
        """Bytes that belonged to no frame."""

    def question(self, command: Command, port: int | None = None, tool: int | None = None) -> Asking:
        """The read of `command`, made once and kept."""

    def read(self, command: Command, port: int | None = None, tool: int | None = None) -> Steps[Value]:
        """Read a value. Raises `StationError` when no try gave one; `StationSilent` when nothing answers any more."""

    def ask(self, question: Asking) -> Steps[Value]:
        """The same with a question that this client made before."""

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

        A setting that the station did not understand was not done and is sent again, unless it is to go out `once`, whatever
        the station says. Raises what `permit` raises; then nothing is sent.
        """

    def unasked(self, heard: Heard) -> None:
        """Take note of the moment, and of bytes that came although nothing was asked."""
