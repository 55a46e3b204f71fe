"""What a scan tries, and what it has found on a port."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from jbclog.core.errors import LinkError, LinkFlooded
from jbclog.core.serial_line import BAUDRATES, LineFormat
from jbclog.protocol.commands.family import ROBOT, Family

# -- finding ------------------------------------------------------------------------------------------------------------------
# One thing that is not as it should be: what, where, and the one step that mends it.


@dataclass(frozen=True, slots=True)
class Finding:
    """`kind` is a dotted word for programs, the rest for people. `where` is a port, a station, a folder or this machine."""

    kind: str
    where: str
    what: str
    step: str


# -- trials -------------------------------------------------------------------------------------------------------------------
# What is tried on a port, in which order, and how long that may take: data.

ADDRESSES: tuple[int | None, ...] = (1, None, 10)
"""Which station is asked: 01, the usual one, then without addresses, then 10 (docs/reference/contradictions.md, B-7, B-8)."""

ANSWER_S = 0.3  # for an answer beside its bytes (docs/reference/contradictions.md, B-13)
OMEGA_ANSWER_S = 0.4  # it may take 0.25 s (003, 11.1; docs/reference/contradictions.md, B-47)
OMEGA_ASKED = 2  # times, the first right behind JBC's questions
BINARY_LISTEN_S = 1.3  # a station in its binary protocol speaks by itself; how often, no manual says
OPENING_S = 0.3  # for closing and opening a port, and what else a host does
LEARNING_S = 9.0  # for who was found: 26 questions, and some more where one is answered otherwise, to the slowest heard of
EXCHANGE = 28  # characters of a question and the longest answer to it


@dataclass(frozen=True, slots=True)
class Trial:
    """One line format. `listens_s`: so long the port is listened to before anything is asked."""

    line: LineFormat
    asks_omega: bool = False
    listens_s: float = 0.0

    def seconds(self, addresses: Sequence[int | None]) -> float:
        """How long it takes where nothing answers."""
        questions = len(addresses) * (ANSWER_S + self.line.seconds(EXCHANGE))
        return OPENING_S + self.listens_s + questions + (OMEGA_ASKED * OMEGA_ANSWER_S if self.asks_omega else 0.0)


USUAL: tuple[Trial, ...] = (
    Trial(LineFormat(19200, "8N1")),  # the newer units, whose format is fixed (002 and 004, "Physical Layer")
    Trial(LineFormat(19200, "8E1")),  # the example of the older ones (000, 2)
    Trial(LineFormat(9600, "8N1"), asks_omega=True),  # OMEGA's only one (003, 11.1; docs/reference/contradictions.md, B-46)
    Trial(LineFormat(250000, "8E1"), listens_s=BINARY_LISTEN_S),
    Trial(LineFormat(500000, "8N1"), listens_s=BINARY_LISTEN_S),
    *(Trial(LineFormat(rate, "8N1")) for rate in (38400, 57600, 115200)),
    *(Trial(LineFormat(rate, "8E1")) for rate in (9600, 38400, 57600, 115200)),
)

_ALL = [LineFormat(rate, f"8{parity}{stops}") for stops in "12" for parity in "NEO" for rate in reversed(BAUDRATES)]

THOROUGH: tuple[Trial, ...] = (*USUAL, *(Trial(line) for line in _ALL if line not in {trial.line for trial in USUAL}))
"""Every line format of the older stations' menu (000, 2.1): twelve rates, three parities, one and two stop bits."""

BY_SERVER: tuple[Trial, ...] = (Trial(LineFormat(), asks_omega=True, listens_s=BINARY_LISTEN_S),)
"""For a port whose line format somebody else decides: the server behind socket://."""


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """What one port is asked at most, and for how long. A station that answers ends it."""

    trials: tuple[Trial, ...] = USUAL
    addresses: tuple[int | None, ...] = ADDRESSES
    limit_s: float | None = None

    @property
    def seconds(self) -> float:
        """After this long no further line format is tried."""
        needed = sum(trial.seconds(self.addresses) for trial in self.trials) + LEARNING_S
        return needed if self.limit_s is None else self.limit_s


def plan_for(url: str, *, thorough: bool = False, addresses: tuple[int | None, ...] = ADDRESSES, limit_s: float | None) -> ScanPlan:
    """What is tried at `url`."""
    usual = THOROUGH if thorough else USUAL
    return ScanPlan(BY_SERVER if url.startswith("socket:") else usual, addresses, limit_s)


# -- found --------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Turnaround:
    """How long the station itself took to answer, in ms, over `answered` of `asked` harmless reads; never below 0.

    `faster` says, where it is so, that answers came sooner than their bytes could at the stated line format.
    """

    median_ms: float
    p99_ms: float
    answered: int
    asked: int
    faster: str | None = None


@dataclass(slots=True)
class StationFound:
    """Somebody who answers. `address` None: without addresses. What is None was not told.

    `robot_mode` is False where the station has refused with N 00005, else None: that reads are answered does not show that
    writes are taken, so it is not known before the first write. `tools` are the ports that answer, each with its tool's
    name (``none``: a port without a tool; None: not told). `not_answered` are commands that every station of its family is asked,
    and that this one does not take. `refusal` is how it refused to say its model, `trouble` why it was not asked to the end, and
    `contradicts` that this was because it said something else each time.
    """

    line: LineFormat
    address: int | None
    family: Family | None = None
    model: str | None = None
    software: str | None = None
    robot_mode: bool | None = None
    refusal: str | None = None
    error: str | None = None
    tools: dict[int, str | None] = field(default_factory=dict)
    turnaround: Turnaround | None = None
    trouble: str | None = None
    not_answered: tuple[str, ...] = ()
    contradicts: bool = False

    @property
    def is_drivable(self) -> bool:
        """Whether a run could begin with it."""
        return self.family is not None and self.robot_mode is not False and self.trouble is None

    @property
    def has_robot_mode(self) -> bool:
        """Whether it is a JBC station, which has that mode and may have an address; one of no known family is."""
        return self.family is None or self.family.protocol == ROBOT

    @property
    def addressing(self) -> str:
        """``address 01``, ``without addresses``."""
        return "without addresses" if self.address is None else f"address {self.address:02d}"


@dataclass(slots=True)
class PortReport:
    """One port: who answers there, what else came, and what was sent. It fills while the scan goes on.

    `echoed`: a question came back as it was sent. `binary` is the line format at which somebody speaks JBC's other protocol.
    `asked` are the addresses that each line format is tried with.
    `flood`: far more came than answers are.
    `garbage` is what came and was no answer, at most `MOST_KEPT` bytes a line format. `sent` counts each question at each format.
    """

    url: str
    station: StationFound | None = None
    broken: LinkError | None = None
    echoed: bool = False
    binary: LineFormat | None = None
    garbage: dict[LineFormat, bytes] = field(default_factory=dict)
    tried: list[LineFormat] = field(default_factory=list)
    untried: list[LineFormat] = field(default_factory=list)
    sent: Counter[tuple[LineFormat, bytes]] = field(default_factory=Counter)
    seconds: float = 0.0
    stopped: bool = False
    flood: LinkFlooded | None = None
    asked: tuple[int | None, ...] = ADDRESSES
