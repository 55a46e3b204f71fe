"""What a scan tries, and its results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from jbclog.core.errors import LinkError, LinkFlooded
from jbclog.core.serial_line import BAUDRATES, LineFormat
from jbclog.protocol.commands.family import ROBOT, Family


@dataclass(frozen=True, slots=True)
class ScanFinding:
    """A problem and the step that fixes it. `kind` is a dotted word for programs; `where` is a
    port, station, folder or machine.
    """

    kind: str
    where: str
    what: str
    step: str


ADDRESSES: tuple[int | None, ...] = (1, None, 10)
"""Addresses to try: the usual 01, then none, then 10 (docs/reference/contradictions.md, B-7,
B-8).
"""

ANSWER_S = 0.3  # response time allowed for (docs/reference/contradictions.md, B-13)
OMEGA_ANSWER_S = 0.4  # 003, 11.1 prints 0.25 s (docs/reference/contradictions.md, B-47)
OMEGA_ASKED = 2  # times; the first one, right after JBC's requests, may get lost
# a station in its binary protocol sends unasked; no manual prints how often
BINARY_LISTEN_S = 1.3
OPENING_S = 0.3  # for closing and opening a port
# for reading the identity: 26 requests, and some repeats, at the slowest known response time
LEARNING_S = 9.0
EXCHANGE = 28  # characters of a request and the longest answer to it


@dataclass(frozen=True, slots=True)
class Trial:
    """One line format. `listens_s`: time to listen before the first request."""

    line: LineFormat
    asks_omega: bool = False
    listens_s: float = 0.0

    def seconds(self, addresses: Sequence[int | None]) -> float:
        """Return the time that it takes without any answer."""
        questions = len(addresses) * (ANSWER_S + self.line.seconds(EXCHANGE))
        return (
            OPENING_S
            + self.listens_s
            + questions
            + (OMEGA_ASKED * OMEGA_ANSWER_S if self.asks_omega else 0.0)
        )


USUAL: tuple[Trial, ...] = (
    # the newer units, whose format is fixed (002 and 004, "Physical Layer")
    Trial(LineFormat(19200, "8N1")),
    Trial(LineFormat(19200, "8E1")),  # the example for the older units (000, 2)
    # OMEGA's only one (003, 11.1; docs/reference/contradictions.md, B-46)
    Trial(LineFormat(9600, "8N1"), asks_omega=True),
    Trial(LineFormat(250000, "8E1"), listens_s=BINARY_LISTEN_S),
    Trial(LineFormat(500000, "8N1"), listens_s=BINARY_LISTEN_S),
    *(Trial(LineFormat(rate, "8N1")) for rate in (38400, 57600, 115200)),
    *(Trial(LineFormat(rate, "8E1")) for rate in (9600, 38400, 57600, 115200)),
)

_ALL = [
    LineFormat(rate, f"8{parity}{stops}")
    for stops in "12"
    for parity in "NEO"
    for rate in reversed(BAUDRATES)
]

THOROUGH: tuple[Trial, ...] = (
    *USUAL,
    *(Trial(line) for line in _ALL if line not in {trial.line for trial in USUAL}),
)
"""Every line format of the older stations' menu (000, 2.1): twelve rates, three parities, one or
two stop bits.
"""

BY_SERVER: tuple[Trial, ...] = (Trial(LineFormat(), asks_omega=True, listens_s=BINARY_LISTEN_S),)
"""For a port whose line format is set elsewhere: in the server of a socket:// URL."""


@dataclass(frozen=True, slots=True)
class ScanPlan:
    """What to try on one port at most, and for how long. The first station that answers ends the
    scan.
    """

    trials: tuple[Trial, ...] = USUAL
    addresses: tuple[int | None, ...] = ADDRESSES
    limit_s: float | None = None

    @property
    def seconds(self) -> float:
        """Time after which no further line format is tried."""
        needed = sum(trial.seconds(self.addresses) for trial in self.trials) + LEARNING_S
        return needed if self.limit_s is None else self.limit_s


def plan_for(
    url: str,
    *,
    thorough: bool = False,
    addresses: tuple[int | None, ...] = ADDRESSES,
    limit_s: float | None,
) -> ScanPlan:
    """Return what to try at `url`."""
    usual = THOROUGH if thorough else USUAL
    return ScanPlan(BY_SERVER if url.startswith("socket:") else usual, addresses, limit_s)


@dataclass(frozen=True, slots=True)
class Turnaround:
    """The station's response time in ms, from `answered` of `asked` harmless reads; never below 0.

    `faster` describes answers that arrived sooner than the stated line format allows.
    """

    median_ms: float
    p99_ms: float
    answered: int
    asked: int
    faster: str | None = None


@dataclass(slots=True)
class StationFound:
    """A station that answers. `address` None: without addresses. Other fields are None if unknown.

    `robot_mode` is False after a refusal with N 00005, else None: a station may answer reads and
    refuse writes, so only the first write shows it. `tools` maps the ports that answer to their
    tools' names (``none``: empty port; None: unknown). `not_answered` lists commands that every
    station of its family has, but not this one. `refusal` is its refusal of the model request,
    `trouble` why its scan was aborted; `contradicts`: its answers differed each time.
    """

    line: LineFormat
    address: int | None
    family: Family | None = None
    model: str | None = None
    software: str | None = None
    robot_mode: bool | None = None
    refusal: str | None = None
    error: str | None = None
    tool_names: dict[int, str | None] = field(default_factory=dict)
    turnaround: Turnaround | None = None
    trouble: str | None = None
    not_answered: tuple[str, ...] = ()
    contradicts: bool = False

    @property
    def is_drivable(self) -> bool:
        """True if a run could start with it."""
        return self.family is not None and self.robot_mode is not False and self.trouble is None

    @property
    def has_robot_mode(self) -> bool:
        """True for a JBC station, which has Robot mode and may have an address; also if its family
        is unknown.
        """
        return self.family is None or self.family.protocol == ROBOT

    @property
    def addressing(self) -> str:
        """Address for messages: ``address 01``, ``without addresses``."""
        return "without addresses" if self.address is None else f"address {self.address:02d}"


@dataclass(slots=True)
class PortReport:
    """The scan of one port, filled in as it proceeds: who answers, other bytes, and the requests
    sent.

    `echoed`: a request came back unchanged. `binary`: the line format at which JBC's binary
    protocol was received. `asked`: the addresses tried. `flood`: far more bytes arrived than
    answers have. `garbage`: at most `MOST_KEPT` bytes for each line format that were no answer.
    `sent` counts each request at each format.
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
