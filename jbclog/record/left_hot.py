"""Tools of which nobody knows whether they were made safe, when a run was cut off.

Recorder and guard both died, there was no guard, or it could not write down what it did. That is told as what it is:
not known. The lease that is still open says which tools are meant, and so does what the sessions last handed over.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import json_of
from jbclog.core.foreign.tables import open_table
from jbclog.core.rows import EventRow, Severity, StationFacts
from jbclog.record import guard_actions
from jbclog.record.parts import part_paths

KIND: Final = "safety.not_known"
NO_GUARD: Final = "none"  # what the manifest says then
TOOK_OVER: Final = ("guard.took_over", "guard.left_over")
RUNNING: Final = "running"
COLUMNS: Final = ["time", "station", "port", "temperature_c", "status"]


@dataclass(frozen=True, slots=True)
class Lease:
    """What of a station nobody has made safe, as its lease says."""

    ports: tuple[int, ...] = ()
    feeds: bool = False


class Unknown(NamedTuple):
    """A tool, or with `port` None a feeder, of which nothing more is known, and the sentence for people."""

    station: str
    port: int | None
    text: str
    celsius: float | None


@dataclass(slots=True)
class Last:
    """The last that was read of a tool: UTC microseconds, °C, and the status where that was read too."""

    time: int
    celsius: float
    status: str | None


def leases(folder: Path) -> dict[str, Lease]:
    """The lease that is open in the folder, as far as it can be read."""
    return _lease(folder)[0]


def unreadable_lease(folder: Path) -> str:
    """Why the lease in the folder, or a part of it, cannot be read; empty where it can be, or there is none."""
    return _lease(folder)[1]


def _lease(folder: Path) -> tuple[dict[str, Lease], str]:
    found: dict[str, Lease] = {}
    try:
        lines = read_foreign(folder / guard_actions.LEASE, Kind.LEASE).splitlines()
    except FileNotFoundError:
        return found, ""
    except (OSError, ValueError) as error:
        return found, str(error)
    wrong = ""
    for number, line in enumerate(lines, 1):
        try:
            told = json_of(line)
            found[str(told["name"])] = Lease(tuple(int(port) for port in told.get("ports", ())), bool(told.get("feeds")))
        except (ValueError, KeyError, TypeError, AttributeError):
            wrong = f"line {number} is no lease of a station"
    return found, wrong


def warning(folder: Path, unsafe: Collection[str] = ()) -> str:
    """The sentence for people about the stations that may still be hot, `unsafe` among them; empty where there are none."""
    names, why = ", ".join(sorted({*leases(folder), *unsafe})), unreadable_lease(folder)
    told = []
    if names:
        told.append(f"Tools of {names} may still be hot: nobody is known to have made them safe.")
    if why:
        told.append(f"{guard_actions.LEASE} cannot be read ({why}): which tools of this run may still be hot is not known.")
    return " ".join([*told, "`jbclog safe` makes them safe, as does a new run on their ports."]) if told else ""


def unknown(folder: Path, stations: list[StationFacts], guard: str | None) -> list[Unknown]:
    """All of them; `stations` are the facts with what the guard reached in them, `guard` what the manifest says of it."""
    places = [*_places(folder, stations)]
    last = _last_read(folder, {place for place in places if place[1] is not None}) if places else {}
    return [_told(place, last.get(place), guard) for place in places]


def _places(folder: Path, stations: list[StationFacts]) -> Iterator[tuple[str, int | None]]:
    held, why = _lease(folder)
    was_taken_over = any(event.kind in TOOK_OVER for event in guard_actions.action_log(folder))
    for facts in stations:
        lease, goes_on = held.get(facts.name, Lease()), facts.outcome == RUNNING and facts.asked_safe_state != ""
        ports = {*lease.ports, *(facts.touched if goes_on or why else ())}
        yield from ((facts.name, port) for port in sorted(ports - facts.safe_state.keys()))
        if lease.feeds or ((goes_on or why) and facts.may_feed and not was_taken_over):
            yield facts.name, None


def _told(place: tuple[str, int | None], last: Last | None, guard: str | None) -> Unknown:
    what = "the feeder was stopped" if place[1] is None else "the tool was made safe"
    why = (
        "the recorder ended, and there was no guard"
        if guard == NO_GUARD
        else "recorder and guard ended, or could not write it down"
    )
    text = f"Whether {what} is not known: {why}."
    if place[1] is not None:
        text += f" {_seen(last)}; it may be hot."
    return Unknown(*place, text, last.celsius if last else None)


def _seen(last: Last | None) -> str:
    if last is None:
        return "It was never read"
    moment = datetime.fromtimestamp(last.time / 1_000_000, UTC)
    status = f", {last.status}" if last.status else ""
    return f"Last read {last.celsius:g} °C{status} at {moment:%H:%M:%S} UTC"


def _last_read(folder: Path, places: set[tuple[str, int | None]]) -> dict[tuple[str, int | None], Last]:
    """From the end of the samples backwards, until each was found."""
    found: dict[tuple[str, int | None], Last] = {}
    for path in reversed(part_paths(folder, "samples")):
        with open_table(path) as file:
            for index in reversed(range(file.num_row_groups)):
                group = file.group(index, COLUMNS)
                for place in places - found.keys():
                    last = _last_in(group, *place)
                    if last is not None:
                        found[place] = last
                if places == found.keys():
                    return found
    return found


def _last_in(group: pa.Table, station: str, port: int | None) -> Last | None:
    mine = pc.and_(pc.equal(group["station"], station), pc.equal(group["port"], port))
    read = group.filter(pc.and_(mine, pc.is_valid(group["temperature_c"])))
    if not len(read):
        return None
    row = read.slice(len(read) - 1).set_column(0, "time", read["time"].slice(len(read) - 1).cast(pa.int64())).to_pylist()[0]
    return Last(row["time"], row["temperature_c"], row["status"])


# -- in the record ---------------------------------------------------------------------------------------------------------


def events(found: list[Unknown], time: int) -> list[EventRow]:
    """An event each, at `time`: the last moment that the record knows of."""
    return [EventRow(time, KIND, Severity.CRITICAL, one.text, one.station, one.port, value=one.celsius) for one in found]


def with_unknown(stations: list[StationFacts], found: list[Unknown]) -> list[StationFacts]:
    """The facts with these sentences among what is not safe."""
    texts: dict[str, list[str]] = {}
    for one in found:
        place = one.station if one.port is None else f"{one.station} port {one.port}"
        texts.setdefault(one.station, []).append(f"{place}: {one.text}")
    return [replace(facts, unsafe=[*facts.unsafe, *_new(facts, texts.get(facts.name, []))]) for facts in stations]


def _new(facts: StationFacts, texts: list[str]) -> list[str]:
    return [text for text in texts if text not in facts.unsafe]
