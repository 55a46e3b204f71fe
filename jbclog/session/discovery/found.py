"""What a scan has found: the station behind a port, or what came where there is none."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from jbclog.core.errors import LinkError, LinkFlooded
from jbclog.core.line_format import LineFormat
from jbclog.protocol.commands.family import ROBOT, Family
from jbclog.session.discovery.trials import ADDRESSES


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
