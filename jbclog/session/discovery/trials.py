"""What is tried on a port, in which order, and how long that may take: data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from jbclog.core.line_format import BAUDRATES, LineFormat

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
