"""What an audit saw of a station, and what people told it: the two kinds of lines that the ledger has.

Times are UTC as ISO 8601 with ``+00:00``. `seq` and `prev_sha256` are the ledger's and set when a line is added.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum


class Standing(StrEnum):
    """How far a count can be believed."""

    OK = "ok"
    MOVING = "moving"  # two of at most three reads never agreed
    UNREAD = "unread"


@dataclass(slots=True)  # never changed; a frozen one takes three times as long to make, and a ledger has hundreds of thousands
class Count:
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
class Observation:
    """One look at one station. `time` is when its counters were read, `audit` when the audit that looked began.

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
    counts: tuple[Count, ...] = ()
    tools: dict[int, str] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    errors: Errors = field(default_factory=Errors)
    seq: int = 0
    prev_sha256: str = ""
    kind: str = "observation"


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
    kind: str = "fact"


Entry = Observation | Fact
