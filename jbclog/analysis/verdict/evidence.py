"""The evidence of a verdict: data about the run collected by the caller, and its tables of events
and settings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pyarrow as pa

from jbclog.analysis.verdict.reached import Targets
from jbclog.core.goal import Goal
from jbclog.core.rows import StationFacts, TipCheck
from jbclog.record.part_file import open_part

ROWS_AT_ONCE: Final = 8192  # as an object a row takes up to a kilobyte
EVENT_COLUMNS: Final = ["kind", "severity", "station", "port", "text", "time", "value"]


@dataclass(frozen=True, slots=True)
class Recovery:
    """Recovery of one joint: the time in s until the tip was back, or for which it was observed
    without being back.

    `back`: True if the tip was back before the next joint, False if the next joint came first, None
    if the record, the tool's work or the setpoint ended before that.
    """

    seconds: float
    back: bool | None


@dataclass(frozen=True, slots=True)
class Feeds:
    """Joints found and feeds counted (R-DC) between two readings of the feeder's counter.

    - `at_edges`: how many of `found` may lie outside, because they are close to one of these
      readings
    - `beyond`: how many more may lie inside: found closely outside, or begun where the rows end
    - `lost_s`: time of the readings missing in gaps, in which no joint can be found
    - `counted`: None if the counter does not show it, for the reason in `why`
    """

    found: int
    at_edges: int
    beyond: int
    counted: int | None
    lost_s: float = 0.0
    why: str = ""


@dataclass(frozen=True, slots=True)
class PortJoints:
    """The joints of one port: the recovery of each, oldest first; None if not known.

    `feeds`: None for a tool without a feeder. `why`: the reason if joints, or some of them, are not
    known. `hidden`: how many more there may be in the `unseen_s` seconds of work that were not
    read.
    """

    recoveries: Sequence[Recovery | None] = ()
    feeds: Feeds | None = None
    why: str | None = None
    hidden: int = 0
    unseen_s: float = 0.0


def joints_not_known(why: str, *, are_some: bool) -> str:
    """Return the sentence that joints, or not all of them, are known; `why` is a sentence."""
    which = "Not all joints are" if are_some else "Joints are not"
    return f"{which} known: {why[:1].lower()}{why[1:]}"


def not_read(seconds: float) -> str:
    """Return the sentence that there may be joints in so much work of which nothing was read."""
    return f"Joints in {seconds:.1f} s of work that was not read are not known."


Joints = Mapping[tuple[str, int], PortJoints]
"""Station and port -> joints."""

PortLedger = Mapping[str, Mapping[str, int]]
"""signal -> {"due": n, "ok": n, reason: n ...}."""

Ledger = Mapping[str, Mapping[str, PortLedger]]
"""station -> port (as text, as in the manifest) -> `PortLedger`."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """A sealed run: `folder` holds `samples/`, `events/` and `settings/`.

    - `exit_status`: the manifest's; ``lost`` if a crash ended the run and its end is missing
    - `lost`: a sentence on what else the record lacks
    - `verifications`: those valid for its ports when it began
    - `joints`: of each port whose recipe limits them
    - `goals`: numbers of units and joints at which the run was to end
    - `targets`: what each station's recipe requires of its tools
    """

    folder: Path
    stations: Sequence[StationFacts]
    ledger: Ledger
    exit_status: str | None = "success"
    lost: str | None = None
    verifications: Sequence[TipCheck] = ()
    joints: Joints = field(default_factory=dict)
    goals: Sequence[Goal] = ()
    targets: Mapping[str, Targets] = field(default_factory=dict)

    def port_ledger(self, station: str, port: int) -> PortLedger:
        """Return the accounting of one port; empty if nothing was ever due."""
        return self.ledger.get(station, {}).get(str(port), {})


@dataclass(frozen=True, slots=True)
class Event:
    """The fields of an event that a verdict needs. `time` is UTC in µs."""

    kind: str
    severity: str
    station: str | None
    port: int | None
    text: str
    time: int | None
    value: float | None


def read_events(folder: Path) -> list[Event]:
    """Return all events of the run, oldest first."""
    return [
        Event(
            str(row["kind"]),
            str(row["severity"]),
            _text(row["station"]),
            _number(row["port"]),
            str(row["text"]),
            _number(row["time"]),
            _figure(row["value"]),
        )
        for row in _rows(folder / "events", EVENT_COLUMNS)
    ]


@dataclass(slots=True)
class Outcomes:
    """The number of a station's settings with each outcome, and the settings of its recipe that it
    does not have.

    Leaves out settings that were only read or written again, and those of the recipe for other
    families.
    """

    counts: Counter[str] = field(default_factory=Counter)
    lacking: list[str] = field(default_factory=list)


def read_outcomes(folder: Path) -> dict[str, Outcomes]:
    """Return the outcomes of each station's settings."""
    found: dict[str, Outcomes] = {}
    for row in _rows(folder / "settings", ["station", "setting", "requested", "outcome"]):
        outcomes, outcome = found.setdefault(str(row["station"]), Outcomes()), str(row["outcome"])
        is_of_other_families = row["requested"] is None
        if outcome not in ("read", "repeated", "unsupported"):
            outcomes.counts[outcome] += 1
        elif outcome == "unsupported" and not is_of_other_families:
            outcomes.lacking.append(str(row["setting"]))
    return found


def read_ordered(folder: Path) -> set[tuple[str, int]]:
    """Return the stations and ports whose tools were ordered into a status at the start."""
    rows = _rows(folder / "settings", ["station", "port", "setting", "requested"])
    return {
        (str(row["station"]), port)
        for row in rows
        if row["setting"] == "status"
        and row["requested"] is not None
        and isinstance(port := row["port"], int)
    }


def read_adjustments(folder: Path) -> dict[tuple[str, int], float]:
    """Return the last adjustment in °C of each station and port, as read back; left out without
    one.
    """
    found: dict[tuple[str, int], float] = {}
    for row in _rows(folder / "settings", ["station", "port", "setting", "readback"]):
        port, readback = row["port"], row["readback"]
        if row["setting"] == "adjust" and isinstance(port, int) and isinstance(readback, str):
            with suppress(ValueError):
                found[str(row["station"]), port] = float(readback)
    return found


def _rows(table: Path, columns: list[str]) -> Iterator[dict[str, object]]:
    for part in sorted(table.glob("part-*.parquet")):
        with open_part(part) as opened:
            for batch in opened.batches(ROWS_AT_ONCE, columns):
                yield from _with_whole_time(batch).to_pylist()


def _with_whole_time(rows: pa.RecordBatch) -> pa.RecordBatch:
    """Return the rows with `time` in µs: pyarrow makes no datetime where the system has no time
    zones, as in a small container.
    """
    place = rows.schema.get_field_index("time")
    return rows if place < 0 else rows.set_column(place, "time", rows[place].cast(pa.int64()))


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _number(value: object) -> int | None:
    return value if isinstance(value, int) else None


def _figure(value: object) -> float | None:
    return value if isinstance(value, float) else None
