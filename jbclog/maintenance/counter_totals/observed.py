"""What an audit reads of a station, and the properties of each kind of counter.

Times are UTC as ISO 8601 with ``+00:00``. `seq` and `prev_sha256` are the ledger's and set when a line is added.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Literal

import msgspec

# -- traits -------------------------------------------------------------------------------------------------------------------
# What is known of each kind of counter: how finely it counts, where it rolls over, and how fast it can plausibly go.
#
# Counters are five digits wide, decimal, and hexadecimal for the dispensed length (docs/reference/contradictions.md, B-35).
# No manual prints what comes
# after the last number; that it is zero is supposed, and said of every difference that rests on it. The fastest plausible pace
# is this program's own supposition, too: it only decides how many roll-overs are thinkable while nobody looked.

FIVE_DIGITS: Final = 100_000.0
HEX_DIGITS: Final = 5
DRIFT: Final = 1.01  # by which a station's clock may differ from ours
LEAST_MODULUS: Final = 16.0**HEX_DIGITS / 10


@dataclass(frozen=True, slots=True)
class Trait:
    """`step`: two readings that differ by d stand for d - step to d + step. `fastest`: an hour of `hours`, the counters of time
    that it goes with, the first that there is; none of them: of time on the wall."""

    step: float
    fastest: float
    hours: tuple[str, ...] = ()

    @property
    def is_time(self) -> bool:
        return not self.hours


HOURS: Final = Trait(step=1.0, fastest=DRIFT)
TRAITS: Final = {
    "sleep_cycles": Trait(0.0, 60.0, ("plugged_h", "on_h")),
    "desolder_cycles": Trait(0.0, 600.0, ("work_h",)),
    "dispensed_cycles": Trait(0.0, 2000.0, ("work_h",)),
    "dispensed_mm": Trait(0.1, 4000.0, ("work_h",)),
    "tool_cycles": Trait(0.0, 60.0, ("on_h",)),
    "suction_cycles": Trait(0.0, 600.0, ("on_h",)),
}


def trait_of(counter: str) -> Trait:
    """Hours unless the table knows better."""
    return TRAITS.get(counter, HOURS)


def modulus_of(counter: str, shown: Iterable[float]) -> float:
    """What the counter goes on from zero after; of a length that showed more than five digits, the next width that holds it."""
    if counter != "dispensed_mm":
        return FIVE_DIGITS
    modulus, most = LEAST_MODULUS, max(shown, default=0.0)
    while most >= modulus:
        modulus *= 16
    return modulus


# -- observed -----------------------------------------------------------------------------------------------------------------


class Standing(StrEnum):
    """How far a count can be believed."""

    OK = "ok"
    MOVING = "moving"  # two of at most three reads never agreed
    UNREAD = "unread"


class Count(msgspec.Struct, frozen=True, gc=False):  # a ledger has hundreds of thousands; a dataclass takes six times as long
    """A counter of a port as it was read. Names and units are those of the table `counters`.

    `value` is null unless `standing` is ``ok``; `values` are all that were read, the first of them first; `why` says, where it
    is ``unread``, what came instead (`timeout`, `nak4`, ...).
    """

    port: int
    counter: str
    unit: str
    value: float | None
    standing: Standing = Standing.OK
    values: tuple[float, ...] = ()
    why: str = ""


@dataclass(frozen=True, slots=True)
class Identity:
    """What a station says that it is. No manual prints a serial number; `uid` is for what the line file or people give."""

    family: str
    model: str | None = None
    software: str | None = None
    uid: str | None = None


@dataclass(frozen=True, slots=True)
class Errors:
    """The station's error and its ports' as they were read now (null: not read), and how many events of each kind since last time.

    `events` are from the records of runs, by kind (``port.error``, ``station.error``, ...); null where no record tells. They are
    counted up to `until`, from which on the next audit counts; null where no records were looked at.
    """

    station: str | None = None
    ports: dict[int, str] = field(default_factory=dict)
    events: dict[str, int] | None = None
    until: str | None = None


@dataclass(frozen=True, slots=True)
class StationLook:
    """One look at one station, without its counters. `time`: when they were read; `audit`: when that audit began.

    A station that did not answer is an observation too: `seen` is false, `why` says what came of it, and nothing else is known.
    `source` is ``wire`` or ``run:FOLDER``. `parameters` are settings by name, of one port as ``2.sleep_delay_min``, with their
    values as the table `settings` shows them. `tools` are the tools by port.
    """

    time: str
    audit: str
    line: str
    station: str
    url: str
    seen: bool
    why: str = ""
    source: str = "wire"
    identity: Identity | None = None
    tools: dict[int, str] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    errors: Errors = field(default_factory=Errors)
    seq: int = 0
    prev_sha256: str = ""
    kind: Literal["observation"] = "observation"


@dataclass(frozen=True, slots=True)
class Observation(StationLook):
    """One look at one station, with its counters."""

    counts: tuple[Count, ...] = ()


@dataclass(frozen=True, slots=True)
class Fact:
    """What somebody says was done at `time`, and told the ledger at `told` (`jbclog maintenance done`).

    `task` is a name from the tasks file, or one of `STATED`. `part` is the tip's or other part's
    number; `port` null is all of them.
    """

    time: str
    told: str
    by: str
    line: str
    station: str
    task: str
    port: int | None = None
    part: str = ""
    text: str = ""
    seq: int = 0
    prev_sha256: str = ""
    kind: Literal["fact"] = "fact"


Entry = Observation | Fact
