"""How right the audit is of a simulated fleet: its odometers against the truth, its due ranges against when it was really due."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from audit_fleet import BEGIN, YEAR, Fleet, SimStation, iso

from jbclog.audit.due import foresee, used_since
from jbclog.odometer.history import History
from jbclog.odometer.odometer import Trace
from jbclog.odometer.tracing import traces_of

LIVES = {
    "work_h": (100, 700),
    "sleep_cycles": (1_500, 8_000),
    "dispensed_cycles": (30_000, 300_000),
    "dispensed_mm": (2e5, 2e6),
    "suction_cycles": (8_000, 60_000),
}
TRUTH_YEARS = 5.0
NEAR = 1e-6


def history_of(station: SimStation, looks: int | None = None) -> History:
    """What the ledger would have after so many looks."""
    return History("line", station.name, station.seen[:looks], station.facts)


# -- the odometer ---------------------------------------------------------------------------------------------------------------


@dataclass
class OdometerScore:
    """Differences and sums of a fleet. `wrong` are those that were called known and were not so."""

    steps: Counter[str] = field(default_factory=Counter)
    sums: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        known, flagged = self.steps["known"], self.steps["flagged"]
        return (
            f"{known + flagged} differences: {known} known, {self.steps['wrong']} of them wrong; {flagged} flagged, "
            f"{self.steps['outside']} of them outside their bounds; {self.sums['known']} sums known, {self.sums['wrong']} of them "
            f"wrong or wider than two readings; {self.sums['flagged']} flagged, {self.sums['outside']} outside their bounds"
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
        is_narrow = not one.is_known or one.delta.width <= 2 * trace.step + 30 + NEAR  # of one that moved while it was read
        score.steps["known" if one.is_known else "flagged"] += 1
        if not is_in or not is_narrow:
            score.steps["wrong" if one.is_known else "outside"] += 1
        if one.is_known and not (is_in and is_narrow):
            score.wrong.append(f"{station.name} {truth} {one}")


def _sum(score: OdometerScore, station: SimStation, trace: Trace) -> None:
    odometer, last = trace.odometer, len(trace.points) - 1
    is_in = odometer.total.low - NEAR <= _truth(station, trace, 0, last) <= odometer.total.high + NEAR
    score.sums["known" if odometer.is_known else "flagged"] += 1
    moved = sum(trace.points[place].shown.width for place in (0, last))
    is_narrow = not odometer.is_known or odometer.total.width <= 2 * trace.step + moved + NEAR
    if not is_in or not is_narrow:
        score.sums["wrong" if odometer.is_known else "outside"] += 1


# -- due ranges -----------------------------------------------------------------------------------------------------------------


@dataclass
class DueScore:
    """A row a forecast: in its range or not, the range's width in days; and the same of a pace that is taken to be constant."""

    rows: list[tuple[bool, float, bool, float]] = field(default_factory=list)

    @property
    def held(self) -> float:
        return float(np.mean([row[0] for row in self.rows]))

    @property
    def width_days(self) -> float:
        return float(np.median([row[1] for row in self.rows]))

    def __str__(self) -> str:
        plain = np.mean([row[2] for row in self.rows]), np.median([row[3] for row in self.rows])
        return (
            f"{len(self.rows)} forecasts: P10 to P90 held {100 * self.held:.1f} % at a median width of {self.width_days:.1f} days; "
            f"a constant pace held {100 * plain[0]:.1f} % at {plain[1]:.1f} days"
        )


def due_score(fleet: Fleet, seed: int, stations: int, looks_each: int = 8) -> DueScore:
    """At looks spread over the stations' time, each with only what the ledger had by then."""
    score = DueScore()
    fleet = replace(fleet, truth_years=TRUTH_YEARS, clocks=0.0)
    for number in range(stations):
        station = fleet.station(seed, number)
        rng = np.random.default_rng([seed, number, 7])
        lives = {key: math.exp(rng.uniform(*np.log(LIVES[key[1]]))) for key in station.grown if key[1] in LIVES}
        for look in sorted(rng.choice(range(3, len(station.seen)), min(looks_each, len(station.seen) - 3), replace=False)):
            score.rows += _forecasts(station, int(look), lives, seed)
    return score


def _forecasts(
    station: SimStation, look: int, lives: dict[tuple[int, str], float], seed: int
) -> Iterator[tuple[bool, float, bool, float]]:
    now = station.moments[look]
    for key, trace in traces_of(history_of(station, look + 1)).now.items():
        if key not in lives or len(trace.points) < 4 or trace.points[-1].look != look:
            continue
        begin = station.moments[trace.points[0].look]
        done = _last_done(station, key, lives[key], begin, now, seed)
        due = station.when(key, station.true(key, done) + lives[key])
        if now < due < TRUTH_YEARS * YEAR - 1:
            yield from _forecast(trace, lives[key], done, now, due, now - begin)


def _last_done(station: SimStation, key: tuple[int, str], life: float, begin: float, now: float, seed: int) -> float:
    """When the task was done last: each time when 60 to 100 % of its life was used."""
    rng, done = np.random.default_rng([seed, key[0], len(key[1])]), begin
    while (after := station.when(key, station.true(key, done) + life * rng.uniform(0.6, 1.0))) <= now:
        done = after
    return done


def _forecast(
    trace: Trace, life: float, done: float, now: float, due: float, watched: float
) -> Iterator[tuple[bool, float, bool, float]]:
    used = used_since(trace, iso(done))
    found = foresee([trace], life, used)
    if found is None or found.p10 is None or used.width > life / 2:
        return
    low, high = _hour(found.p10), _hour(found.p90)
    grown = trace.between(0, len(trace.points) - 1)
    soonest = now + max(0.0, life - used.high) * watched / grown.high if grown.high else math.inf
    latest = now + max(0.0, life - used.low) * watched / grown.low if grown.low else math.inf
    yield low <= due <= high, (high - low) / 24, soonest <= due <= latest, (latest - soonest) / 24 if grown.low else math.inf


def _hour(moment: float | None) -> float:
    return math.inf if moment is None else (moment - BEGIN.timestamp()) / 3600
