"""Stations over years, day by day, whose units are exchanged without a word; what looks read of
them, and the truth beside.

Written apart from `audit_fleet.py`, with other habits. Two models: `workshop` (what the rules were
worked out against) has one or two shifts, short Fridays, shutdowns in summer and winter, a season,
short time; `contract` (never looked into before it was counted) has lines that run day and night
for a customer, stop for a lunar new year, double or halve their demand, stand in store for months.
A unit that comes can show anything: nothing, a little, what its twin shows, a life's work, nearly
its last number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.config.task_names import REPLACED, RESET
from jbclog.maintenance.counter_totals.observed import Count, Fact, Identity, Observation, Standing

Numbers = NDArray[np.float64]
Key = tuple[int, str]
BEGIN: Final = datetime(2023, 2, 6, tzinfo=UTC)  # a Monday
HOURS: Final = ("plugged_h", "no_tool_h", "sleep_h", "hibernation_h", "work_h")
FAMILIES: Final = {
    "dde": (2, (*HOURS, "sleep_cycles", "desolder_cycles")),
    "nae": (4, (*HOURS, "sleep_cycles", "desolder_cycles")),
    "hde": (1, (*HOURS, "sleep_cycles", "desolder_cycles")),
    "ale": (1, (*HOURS, "sleep_cycles", "dispensed_cycles", "dispensed_mm")),
    "jtse": (1, ("on_h", "work_h", "tool_cycles", "suction_cycles")),
}
# the greatest number that is shown; 99 999 of all others
LAST: Final = {"dispensed_mm": 16**5 / 10 - 0.1}
STEP: Final = {"dispensed_mm": 0.1}
LIVES: Final = {
    "new": 0.0,
    "tested": 10.0,
    "little": 500.0,
    "used": 30_000.0,
    "twin": 20_000.0,
    "mixed": 400.0,
    "late": 99_900.0,
}
"""Hours that a unit has behind it at most when it comes. "mixed": its board had few hours, and
counts of any number.
"""


def iso(hour: float) -> str:
    return (BEGIN + timedelta(hours=hour)).isoformat()


# -- what is worked at a place, day by day ---------------------------------------------------------


@dataclass(frozen=True)
class Days:
    """Of each day: the hour at which the station is switched on, for how long, and how much there
    is to do (1 is usual).
    """

    on_at: Numbers
    hours: Numbers
    load: Numbers


Model = Callable[[np.random.Generator, int], Days]


def workshop(rng: np.random.Generator, days: int) -> Days:
    day = np.arange(days)
    weekday, of_year = day % 7, (day + 36) % 365
    shift = float(rng.choice([8.0, 8.5, 10.0, 16.0]))
    hours = np.where(
        weekday < 4, shift, np.where(weekday == 4, shift * float(rng.choice([0.6, 1.0])), 0.0)
    )
    hours = np.where(
        (weekday == 5) & (rng.random(days) < float(rng.choice([0.0, 0.0, 0.3]))), 5.0, hours
    )
    summer, weeks = int(rng.integers(195, 225)), int(rng.choice([0, 2, 3, 4]))
    shut = (of_year >= 357) | (of_year < 6) | ((of_year >= summer) & (of_year < summer + 7 * weeks))
    shut |= rng.random(days) < 0.025
    season = 1 + float(rng.uniform(0, 0.5)) * np.sin(
        2 * math.pi * (of_year - float(rng.uniform(0, 365))) / 365
    )
    return Days(
        np.full(days, 6.0),
        np.where(shut, 0.0, hours),
        season * _spells(rng, days, (30, 150), lambda: _job(rng)),
    )


def _job(rng: np.random.Generator) -> float:
    """How much there is to do for some weeks; one in eight times it is short time."""
    return (
        float(rng.uniform(0.2, 0.5))
        if rng.random() < 0.125
        else float(np.clip(rng.normal(1, 0.2), 0.4, 1.6))
    )


def contract(rng: np.random.Generator, days: int) -> Days:
    day = np.arange(days)
    around = bool(rng.random() < 0.4)
    rest = np.isin(day % 7, rng.choice(7, int(rng.choice([1, 2])), replace=False)) & ~around
    hours = np.where(
        rest,
        0.0,
        _spells(
            rng, days, (60, 200), lambda: float(rng.choice([24.0] if around else [9.0, 11.0, 18.0]))
        ),
    )
    new_year = int(rng.integers(20, 50))
    for year in range(days // 365 + 1):
        begin = year * 365 + new_year + int(rng.integers(-12, 12))
        hours[max(begin, 0) : begin + int(rng.integers(7, 18))] = 0
    hours[_stops(rng, days, 0.4, (30, 120))] = 0  # in store
    hours[_stops(rng, days, 3.0, (1, 5))] = 0  # no material
    load = np.exp(np.cumsum(rng.normal(0, 0.1, days // 14 + 1)) * 0.7)[day // 14] * rng.lognormal(
        0, 0.25, days
    )
    return Days(np.where(hours > 20, 0.0, 5.5), hours, load / np.median(load))


def _spells(
    rng: np.random.Generator, days: int, lasts: tuple[int, int], draw: Callable[[], float]
) -> Numbers:
    level, at = np.empty(days), 0
    while at < days:
        length = int(rng.integers(*lasts))
        level[at : at + length] = draw()
        at += length
    return level


def _stops(
    rng: np.random.Generator, days: int, a_year: float, lasts: tuple[int, int]
) -> NDArray[np.bool_]:
    stopped = np.zeros(days, bool)
    for begin in rng.integers(0, days, rng.poisson(a_year * days / 365)):
        stopped[begin : begin + int(rng.integers(*lasts))] = True
    return stopped


def _grown(days: Days, rng: np.random.Generator, is_used: bool) -> dict[str, Numbers]:
    """What each counter really grows to, at the moments of `_moments`: up to each switching on and
    off.
    """
    count = len(days.hours)
    share = float(rng.beta(3, 3)) * is_used
    work = days.hours * np.clip(share * days.load * rng.gamma(20, 1 / 20, count), 0, 0.98)
    rest = days.hours - work
    out, asleep = rng.dirichlet((1, 4, 3, 2))[:2]
    joints = rng.uniform(40, 1500, count // 20 + 1)[np.arange(count) // 20]
    mm = rng.uniform(0.8, 4000 / 1500, count // 20 + 1)[np.arange(count) // 20]
    each = {
        "plugged_h": days.hours,
        "on_h": days.hours,
        "work_h": work,
        "no_tool_h": rest * out,
        "sleep_h": rest * asleep,
        "hibernation_h": rest * (1 - out - asleep) * 0.9,
        "sleep_cycles": np.floor(days.hours * float(rng.uniform(1, 20)) * is_used),
        "desolder_cycles": np.floor(
            work * np.where(rng.random(count) < 0.2, rng.uniform(0, 300), 2.0)
        ),
        "tool_cycles": np.floor(work * float(rng.uniform(2, 40))),
        "suction_cycles": np.floor(work * float(rng.uniform(5, 300))),
        "dispensed_cycles": np.floor(work * joints),
    }
    each["dispensed_mm"] = np.round(each["dispensed_cycles"] * mm, 1)
    return {
        name: np.repeat(np.concatenate([[0.0], np.cumsum(one)]), 2)[:-1]
        for name, one in each.items()
    }


def _moments(days: Days) -> Numbers:
    begin = np.arange(len(days.hours)) * 24 + days.on_at
    return np.concatenate(
        [[0.0], np.stack([begin, begin + np.maximum(days.hours, 1e-3)], axis=1).ravel()]
    )


# -- a place and its units -------------------------------------------------------------------------


@dataclass(frozen=True)
class Stood:
    """What stands at the place from `hour` on: what its counters show is `offset` beyond what was
    worked at the place.
    """

    hour: float
    unit: int
    model: str
    software: str
    stops: bool  # at its last number, instead of going on from zero
    offset: dict[Key, float]


@dataclass
class Place:
    """One station with its truth. `moments` are the hours of the looks at it, `exchanges` those at
    which another unit came.
    """

    name: str
    family: str
    at: Numbers
    grown: dict[Key, Numbers]
    stood: list[Stood] = field(default_factory=list)
    exchanges: list[float] = field(default_factory=list)
    resets: list[tuple[float, bool]] = field(default_factory=list)  # and whether somebody told
    moments: list[float] = field(default_factory=list)
    seen: list[Observation] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)

    def true(self, key: Key, hour: float) -> float:
        """What was worked here until then, by whichever unit."""
        value = float(np.interp(hour, self.at, self.grown[key]))
        return value if key[1].endswith("_h") else _floor(value, STEP.get(key[1], 1.0))

    def when(self, key: Key, amount: float) -> float:
        """The hour at which so much has been worked; the end of time where it never is."""
        grown = self.grown[key]
        after = int(np.searchsorted(grown, amount))
        if not 0 < after < len(grown):
            return float(self.at[min(after, len(grown) - 1)])
        share = (amount - grown[after - 1]) / (grown[after] - grown[after - 1])
        return float(self.at[after - 1] + share * (self.at[after] - self.at[after - 1]))

    def stands(self, hour: float) -> Stood:
        return next(one for one in reversed(self.stood) if one.hour <= hour)

    def shown(self, key: Key, hour: float) -> float:
        there = self.stands(hour)
        return _shown(key, self.true(key, hour) + there.offset[key], there.stops)


def _floor(value: float, step: float) -> float:
    return round(math.floor(value / step + 1e-6) * step, 1)


def _shown(key: Key, value: float, stops: bool) -> float:
    last, step = LAST.get(key[1], 99_999.0), STEP.get(key[1], 1.0)
    whole = _floor(value, step)
    return min(whole, last) if stops else round(whole % (last + step), 1)


# -- what happens to it ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Places:
    """A fleet. Rates are per station and year, chances per look or count."""

    model: Model = workshop
    every: str = "weekly"
    years: float = 2.0
    truth_years: float = 2.0
    exchanges: float = 0.6
    loans: float = 0.2
    resets: float = 0.3
    updates: float = 0.3
    absences: float = 0.3
    missed: float = 0.08
    cut_short: float = 0.02
    unread: float = 0.005
    moving: float = 0.005

    def place(self, seed: int, number: int) -> Place:
        """The place of that number, always the same for one seed."""
        rng = np.random.default_rng([seed, number, 99])
        family = str(rng.choice(list(FAMILIES)))
        ports, counters = FAMILIES[family]
        days = self.model(rng, int(self.truth_years * 365))
        place = Place(f"{family}-{number}", family, _moments(days), {})
        for port in range(1, ports + 1):
            grown = _grown(days, rng, port == 1 or bool(rng.random() < 0.6))
            place.grown |= {(port, name): grown[name] for name in counters}
        _Life(self, place, rng).live()
        _look(self, place, rng)
        return place


class _Life:
    """All that happens at one place."""

    def __init__(self, places: Places, place: Place, rng: np.random.Generator) -> None:
        self.places, self.place, self.rng = places, place, rng
        self.units = 1

    def live(self) -> None:
        first = Stood(0.0, 0, self.place.family.upper(), "7001", self._stops(), self._brought(0.0))
        self.place.stood.append(first)
        for hour, what in self._happenings():
            getattr(self, f"_{what}")(hour)

    def _happenings(self) -> list[tuple[float, str]]:
        asked = self.places
        rates = {
            "exchange": asked.exchanges,
            "loan": asked.loans,
            "reset": asked.resets,
            "update": asked.updates,
        }
        found = [
            (float(self.rng.uniform(48, asked.years * 365 * 24)), what)
            for what, rate in rates.items()
            for _ in range(self.rng.poisson(rate * asked.years))
        ]
        return sorted(found)

    def _stand(self, hour: float, **changed: object) -> None:
        there = self.place.stood[-1]
        if hour <= there.hour:  # a loan that still lasts
            return
        self.place.stood.append(Stood(hour, **({**_plain(there), **changed})))  # type: ignore[arg-type]

    def _exchange(self, hour: float) -> None:
        there = self.place.stood[-1]
        if hour <= there.hour:
            return
        model = there.model + "2" if self.rng.random() < 0.05 else there.model
        software = (
            str(int(self.rng.integers(7001, 7006))) if self.rng.random() < 0.15 else there.software
        )
        self._stand(
            hour,
            unit=self.units,
            model=model,
            software=software,
            stops=self._stops(),
            offset=self._brought(hour, of=there.offset),
        )
        self.units += 1
        self.place.exchanges.append(hour)
        if self.rng.random() < 0.1:
            self._tell(REPLACED, hour)

    def _loan(self, hour: float) -> None:
        there = self.place.stood[-1]
        back = hour + float(
            self.rng.choice([60.0, 200.0, 500.0, 1500.0]) * self.rng.uniform(0.5, 1.5)
        )
        if hour <= there.hour or back >= self.places.years * 365 * 24:
            return
        self._stand(
            hour, unit=self.units, stops=self._stops(), offset=self._brought(hour, of=there.offset)
        )
        self.units += 1
        # of it may be put to work meanwhile
        elsewhere = float(self.rng.choice([0.0, 0.0, 0.2])) * (back - hour)
        offset = {}
        for key, by in there.offset.items():
            more = elsewhere * (0.5 if key[1].endswith("_h") else 3.0)
            offset[key] = (
                self.place.true(key, hour) + by + math.floor(more) - self.place.true(key, back)
            )
        self._stand(back, unit=there.unit, stops=there.stops, offset=offset)
        self.place.exchanges += [hour, back]

    def _reset(self, hour: float) -> None:
        self._stand(hour, offset={key: -self.place.true(key, hour) for key in self.place.grown})
        if self.place.stood[-1].hour == hour:
            self.place.resets.append((hour, bool(self.rng.random() < 0.4)))
            if self.place.resets[-1][1]:
                self._tell(RESET, hour)

    def _update(self, hour: float) -> None:
        self._stand(hour, software=str(int(self.place.stood[-1].software) + 10))

    def _tell(self, task: str, hour: float) -> None:
        said = iso(hour)
        self.place.facts.append(Fact(said, said, "M. Chen", "line", self.place.name, task))

    def _stops(self) -> bool:
        return bool(self.rng.random() < 0.3)

    def _brought(self, hour: float, of: dict[Key, float] | None = None) -> dict[Key, float]:
        """What a unit shows when it comes, beyond what was worked here. `of` is that of the one
        that it takes the place of.
        """
        kind = str(
            self.rng.choice(
                ["new", "tested", "little", "used", "twin", "mixed", "late"],
                p=[0.1, 0.1, 0.2, 0.3, 0.1, 0.1, 0.1],
            )
        )
        life = {
            "tested": 10.0,
            "little": 500.0,
            "used": 30_000.0,
            "mixed": 400.0,
            "late": 99_900.0,
            "twin": 20_000.0,
        }.get(kind, 0.0)
        age = float(self.rng.uniform(0.02, 1)) * life
        brought = {}
        for port in {port for port, _ in self.place.grown}:
            share = float(self.rng.uniform(0.05, 0.9))
            for key in (key for key in self.place.grown if key[0] == port):
                had = self._had(key, kind, age, share)
                if kind == "twin" and of is not None:
                    had = max(
                        0.0,
                        (self.place.true(key, hour) + of[key]) * float(self.rng.normal(1, 0.02)),
                    )
                brought[key] = (
                    had if key[1].endswith("_h") else _floor(had, STEP.get(key[1], 1.0))
                ) - self.place.true(key, hour)
        return brought

    def _had(self, key: Key, kind: str, age: float, share: float) -> float:
        last = LAST.get(key[1], 99_999.0)
        if key[1] in ("plugged_h", "on_h"):
            return age
        if key[1] == "work_h":
            return age * share
        if key[1].endswith("_h"):
            return age * (1 - share) * float(self.rng.uniform(0, 0.5))
        if kind == "late" and self.rng.random() < 0.5:
            return last - float(self.rng.uniform(0, 300))
        if kind in ("used", "mixed", "late"):
            return float(self.rng.uniform(0, last))
        return age * float(self.rng.uniform(0, 15))


def _plain(there: Stood) -> dict[str, object]:
    return {
        "unit": there.unit,
        "model": there.model,
        "software": there.software,
        "stops": there.stops,
        "offset": there.offset,
    }


# -- how it is looked at ---------------------------------------------------------------------------


def _look(places: Places, place: Place, rng: np.random.Generator) -> None:
    away = [
        (begin, begin + float(rng.uniform(300, 3000)))
        for begin in rng.uniform(0, places.years * 8760, rng.poisson(places.absences * 2))
    ]
    for due in _planned(places, rng):
        if rng.random() >= places.missed and not any(begin <= due < end for begin, end in away):
            place.moments.append(due)
            place.seen.append(_observed(places, place, due, rng))


def _planned(places: Places, rng: np.random.Generator) -> Iterator[float]:
    """Weekly on one morning, or the day after; monthly in the first days of a month."""
    every, late = (168.0, 30.0) if places.every == "weekly" else (730.5, 100.0)
    at = float(rng.uniform(0, every))
    while at < places.years * 8760:
        yield at + float(rng.choice([0.0, 0.0, 1.0])) * float(rng.uniform(0, late))
        at += every


def _observed(places: Places, place: Place, hour: float, rng: np.random.Generator) -> Observation:
    there = place.stands(hour)
    keys = list(place.grown)
    answered = int(rng.integers(1, len(keys))) if rng.random() < places.cut_short else len(keys)
    counts = tuple(
        _count(places, place, key, hour, rng, number < answered) for number, key in enumerate(keys)
    )
    who = Identity(place.family, there.model, there.software)
    return Observation(
        iso(hour), iso(hour), "line", place.name, "loop://", True, identity=who, counts=counts
    )


def _count(
    places: Places, place: Place, key: Key, hour: float, rng: np.random.Generator, answers: bool
) -> Count:
    unit, luck = key[1].rpartition("_")[2], float(rng.random())
    unit = unit if unit in ("h", "mm") else "count"
    if not answers or luck < places.unread:
        return Count(*key, unit, None, Standing.UNREAD, why="timeout")
    shown = place.shown(key, hour)
    if luck < places.unread + places.moving and place.stands(hour) is place.stands(hour + 0.01):
        values = tuple(place.shown(key, hour + late) for late in (0.0, 0.004, 0.008))
        if len(set(values)) == len(values):
            return Count(*key, unit, None, Standing.MOVING, values)
    return Count(*key, unit, shown, values=(shown, shown))
