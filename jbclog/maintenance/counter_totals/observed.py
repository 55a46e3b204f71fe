"""Observations of a station by an audit, and the properties of each kind of counter.

Times are UTC as ISO 8601 with ``+00:00``. `seq` and `prev_sha256` are the ledger's and set when a
line is added.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, Literal

import msgspec

# -- traits ----------------------------------------------------------------------------------------
# The resolution, modulus and fastest plausible rate of each kind of counter.
#
# Counters have five digits: decimal, hexadecimal for the dispensed length
# (docs/reference/contradictions.md, B-35). No manual prints what follows the last number; this
# program assumes zero, and states it for every difference that rests on it. The fastest plausible
# rate is an assumption, too: it only decides how many roll-overs are possible between two audits.

FIVE_DIGITS: Final = 100_000.0
HEX_DIGITS: Final = 5
DRIFT: Final = 1.01  # factor by which a station's clock may differ from the host's
LEAST_MODULUS: Final = 16.0**HEX_DIGITS / 10


@dataclass(frozen=True, slots=True)
class Trait:
    """`step`: two readings that differ by d stand for d - step to d + step. `fastest`: the greatest
    plausible advance per hour of the first existing counter in `hours`, or of elapsed time if
    `hours` is empty. `turns_often`: it passes its last number within weeks.
    """

    step: float
    fastest: float
    hours: tuple[str, ...] = ()
    turns_often: bool = False

    @property
    def is_time(self) -> bool:
        return not self.hours


HOURS: Final = Trait(step=1.0, fastest=DRIFT)
TRAITS: Final = {
    "sleep_cycles": Trait(0.0, 60.0, ("plugged_h", "on_h")),
    "desolder_cycles": Trait(0.0, 600.0, ("work_h",)),
    "dispensed_cycles": Trait(0.0, 2000.0, ("work_h",)),
    "dispensed_mm": Trait(0.1, 4000.0, ("work_h",), turns_often=True),
    "tool_cycles": Trait(0.0, 60.0, ("on_h",)),
    "suction_cycles": Trait(0.0, 600.0, ("on_h",)),
}


def trait_of(counter: str) -> Trait:
    """Return the trait in the table; else that of hours."""
    return TRAITS.get(counter, HOURS)


def modulus_of(counter: str, shown: Iterable[float]) -> float:
    """Return where the counter rolls over; for a length, at least the width that it has shown."""
    if counter != "dispensed_mm":
        return FIVE_DIGITS
    modulus, most = LEAST_MODULUS, max(shown, default=0.0)
    while most >= modulus:
        modulus *= 16
    return modulus


# -- observed --------------------------------------------------------------------------------------


class Standing(StrEnum):
    """Whether reads of a counter agreed."""

    OK = "ok"
    MOVING = "moving"  # of at most three reads, no two agreed
    UNREAD = "unread"


# a ledger has hundreds of thousands; a dataclass takes six times as long
class Count(msgspec.Struct, frozen=True, gc=False):
    """A counter of a port as read. Names and units are those of the table `counters`.

    `value` is null unless `standing` is ``ok``; `values` are all reads in order; `why` is the
    reason for ``unread`` (`timeout`, `nak4`, ...).
    """

    port: int
    counter: str
    uom: str
    value: float | None
    standing: Standing = Standing.OK
    values: tuple[float, ...] = ()
    why: str = ""


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity that a station reports. No manual prints a serial number; `uid` comes from the line
    file or from people.
    """

    family: str
    model: str | None = None
    software: str | None = None
    uid: str | None = None


@dataclass(frozen=True, slots=True)
class Errors:
    """The current error of the station and of its ports (null: not read), and the number of error
    events since the last audit.

    `events` come from the records of runs, by kind (``port.error``, ``station.error``, ...); null
    without a record. They are counted up to `until`, where the next audit starts; null if no
    records were read.
    """

    station: str | None = None
    ports: dict[int, str] = field(default_factory=dict)
    events: dict[str, int] | None = None
    until: str | None = None


@dataclass(frozen=True, slots=True)
class StationLook:
    """One look at one station, without its counters. `time`: when they were read; `audit`: when
    that audit began.

    A station that did not answer is an observation too: `seen` is false, `why` has the reason, and
    nothing else is known. `source` is ``wire`` or ``run:FOLDER``. `parameters` are settings by
    name, those of a port as ``2.sleep_delay_min``, with values as in the table `settings`. `tools`
    are the tools by port.
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
    tool_names: dict[int, str] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    errors: Errors = field(default_factory=Errors)
    seq: int = 0
    prev_sha256: str = ""
    kind: Literal["observation"] = "observation"


@dataclass(frozen=True, slots=True)
class Observation(StationLook):
    """One look at one station, with its counters."""

    counts: Sequence[Count] = ()


@dataclass(frozen=True, slots=True)
class Fact:
    """Maintenance done at `time` and recorded in the ledger at `told` (`jbclog maintenance done`).

    `task` is a name from the tasks file, or one of `STATED`. `part` is the number of the tip or
    other part; `port` null is all ports.
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
