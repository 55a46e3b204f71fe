"""How right the audit is of a simulated fleet: its odometers against the truth, its due ranges
against when it was really due.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from typing import Any, Protocol
from unittest.mock import patch

import numpy as np

from jbclog.maintenance.counter_totals.history import History
from jbclog.maintenance.counter_totals.observed import Fact, Observation
from jbclog.maintenance.counter_totals.totals import Trace
from jbclog.maintenance.counter_totals.tracing import traces_of
from jbclog.maintenance.due import foresee, used_since
from support.fleets.audit_fleet import BEGIN, YEAR, Fleet, SimStation

LIVES = {
    "work_h": (100, 700),
    "sleep_cycles": (1_500, 8_000),
    "dispensed_cycles": (30_000, 300_000),
    "dispensed_mm": (2e5, 2e6),
    "suction_cycles": (8_000, 60_000),
}
TRUTH_YEARS = 5.0
NEAR = 1e-6
FORMER = {
    "jbclog.maintenance.due": {"USUAL": 0.45, "EARLY": 1.2816, "LASTING": 0.01},
}


def history_of(station: SimStation, looks: int | None = None) -> History:
    """What the ledger would have after so many looks."""
    return History("line", station.name, station.seen[:looks], station.facts)


# -- the odometer ----------------------------------------------------------------------------------


@dataclass
class OdometerScore:
    """Differences and sums of a fleet. `wrong` are those that were called known and were not so."""

    steps: Counter[str] = field(default_factory=Counter)
    sums: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        known, flagged = self.steps["known"], self.steps["flagged"]
        return (
            f"{known + flagged} differences: {known} known, {self.steps['wrong']} of them wrong;"
            f" {flagged} flagged, {self.steps['outside']} of them outside their bounds;"
            f" {self.sums['known']} sums known, {self.sums['wrong']} of them wrong or wider than"
            f" two readings; {self.sums['flagged']} flagged, {self.sums['outside']} outside their"
            " bounds"
        )


def odometer_score(fleet: Fleet, seed: int, stations: int) -> OdometerScore:
    """Every difference and every sum of every counter of the stations."""
    score = OdometerScore()
    for number in range(stations):
        station = fleet.station(seed, number)
        for trace in traces_of(history_of(station)).now.values():
            _differences(score, station, trace)
            _sum(score, station, trace)
    return score


def _truth(station: SimStation, trace: Trace, begin: int, end: int) -> float:
    key = trace.port, trace.counter
    first, last = (station.moments[trace.points[place].look] for place in (begin, end))
    return station.true(key, last) - station.true(key, first)


def _differences(score: OdometerScore, station: SimStation, trace: Trace) -> None:
    for place, one in enumerate(trace.differences):
        truth = _truth(station, trace, place, place + 1)
        is_in = one.delta.low - NEAR <= truth <= one.delta.high + NEAR
        # of one that moved while it was read
        is_narrow = not one.is_known or one.delta.width <= 2 * trace.step + 30 + NEAR
        score.steps["known" if one.is_known else "flagged"] += 1
        if not is_in or not is_narrow:
            score.steps["wrong" if one.is_known else "outside"] += 1
        if one.is_known and not (is_in and is_narrow):
            score.wrong.append(f"{station.name} {truth} {one}")


def _sum(score: OdometerScore, station: SimStation, trace: Trace) -> None:
    odometer, last = trace.counter_total, len(trace.points) - 1
    is_in = (
        odometer.total.low - NEAR <= _truth(station, trace, 0, last) <= odometer.total.high + NEAR
    )
    score.sums["known" if odometer.is_known else "flagged"] += 1
    moved = sum(trace.points[place].shown.width for place in (0, last))
    is_narrow = not odometer.is_known or odometer.total.width <= 2 * trace.step + moved + NEAR
    if not is_in or not is_narrow:
        score.sums["wrong" if odometer.is_known else "outside"] += 1


# -- due ranges ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Foretold:
    """One forecast: when it is really due, the range that is told (hours; infinite beyond the
    horizon), that of a constant pace, and what the constants of the first release told
    (`FORMER`)."""

    due: float
    low: float
    high: float
    constant: tuple[float, float]
    former: tuple[float, float]

    @property
    def width_days(self) -> float:
        return (self.high - self.low) / 24


@dataclass
class DueScore:
    """The forecasts of a fleet. Harmful is what is due before P10: the part is worn while the page
    says that there is time.
    """

    all: list[Foretold] = field(default_factory=list)

    @property
    def held(self) -> float:
        return 1 - self.before - self.after

    @property
    def before(self) -> float:
        """The share that was due before P10."""
        return float(np.mean([one.due < one.low for one in self.all]))

    @property
    def after(self) -> float:
        """The share that was due after P90."""
        return float(np.mean([one.due > one.high for one in self.all]))

    @property
    def width_days(self) -> float:
        return float(np.median([one.width_days for one in self.all]))

    def __str__(self) -> str:
        others = " and ".join(
            f"{name} {100 * np.mean([low <= due <= high for due, low, high in told]):.1f} % "
            f"at {np.median([(high - low) / 24 for _, low, high in told]):.1f} days"
            for name, told in (
                (
                    "the first release's constants held",
                    [(one.due, *one.former) for one in self.all],
                ),
                ("a constant pace", [(one.due, *one.constant) for one in self.all]),
            )
        )
        return (
            f"{len(self.all)} forecasts: P10 to P90 held {100 * self.held:.1f} % at a median width"
            f" of {self.width_days:.1f} days; {100 * self.before:.1f} % were due before P10,"
            f" {100 * self.after:.1f} % after P90; {others}"
        )


class Watched(Protocol):
    """A simulated station of any fleet."""

    name: str
    grown: Any
    moments: list[float]
    seen: list[Observation]
    facts: list[Fact]

    def true(self, key: tuple[int, str], hour: float) -> float: ...
    def when(self, key: tuple[int, str], amount: float) -> float: ...


def due_score(fleet: Fleet, seed: int, stations: int, looks_each: int = 8) -> DueScore:
    """At looks spread over the stations' time, each with only what the ledger had by then."""
    fleet = replace(fleet, truth_years=TRUTH_YEARS, clocks=0.0)
    return due_score_of(
        (fleet.station(seed, number) for number in range(stations)), BEGIN, seed, looks_each
    )


