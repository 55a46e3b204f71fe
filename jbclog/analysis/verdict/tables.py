"""The events and settings of a sealed run, as far as a verdict looks at them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from jbclog.core.foreign.tables import open_table


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
