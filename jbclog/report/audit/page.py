"""The page of an audit: one HTML file without links to other files. The same audit gives the same
bytes.

The template engine cleans and escapes all foreign text; drawings contain numbers only; a content
security policy forbids every request and every script.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from heapq import nlargest
from operator import attrgetter
from typing import Final

from jinja2 import Environment
from markupsafe import Markup

from jbclog import __version__
from jbclog.analysis.figures.canvas import styled
from jbclog.core.text import clean, count_text, shortened
from jbclog.maintenance.counter_totals.span import NOTHING, Interval
from jbclog.maintenance.counter_totals.totals import Difference, DifferenceKind
from jbclog.maintenance.fleet import (
    ABSENT,
    FLEET,
    TITLES,
    FleetAudit,
    Meter,
    StationAudit,
    UseFigure,
    Week,
)
from jbclog.report.audit import overview, plots
from jbclog.report.audit.overview import listed, overview_of, span
from jbclog.report.page_template import environment

# longest lists on the page, because a ledger may grow without limit; the JSON file has all
MOST_MARKS: Final = 200
MOST_OF_A_MARK: Final = 50  # counters; a port has twelve
MOST_FACTS: Final = 200
MOST_METERS: Final = 20_000  # counters of four hundred stations with four ports
MOST_TEXT: Final = 10_000  # characters, as on a terminal
SUPERSCRIPTS: Final = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
OK: Final = "ok"


@dataclass(slots=True)
class Notes:
    """Reasons why something is not known, numbered by first use."""

    texts: list[str] = field(default_factory=list)

    def sign(self, why: str) -> str:
        """Return ``–¹``: a dash and the number of the reason."""
        if not why:
            return "–"
        if why not in self.texts:
            self.texts.append(why)
        return f"–{str(self.texts.index(why) + 1).translate(SUPERSCRIPTS)}"


@dataclass(frozen=True, slots=True)
class UseRow:
    """The use of a station: its figures by name, of all ports together."""

    station: StationAudit
    figures: dict[str, UseFigure]
    notes: Notes

    def text(self, name: str, digits: int = 0) -> str:
        """Return the range of a figure as text, or the number of the reason why there is none."""
        figure = self.figures.get(name)
        if figure is None or figure.range is None:
            return self.notes.sign("not computed" if figure is None else figure.why)
        return span(figure.range, digits)

    def bound(self, name: str, digits: int = 0) -> str:
        """As `text`, for a figure that is itself a bound."""
        figure = self.figures.get(name)
        if figure is None or figure.value is None:
            return self.text(name, digits)
        return span(Interval(figure.value, figure.value), digits)

    def has(self, name: str) -> bool:
        return self.value(name) is not None

    def value(self, name: str) -> float | None:
        return self.figures[name].value if name in self.figures else None

    @property
    def shares(self) -> tuple[float, float, float] | None:
        """Worked, slept, without tool, in per cent of the time plugged in; None: one is not
        known.
        """
        work, sleep, tool = (
            self.value(name) for name in ("use_percent", "sleep_percent", "no_tool_percent")
        )
        return None if work is None or sleep is None or tool is None else (work, sleep, tool)


def use_rows(audit: FleetAudit, notes: Notes) -> list[UseRow]:
    """Return the use of each station, the most used first, those without data last."""
    rows = [
        UseRow(station, {one.name: one for one in station.use if one.port is None}, notes)
        for station in audit.stations
        if station.use or station.weeks
    ]
    return sorted(
        rows,
        key=lambda row: (
            -(row.value("work_h_a_day_365") or row.value("work_h_a_day_30") or -1),
            row.station.station,
        ),
    )


def courses(audit: FleetAudit) -> list[tuple[Week, ...]]:
    """Return the years of stations of which any week is known."""
    return [
        station.weeks for station in audit.stations if any(week.per_day for week in station.weeks)
    ]


def fleet_weeks(audit: FleetAudit) -> list[tuple[Week, int]]:
    """Return for each week the sum over the stations known in it, with their number."""
    return [_together(weeks) for weeks in zip(*courses(audit), strict=False)]


def _together(weeks: Sequence[Week]) -> tuple[Week, int]:
    known = [week.per_day for week in weeks if week.per_day is not None]
    hours = sum(known, NOTHING) if known else None
    spread = sum(week.is_spread for week in weeks)
    return Week(weeks[0].start, hours, spread > len(known) / 4), len(known)


@dataclass(frozen=True, slots=True)
class DriftRow:
    """The same drift at some stations."""

    name: str
    text: str
    stations: str
    is_fleet: bool


def drift_rows(audit: FleetAudit) -> list[DriftRow]:
    """Return the drifts, those from the fleet first; stations with the same one share a row."""
    found: dict[tuple[bool, str, str], list[str]] = {}
    for station in audit.stations:
        for drift in station.drifts:
            found.setdefault((drift.than != FLEET, drift.name, drift.text), []).append(
                station.station
            )
    rows = sorted(found.items())
    return [
        DriftRow(_setting(name), text, listed(at), not since) for (since, name, text), at in rows
    ]


def _setting(name: str) -> str:
    port, _, setting = name.rpartition(".")
    words = setting.replace("_", " ")
    return f"port {port}: {words}" if port else words


@dataclass(frozen=True, slots=True)
class CounterChange:
    """Unusual changes of counters of one port with the same interpretation, each with its unit."""

    station: str
    port: int
    start: str
    stop: str
    kind: str
    text: str
    rule: str
    is_doubtful: bool
    counters: tuple[tuple[str, Difference], ...]


def marks(audit: FleetAudit) -> list[CounterChange]:
    """Return all changes, the latest first, without certain roll-overs (`turns`)."""
    found: dict[tuple[str, int, str, str, str, str, str, bool], list[tuple[str, Difference]]] = {}
    for station in audit.stations:
        for meter in station.meters:
            for one in filter(_is_shown, meter.counter_total.marks):
                kind = one.kind.value.replace("_", "-")
                mark = (
                    station.station,
                    one.port,
                    one.start,
                    one.stop,
                    kind,
                    one.text,
                    one.rule.replace("_", " "),
                    one.is_doubtful,
                )
                found.setdefault(mark, []).append(("" if meter.uom == "count" else meter.uom, one))
    together = [CounterChange(*mark, tuple(counters)) for mark, counters in found.items()]
    return sorted(together, key=lambda one: (one.stop, one.station, one.port), reverse=True)


def _is_shown(one: Difference) -> bool:
    return one.kind is not DifferenceKind.ROLL_OVER or not one.is_known


def turns(audit: FleetAudit) -> list[tuple[StationAudit, Meter, int]]:
    """Return counters that certainly rolled over, and how often."""
    every = [
        (station, meter, [one for one in meter.counter_total.marks if not _is_shown(one)])
        for station, meter in meters(audit)
    ]
    return [(station, meter, len(over)) for station, meter, over in every if over]


def meters(audit: FleetAudit) -> Iterator[tuple[StationAudit, Meter]]:
    """Yield each counter that ever counted."""
    for station in audit.stations:
        for meter in station.meters:
            if (
                meter.counter_total.first
                or meter.counter_total.total.high > 1
                or meter.read is None
                or meter.read.value is None
            ):
                yield station, meter


def unread(audit: FleetAudit) -> Iterator[tuple[StationAudit, Meter]]:
    """Yield each counter that a station has but did not return, or of which no two reads agreed."""
    for station in audit.stations:
        for meter in station.meters:
            if meter.read is not None and meter.read.value is None and meter.read.why != ABSENT:
                yield station, meter


@dataclass(frozen=True, slots=True)
class ErrorRow:
    """An error now, or events of runs since the previous audit."""

    station: str
    port: int | None
    text: str
    is_now: bool


def error_rows(audit: FleetAudit) -> Iterator[ErrorRow]:
    """Yield errors as read, and events of runs since the previous audit."""
    for station in audit.stations:
        errors = station.errors
        if errors is None:
            continue
        if errors.station not in (None, OK):
            yield ErrorRow(station.station, None, str(errors.station), True)
        yield from (
            ErrorRow(station.station, port, text, True)
            for port, text in sorted(errors.ports.items())
            if text != OK
        )
        yield from (
            ErrorRow(station.station, None, f"{kind}: {n}", False)
            for kind, n in sorted((errors.events or {}).items())
            if n
        )


COUNTS_MOST: Final = 10  # up to this number of stations, their counters are unfolded on the page


def page_of(audit: FleetAudit) -> str:
    """Return the page of an audit as HTML; its bytes follow from `audit` alone."""
    with styled():  # once for all of its drawings
        return _rendered(audit)


def _rendered(audit: FleetAudit) -> str:
    notes = Notes()
    rows = use_rows(audit, notes)
    weeks = fleet_weeks(audit)
    every = list(meters(audit))
    return (
        _environment()
        .get_template("audit.html")
        .render(
            audit=audit,
            overview=overview_of(audit),
            uses=rows,
            most=plots.scale_of(week for row in rows for week in row.station.weeks),
            notes=notes,
            weeks=weeks,
            drawn=len(courses(audit)),
            drifts=drift_rows(audit),
            marks=marks(audit),
            most_marks=MOST_MARKS,
            most_of_a_mark=MOST_OF_A_MARK,
            facts=nlargest(MOST_FACTS, audit.facts, key=attrgetter("time")),
            meters=every[:MOST_METERS],
            more_meters=len(every) - MOST_METERS,
            turns=turns(audit),
            unread=list(unread(audit)),
            is_open=len(audit.stations) <= COUNTS_MOST,
            errors=list(error_rows(audit)),
            titles=TITLES,
            months=plots.months(audit.audit),
            bar=plots.bar,
            due=partial(plots.due, now=audit.audit),
            spent=plots.spent,
            course=plots.course,
            fleet_course=plots.fleet_course,
            SPENT=plots.SPENT,
            version=__version__,
        )
    )


def _shown(value: object) -> object:
    """Return foreign text for a template, without control characters and cut."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return clean(shortened(value, MOST_TEXT))
    return value


@cache
def _environment() -> Environment:
    made = environment("jbclog.report.audit", _shown)
    made.filters.update(span=overview.span, percent=overview.percent)
    made.filters.update(day=overview.day, of_life=overview.of_life, window=overview.window)
    made.globals.update(
        place=overview.place,
        counted=count_text,
        COUNTERS=overview.COUNTERS,
        STATES=overview.STATES,
    )
    return made