def due_score_of(
    stations: Iterable[Watched], begin: datetime, seed: int, looks_each: int = 8
) -> DueScore:
    """The same of any stations, whose hours count from `begin` on."""
    score = DueScore()
    for number, station in enumerate(stations):
        rng = np.random.default_rng([seed, number, 7])
        lives = {
            key: math.exp(rng.uniform(*np.log(LIVES[key[1]])))
            for key in station.grown
            if key[1] in LIVES
        }
        for look in sorted(
            rng.choice(
                range(3, len(station.seen)), min(looks_each, len(station.seen) - 3), replace=False
            )
        ):
            score.all += _forecasts(station, int(look), lives, begin, seed)
    return score


def _forecasts(
    station: Watched, look: int, lives: dict[tuple[int, str], float], zero: datetime, seed: int
) -> Iterator[Foretold]:
    now = station.moments[look]
    history = History("line", station.name, station.seen[: look + 1], station.facts)
    for key, trace in traces_of(history).now.items():
        if key not in lives or len(trace.points) < 4 or trace.points[-1].look != look:
            continue
        begin = station.moments[trace.points[0].look]
        done = _last_done(station, key, lives[key], begin, now, seed)
        due = station.when(key, station.true(key, done) + lives[key])
        if now < due < TRUTH_YEARS * YEAR - 24:
            yield from _forecast(trace, lives[key], (done, now, due), zero, now - begin)


def _last_done(
    station: Watched, key: tuple[int, str], life: float, begin: float, now: float, seed: int
) -> float:
    """When the task was done last: each time when 60 to 100 % of its life was used."""
    rng, done = np.random.default_rng([seed, key[0], len(key[1])]), begin
    while (
        after := station.when(key, station.true(key, done) + life * rng.uniform(0.6, 1.0))
    ) <= now:
        done = after
    return done


def _forecast(
    trace: Trace, life: float, at: tuple[float, float, float], zero: datetime, watched: float
) -> Iterator[Foretold]:
    done, now, due = at
    used = used_since(trace, (zero + timedelta(hours=done)).isoformat())
    found = foresee([trace], life, used)
    if found is None or found.p10 is None or used.width > life / 2:
        return
    grown = trace.between(0, len(trace.points) - 1)
    soonest = now + max(0.0, life - used.high) * watched / grown.high if grown.high else math.inf
    latest = now + max(0.0, life - used.low) * watched / grown.low if grown.low else math.inf
    with former():
        old = foresee([trace], life, used)
    told = (_hour(old.p10, zero), _hour(old.p90, zero)) if old is not None else (math.inf, math.inf)
    yield Foretold(due, _hour(found.p10, zero), _hour(found.p90, zero), (soonest, latest), told)


@contextmanager
def former() -> Iterator[None]:
    """Due ranges as the first release told them."""
    with ExitStack() as patched:
        for module, constants in FORMER.items():
            patched.enter_context(patch.multiple(module, **constants))
        yield


def _hour(moment: float | None, zero: datetime) -> float:
    return math.inf if moment is None else (moment - zero.timestamp()) / 3600
