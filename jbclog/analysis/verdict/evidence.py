"""What is put before the judge: tables, events, settings, joints, verifications."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.analysis.verdict.reached import Asks
from jbclog.analysis.verdict.rule import Result, Rule
from jbclog.core.foreign.tables import open_table
from jbclog.core.rows import Goal, StationFacts, TipCheck

# -- tables -------------------------------------------------------------------------------------------------------------------
# The events and settings of a sealed run, as far as a verdict looks at them.


@dataclass(frozen=True, slots=True)
class Event:
    """What a verdict needs of a row of `events`."""

    kind: str
    severity: str
    station: str | None
    port: int | None
    text: str


def read_events(folder: Path) -> list[Event]:
    """All events of the run, in their order."""
    return [
        Event(str(row["kind"]), str(row["severity"]), _word(row["station"]), _number(row["port"]), str(row["text"]))
        for row in _rows(folder / "events", ["kind", "severity", "station", "port", "text"])
    ]


@dataclass(slots=True)
class Outcomes:
    """How often each outcome stands in a station's `settings`, and the settings asked of it that it does not have.

    What was only read, what was written once more, and what the recipe has for other families, is in neither.
    """

    counts: Counter[str] = field(default_factory=Counter)
    lacking: list[str] = field(default_factory=list)


def read_outcomes(folder: Path, *, counts_lacking: bool = True) -> dict[str, Outcomes]:
    """What came of the settings, by station; `counts_lacking`: also those that a station does not have."""
    found: dict[str, Outcomes] = {}
    for row in _rows(folder / "settings", ["station", "setting", "requested", "outcome"]):
        outcomes, outcome = found.setdefault(str(row["station"]), Outcomes()), str(row["outcome"])
        if outcome not in ("read", "repeated", "unsupported"):
            outcomes.counts[outcome] += 1
        elif (
            counts_lacking and outcome == "unsupported" and row["requested"] is not None
        ):  # of other families nothing is requested here
            outcomes.lacking.append(str(row["setting"]))
    return found


def read_ordered(folder: Path) -> set[tuple[str, int]]:
    """The stations and ports whose tools were told a status at the start."""
    rows = _rows(folder / "settings", ["station", "port", "setting", "requested"])
    return {
        (str(row["station"]), port)
        for row in rows
        if row["setting"] == "status" and row["requested"] is not None and isinstance(port := row["port"], int)
    }


def read_adjustments(folder: Path) -> dict[tuple[str, int], float]:
    """The adjustment of each station and port as it was read or written last, in °C; those that were not read are not there."""
    found: dict[tuple[str, int], float] = {}
    for row in _rows(folder / "settings", ["station", "port", "setting", "readback"]):
        port, told = row["port"], row["readback"]
        if row["setting"] == "adjust" and isinstance(port, int) and isinstance(told, str):
            with suppress(ValueError):
                found[str(row["station"]), port] = float(told)
    return found


def _rows(table: Path, columns: list[str]) -> Iterator[dict[str, object]]:
    for part in sorted(table.glob("part-*.parquet")):
        with open_table(part) as opened:
            for group in opened.groups(columns):
                yield from group.to_pylist()


def _word(value: object) -> str | None:
    return None if value is None else str(value)


def _number(value: object) -> int | None:
    return value if isinstance(value, int) else None


# -- joint measures -----------------------------------------------------------------------------------------------------------
# What is put before the judge of the joints of a port: how long each recovery took, and what the feeder counted meanwhile.
#
# The joints are found from the samples, by whoever calls the judge (`analysis.joints`); what a joint is stands there.


@dataclass(frozen=True, slots=True)
class Recovery:
    """Of one joint: the time in s until the tip was back, or, where it was not seen back, the time that it had.

    `back` is True where it was back before the next joint, False where the next joint came first, None where the record, the tool's
    work or the setpoint ended before that.
    """

    seconds: float
    back: bool | None


@dataclass(frozen=True, slots=True)
class Feeds:
    """Joints found and feeds counted (R-DC) between two readings of the feeder's counter.

    `at_edges` of the `found` lie so close to one of these readings that it cannot be told on which side they are; `beyond`
    are those that lie so outside. `lost_s`: for how long there was a gap, in which no joint can be found. `counted` is None
    where the counter tells nothing, and then `why` says so.
    """

    found: int
    at_edges: int
    beyond: int
    counted: int | None
    lost_s: float = 0.0
    why: str = ""


@dataclass(frozen=True, slots=True)
class PortJoints:
    """The joints of one port, in their order: the recovery of each, None where it is not known.

    `feeds` is None for a tool without a feeder. `why` says that joints, or some of them, are not known, and why. `hidden`: how many
    more there may be in the `unseen_s` seconds of work that were not read.
    """

    recoveries: Sequence[Recovery | None] = ()
    feeds: Feeds | None = None
    why: str | None = None
    hidden: int = 0
    unseen_s: float = 0.0


def not_read(seconds: float) -> str:
    """That there may be joints that nobody could see, as a sentence."""
    return f"Joints in gaps ({seconds:.1f} s) are not known."


Joints = Mapping[tuple[str, int], PortJoints]
"""By station and port."""


# -- evidence -----------------------------------------------------------------------------------------------------------------

PortLedger = Mapping[str, Mapping[str, int]]
"""signal -> {"due": n, "ok": n, reason: n ...}."""

Ledger = Mapping[str, Mapping[str, PortLedger]]
"""station -> port (as text, as in the manifest) -> `PortLedger`."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """One run: `folder` holds `samples/`, `events/` and `settings/`, sealed.

    `exit_status` is the manifest's; ``lost`` means that a crash ended the run and its last moments are missing. `lost`
    says what else the record lacks, in a sentence. `verifications` are those that its ports stood on when it began. `joints` are
    those of each port whose recipe has a limit about them. `goals` are the numbers that the run was to end with. `asks` is what
    each station's recipe asks of its tools. `counts_lacking`: whether a setting that a station does not have is a deviation;
    release 0.1.0 said nothing of it, by what is version 1 of the rules as well.
    """

    folder: Path
    stations: Sequence[StationFacts]
    ledger: Ledger
    exit_status: str | None = "success"
    lost: str | None = None
    verifications: Sequence[TipCheck] = ()
    joints: Joints = field(default_factory=dict)
    goals: Sequence[Goal] = ()
    asks: Mapping[str, Asks] = field(default_factory=dict)
    counts_lacking: bool = True

    def port_ledger(self, station: str, port: int) -> PortLedger:
        """The ledger of one port; empty where nothing was ever due."""
        return self.ledger.get(station, {}).get(str(port), {})


# -- verified -----------------------------------------------------------------------------------------------------------------
# Whether the tip of a port was verified against an external thermometer, and how long before the run.
#
# The run carries which verification it stood on when it began (`TipCheck` in the manifest). One that failed breaks the limit; none,
# one that is too old, one of another tip, or one that was made with another adjustment than the run had is missing evidence.

RULE = "verification"
EXPIRED = "expired"
ADJUSTED = "adjusted since"


def verification_rule(facts: StationFacts, port: int, most_days: float, evidence: Evidence, adjusted_c: float | None) -> Rule:
    """The rule of one port; `most_days` is the greatest age at the run's start, `adjusted_c` the run's adjustment."""
    place = (facts.name, port)
    found = next((one for one in evidence.verifications if (one.station, one.port) == place), None)
    observed, result, text = _seen(found, most_days, adjusted_c)
    return Rule(RULE, facts.name, port, most_days, observed, "d", result, text)


def _seen(found: TipCheck | None, most_days: float, adjusted_c: float | None) -> tuple[float | str | None, Result, str]:
    if found is None or found.days is None or found.time is None:
        state = "none" if found is None else found.state
        return state, Result.MISSING, "No valid verification of its tip." if found is None else found.text
    made = f"The tip was last verified {_age(found.days)} before the run, at {found.time[:16]}Z, with {found.instrument}"
    if found.state == "fail":
        return "fail", Result.FAIL, f"{made}, and failed: {found.text}"
    if found.state != "pass":
        return found.state, Result.MISSING, found.text
    if found.adjust_c is not None and adjusted_c is not None and found.adjust_c != adjusted_c:
        text = f"{made}, with an adjustment of {found.adjust_c:g} °C; the run had {adjusted_c:g} °C, of which it says nothing."
        return ADJUSTED, Result.MISSING, text
    if found.days > most_days:
        return EXPIRED, Result.MISSING, f"{made}; that is longer ago than the {most_days:g} days that are allowed."
    return found.days, Result.PASS, f"{made}, and passed ({found.offset_c or 0.0:+.1f} °C); {most_days:g} days allowed."


def _age(days: float) -> str:
    return f"{days:.1f} days" if days >= 1 else f"{days * 24:.1f} h"
