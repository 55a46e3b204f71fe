"""A fleet over years, simulated hour by hour, and what an audit would have read of it; the truth is
kept beside.

Two models that share no pattern: `SHIFTS` (tuned against) works in shifts with products that
change, holidays and noise; `BATCHES` (never tuned against) is idle for days and then works through
orders, around the clock or not at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from jbclog.config.task_names import REPLACED
from jbclog.maintenance.counter_totals.observed import Count, Fact, Identity, Observation, Standing

Hours = NDArray[np.float64]
BEGIN = datetime(2024, 1, 1, tzinfo=UTC)
YEAR = 365 * 24
SOLDERING = (
    "plugged_h",
    "no_tool_h",
    "sleep_h",
    "hibernation_h",
    "work_h",
    "sleep_cycles",
    "desolder_cycles",
)
COUNTERS = {
    "dde": SOLDERING,
    "ucr": SOLDERING,
    "ale": (*SOLDERING, "dispensed_cycles", "dispensed_mm"),
    "jtse": ("on_h", "work_h", "tool_cycles", "suction_cycles"),
}
MODULUS = {"dispensed_mm": 16**5 / 10}


def iso(hour: float) -> str:
    return (BEGIN + timedelta(hours=hour)).isoformat()


# -- how a port is used, hour by hour --------------------------------------------------------------


@dataclass(frozen=True)
class Used:
    """Of each hour: the share that the station is on, of that the share that it works, and how fast
    it makes joints (an hour).
    """

    on: Hours
    work: Hours
    joints: Hours
    mm: Hours


def _steps(
    rng: np.random.Generator, hours: int, weeks: tuple[float, float], draw: Callable[[], float]
) -> Hours:
    """A level that changes every few weeks: a product."""
    level = np.empty(hours)
    at = 0
    while at < hours:
        length = int(rng.uniform(*weeks) * 168)
        level[at : at + length] = draw()
        at += length
    return level


def shifts(rng: np.random.Generator, hours: int) -> Used:
    """Shifts on weekdays, holidays in summer and at the end of the year, products that change, days
    that differ.
    """
    hour = np.arange(hours)
    day, of_day = hour // 24, hour % 24
    weekday, of_year = day % 7, day % 365  # 2024-01-01 is a Monday
    begin, length = {1: (6, 8), 2: (6, 16), 3: (0, 24)}[int(rng.choice([1, 1, 2, 3]))]
    weekend = rng.choice([0.0, 0.0, 0.3])
    days = np.where(np.arange(hours // 24 + 2) % 7 < 5, 1.0, weekend) * (
        rng.random(hours // 24 + 2) > 0.02
    )
    summer = int(rng.integers(190, 230))
    holiday = (
        (of_year >= 358)
        | (of_year < 2)
        | ((of_year >= summer) & (of_year < summer + 14) & bool(rng.random() < 0.7))
    )
    on = (
        ((of_day >= begin) & (of_day < begin + length))
        * np.where(weekday < 5, 1.0, days[day] > 0)
        * (days[day] > 0)
        * ~holiday
    )
    share = _steps(rng, hours, (2, 10), lambda: float(np.clip(rng.normal(0.55, 0.15), 0.15, 0.95)))
    noise = rng.gamma(12, 1 / 12, hours // 24 + 2)[day]
    joints = _steps(rng, hours, (2, 10), lambda: float(rng.uniform(80, 350)))
    mm = _steps(rng, hours, (4, 16), lambda: float(rng.uniform(2.5, 7)))
    return Used(on.astype(float), np.clip(share * noise, 0, 1), joints, mm)


def batches(rng: np.random.Generator, hours: int) -> Used:
    """Orders that come when they come, last for days, and are worked through by day or by day and
    night.
    """
    on, work, joints, mm = (np.zeros(hours) for _ in range(4))
    at = 0
    while at < hours:
        length, pause = int(rng.gamma(3, 24)) + 8, int(rng.exponential(60))
        stop = min(hours, at + length)
        of_day = np.arange(at, stop) % 24
        on[at:stop] = 1.0 if rng.random() < 0.3 else (of_day >= 7) & (of_day < 18)
        work[at:stop], joints[at:stop], mm[at:stop] = (
            rng.uniform(0.3, 0.9),
            rng.uniform(50, 500),
            rng.uniform(3, 8),
        )
        at = stop + pause
    return Used(on, work, joints, mm)


SHIFTS, BATCHES = shifts, batches


def _grown(used: Used, rng: np.random.Generator) -> dict[str, Hours]:
    """What each counter really grows to by the end of each hour, from 0."""
    hours = len(used.on)
    work = used.on * used.work
    rest = used.on - work
    asleep, none = float(rng.uniform(0.3, 0.7)), float(rng.uniform(0.0, 0.15))
    each = {
        "plugged_h": used.on,
        "on_h": used.on,
        "work_h": work,
        "sleep_h": rest * asleep,
        "no_tool_h": rest * none,
        "hibernation_h": rest * (1 - asleep - none) * 0.8,
        "sleep_cycles": rng.poisson(rest * 6),
        "desolder_cycles": rng.poisson(work * used.joints * 0.1),
        "tool_cycles": rng.poisson(work * 4),
        "suction_cycles": rng.poisson(work * 40),
        "dispensed_cycles": rng.poisson(work * used.joints),
    }
    each["dispensed_mm"] = np.round(each["dispensed_cycles"] * used.mm, 1)
    return {
        name: np.concatenate([[0.0], np.cumsum(one)])
        for name, one in each.items()
        if len(one) == hours
    }


# -- a station -------------------------------------------------------------------------------------


@dataclass
class Unit:
    """A box that stands on the bench from `hour` on: what each counter showed then is `offset`
    beyond what really was worked.
    """

    hour: float
    model: str
    software: str
    offset: dict[tuple[int, str], float]


@dataclass
class SimStation:
    """One station with its truth. `moments` are the audits (true hours), `seen` what they read."""

    name: str
    family: str
    grown: dict[tuple[int, str], Hours]
    units: list[Unit] = field(default_factory=list)
    moments: list[float] = field(default_factory=list)
    seen: list[Observation] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)
    happened: list[tuple[float, str]] = field(default_factory=list)

    def true(self, key: tuple[int, str], hour: float) -> float:
        """What really was worked from the beginning to `hour`."""
        grown = self.grown[key]
        whole = int(hour)
        value = float(
            grown[whole] + (grown[min(whole + 1, len(grown) - 1)] - grown[whole]) * (hour - whole)
        )
        return (
            value
            if key[1].endswith("_h")
            else (
                math.floor(value * 10 + 1e-6) / 10
                if key[1] == "dispensed_mm"
                else math.floor(value)
            )
        )

    def when(self, key: tuple[int, str], amount: float) -> float:
        """The hour at which `amount` really is reached."""
        grown = self.grown[key]
        after = int(np.searchsorted(grown, amount))
        if after == 0 or after >= len(grown):
            return float(min(after, len(grown)))
        return after - float((grown[after] - amount) / (grown[after] - grown[after - 1]))

    def unit(self, hour: float) -> Unit:
        return next(one for one in reversed(self.units) if one.hour <= hour)

    def shown(self, key: tuple[int, str], hour: float) -> float:
        """What the station shows."""
        value, modulus = (
            self.true(key, hour) + self.unit(hour).offset[key],
            MODULUS.get(key[1], 100_000),
        )
        if key[1] == "dispensed_mm":
            return round(math.floor(value * 10 + 1e-6) / 10 % modulus, 1)
        return float(math.floor(value + 1e-9) % modulus)


@dataclass(frozen=True)
class Fleet:
    """How it is looked at. Rates are per station and year, chances per audit or reading."""

    pattern: Callable[[np.random.Generator, int], Used] = shifts
    every_h: float = 24.0
    years: float = 2.0
    truth_years: float = 2.0
    resets: float = 0.4
    swaps: float = 0.15
    silent_swaps: float = 0.08
    updates: float = 0.3
    gaps: float = 0.3
    missed: float = 0.04
    clocks: float = 0.3
    unread: float = 0.01
    moving: float = 0.01
    misread: float = 0.002
    near_top: float = 0.1

    def station(self, seed: int, number: int) -> SimStation:
        """The station of that number, always the same for one seed."""
        rng = np.random.default_rng([seed, number])
        family = str(rng.choice(list(COUNTERS)))
        hours = int(self.truth_years * YEAR)
        station = SimStation(f"{family}-{number}", family, {})
        for port in range(1, {"dde": 3}.get(family, 2)):
            grown = _grown(self.pattern(rng, hours), rng)
            station.grown |= {(port, name): grown[name] for name in COUNTERS[family]}
        self._stand(station, rng)
        self._look(station, rng)
        return station

    # -- what happens to it

    def _stand(self, station: SimStation, rng: np.random.Generator) -> None:
        station.units = [
            Unit(0.0, station.family.upper(), "100", self._used_before(station, rng, 0.0))
        ]
        for hour, what in self._happenings(rng):
            before = station.units[-1]
            if what == "reset":
                new = Unit(hour, before.model, before.software, self._from_zero(station, hour))
            elif what == "update":
                new = Unit(hour, before.model, str(int(before.software) + 1), before.offset)
            else:
                model = before.model + ("" if what == "silent swap" else "X")
                new = Unit(hour, model, before.software, self._used_before(station, rng, hour))
            station.units.append(new)
            station.happened.append((hour, what))
            if what == "swap" and rng.random() < 0.5:
                said = iso(hour)
                station.facts.append(Fact(said, said, "A. Rossi", "line", station.name, REPLACED))

    def _happenings(self, rng: np.random.Generator) -> list[tuple[float, str]]:
        rates = {
            "reset": self.resets,
            "swap": self.swaps,
            "silent swap": self.silent_swaps,
            "update": self.updates,
        }
        hours = self.years * YEAR
        return sorted(
            (float(rng.uniform(0, hours)), what)
            for what, a in rates.items()
            for _ in range(rng.poisson(a * self.years))
        )

    def _from_zero(self, station: SimStation, hour: float) -> dict[tuple[int, str], float]:
        return {key: -station.true(key, hour) for key in station.grown}

    def _used_before(
        self, station: SimStation, rng: np.random.Generator, hour: float
    ) -> dict[tuple[int, str], float]:
        """The counters of a box that comes from elsewhere: of a new one, of one that was used, of
        one about to roll over.
        """
        age = 0.0 if rng.random() < 0.15 else rng.uniform(200, 20_000)
        near = rng.random() < self.near_top
        had = {}
        for key in station.grown:
            share = {"plugged_h": 1.0, "on_h": 1.0}.get(key[1], float(rng.uniform(0.1, 0.6)))
            top = MODULUS.get(key[1], 100_000)
            start = age * share if key[1].endswith("_h") else rng.uniform(0, top) * bool(age)
            showed = top - rng.uniform(5, 500) if near and rng.random() < 0.4 else start
            had[key] = (showed if key[1].endswith("_h") else math.floor(showed)) - station.true(
                key, hour
            )
        return had

    # -- how it is looked at

    def _look(self, station: SimStation, rng: np.random.Generator) -> None:
        out = self._gaps(rng)
        wrong = self._wrong_clocks(rng)
        hour = 5.0
        while hour < self.years * YEAR:
            summer = 1.0 if 90 * 24 <= hour % YEAR < 300 * 24 else 0.0
            at = hour - summer + float(rng.uniform(0, 0.05))
            if not any(begin <= at < end for begin, end in out) and rng.random() > self.missed:
                clock = at + next((by for begin, end, by in wrong if begin <= at < end), 0.0)
                station.moments.append(at)
                station.seen.append(self._observation(station, at, clock, rng))
            hour += self.every_h

    def _gaps(self, rng: np.random.Generator) -> list[tuple[float, float]]:
        begins = rng.uniform(0, self.years * YEAR, rng.poisson(self.gaps * self.years))
        return [(float(begin), float(begin + rng.uniform(14, 240) * 24)) for begin in begins]

    def _wrong_clocks(self, rng: np.random.Generator) -> list[tuple[float, float, float]]:
        """From, to, by how many hours: for an audit or some, back or on."""
        begins = rng.uniform(0, self.years * YEAR, rng.poisson(self.clocks * self.years))
        return [
            (
                b,
                b + self.every_h * rng.integers(1, 4),
                float(rng.choice([-400, -30, -3, 3, 30, 4000])),
            )
            for b in begins
        ]

    def _observation(
        self, station: SimStation, at: float, clock: float, rng: np.random.Generator
    ) -> Observation:
        unit = station.unit(at)
        counts = tuple(self._count(station, key, at, rng) for key in station.grown)
        who = Identity(station.family, unit.model, unit.software)
        return Observation(
            iso(clock),
            iso(clock),
            "line",
            station.name,
            "loop://",
            True,
            identity=who,
            counts=counts,
        )

    def _count(
        self, station: SimStation, key: tuple[int, str], at: float, rng: np.random.Generator
    ) -> Count:
        value, luck = station.shown(key, at), rng.random()
        unit = {"h": "h", "mm": "mm"}.get(key[1].rpartition("_")[2], "count")
        if luck < self.unread:
            return Count(*key, unit, None, Standing.UNREAD, why="timeout")
        if luck < self.unread + self.moving:
            return Count(
                *key,
                unit,
                None,
                Standing.MOVING,
                tuple(station.shown(key, at + late / 600) for late in range(3)),
            )
        if (
            luck < self.unread + self.moving + self.misread and unit == "h"
        ):  # a wrong digit that counts of events may hide for a day
            station.happened.append((at, "misread"))
            value = (value + 1000 * int(rng.integers(1, 99))) % 100_000
        return Count(*key, unit, value, values=(value, value))
