"""A second plant, on which finding joints is tested and on which nothing was tuned. Its seeds were
fixed first.

It shares no code and no structure with the virtual stations of `jbclog sim`. Here a heater with its
own heat capacity feeds a tip with another through a finite conductance; a thermocouple between the
two lags; a PID regulator with a 20 ms clock fires whole mains cycles, so that heat comes in bursts;
the power that is told is smoothed and comes in steps of 10 ‰; the temperature is told in whole
degrees with noise. Every trial has other heat capacities, conductances, gains, rated power and lag,
drawn from its seed. What the tip touches is a mass that warms up and leaks into a board, wetted
within tenths of a second.

What happens (`SHARES`), and what of it is a joint. *A joint* is one draw of heat into work, or two
less than half a second apart (a double dip, which may also be found as two); two joints are at
least a second apart. What draws heat and takes no solder (a touch, a wipe, a rest in a sponge) is a
draw as well: told apart by nothing in power and temperature but its size, it is reported beside the
rest, in no F1.

==============  ======  ============================================================================
small           joint   a pad: 0.7 to 1.1 s
medium          joint   a pin in a plated hole: 1.0 to 2.0 s
large           joint   a pin on a plane: 1.5 to 3.5 s
saturated       joint   a shield can or a busbar: the heater gives all it has for 2 to 4 s
double          joint   a contact, 0.2 to 0.5 s beside it, and once more on the same, still warm
                        work
pair            2       two small or medium joints, one second to one and a half apart
touch           -       the dry tip touches metal: hardly any heat goes over
sponge          -       one to three wipes of 0.15 to 0.35 s over a wet sponge
brass           -       two to four pokes of 0.2 to 0.4 s into brass wool
set             none    the setting changes by 20 to 50 °C
sleep           none    the tool sleeps at 150 °C for a while, and wakes
lost            none    the record has a gap of 2 to 6 s; a joint that it cuts is not counted either
                        way
soak            -       the tip rests in a wet sponge for as long as a joint
==============  ======  ============================================================================
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

SEEDS = tuple(range(61_001, 61_022))  # of the test; fixed before anything was tuned
CAMPAIGN_SEEDS = tuple(range(62_001, 62_201))
TRIAL_S, STEP_S = 300.0, 0.01
SHARES = {
    "small": 0.17,
    "medium": 0.23,
    "large": 0.13,
    "saturated": 0.04,
    "double": 0.08,
    "pair": 0.06,
    "touch": 0.07,
    "sponge": 0.06,
    "brass": 0.05,
    "set": 0.04,
    "sleep": 0.01,
    "lost": 0.03,
    "soak": 0.03,
}
JOINTS = frozenset(["small", "medium", "large", "saturated", "double", "pair"])
UNTOLD = frozenset(["soak", "touch", "sponge", "brass"])
EITHER = frozenset(["double"])  # one joint or two
AMBIENT_C, BOARD_C, SLEEP_C = 24.0, 40.0, 150.0

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Truth:
    """What really happened: from first to last touch."""

    start: float
    end: float
    kind: str

    @property
    def is_joint(self) -> bool:
        return self.kind in JOINTS


@dataclass(frozen=True)
class Contact:
    """One touch: conductance in W/K, the work's heat capacity in J/K, its leak in W/K, its
    temperature (None: as it is).
    """

    start: float
    end: float
    conductance: float
    capacity: float
    leak: float
    begins_c: float | None


@dataclass
class Script:
    """What happens in one trial, in order."""

    truths: list[Truth] = field(default_factory=list)
    contacts: list[Contact] = field(default_factory=list)
    settings: list[tuple[float, float]] = field(default_factory=list)
    sleeps: list[tuple[float, float]] = field(default_factory=list)
    gaps: list[tuple[float, float]] = field(default_factory=list)


@dataclass(frozen=True)
class Trial:
    """A record of one tool: rows as the samples have them, NaN where nothing was read."""

    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats  # read each five seconds
    working: Flags
    truths: Sequence[Truth]
    gaps: Sequence[tuple[float, float]]


# -- what happens ----------------------------------------------------------------------------------


def script_of(rng: np.random.Generator, seconds: float) -> Script:
    """A trial's events, each 3 to 6 s after the one before; the first fifteen seconds are the tip's
    own.
    """
    script, now, setting = Script(), 15.0, float(rng.integers(60, 81) * 5)
    script.settings.append((0.0, setting))
    names, shares = list(SHARES), list(SHARES.values())
    while now < seconds - 45.0:
        kind = str(rng.choice(names, p=shares))
        now = _happen(script, kind, now, rng) + float(rng.uniform(3.0, 6.0))
    return script


def _happen(script: Script, kind: str, now: float, rng: np.random.Generator) -> float:
    """Add one event that begins `now`; when it is over."""
    if kind == "set":
        step = float(rng.choice([-1, 1]) * rng.integers(4, 11) * 5)
        setting = script.settings[-1][1] + step
        script.settings.append((now, setting if 280 <= setting <= 420 else setting - 2 * step))
        return _note(script, kind, now, now + 5.0)
    if kind == "sleep":
        script.sleeps.append((now, now + float(rng.uniform(10, 25))))
        return _note(script, kind, now, script.sleeps[-1][1] + 5.0)
    if kind == "lost":
        script.gaps.append((now, now + float(rng.uniform(2, 6))))
        return script.gaps[-1][1] - 4.0  # so that joints fall into some of them
    if kind == "pair":
        middle = _touch(script, str(rng.choice(["small", "medium"])), now, rng, "pair")
        return _touch(
            script,
            str(rng.choice(["small", "medium"])),
            middle + float(rng.uniform(1.0, 1.5)),
            rng,
            "pair",
        )
    return _touch(script, kind, now, rng, kind)


def _touch(script: Script, kind: str, now: float, rng: np.random.Generator, told: str) -> float:
    contacts = list(_contacts(kind, now, rng))
    script.contacts += contacts
    return _note(script, told, now, contacts[-1].end)


def _note(script: Script, kind: str, start: float, end: float) -> float:
    script.truths.append(Truth(start, end, kind))
    return end


def _contacts(kind: str, now: float, rng: np.random.Generator) -> Iterator[Contact]:
    """The touches of one event: sizes in W/K, J/K and W/K, as a soldering iron's work has them."""

    def some(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    match kind:
        case "small":
            yield Contact(
                now,
                now + some(0.7, 1.1),
                some(0.15, 0.30),
                some(0.03, 0.08),
                some(0.03, 0.06),
                BOARD_C,
            )
        case "medium":
            yield Contact(
                now,
                now + some(1.0, 2.0),
                some(0.25, 0.50),
                some(0.08, 0.20),
                some(0.04, 0.10),
                BOARD_C,
            )
        case "large":
            yield Contact(
                now,
                now + some(1.5, 3.5),
                some(0.40, 0.80),
                some(0.20, 0.50),
                some(0.10, 0.25),
                BOARD_C,
            )
        case "saturated":
            yield Contact(
                now,
                now + some(2.0, 4.0),
                some(0.80, 1.20),
                some(0.60, 1.20),
                some(0.30, 0.50),
                BOARD_C,
            )
        case "double":
            work = some(0.25, 0.50), some(0.08, 0.20), some(0.05, 0.12)
            first = Contact(now, now + some(0.5, 1.0), *work, BOARD_C)
            again = first.end + some(0.2, 0.5)
            yield from (first, Contact(again, again + some(0.5, 1.0), *work, None))
        case "touch":
            yield Contact(now, now + some(0.2, 0.8), some(0.010, 0.030), 0.5, 0.5, BOARD_C)
        case "soak":
            yield Contact(now, now + some(0.8, 1.5), some(0.15, 0.40), 1000.0, 0.0, 98.0)
        case "sponge" | "brass":
            yield from _strokes(kind, now, rng)


def _strokes(kind: str, now: float, rng: np.random.Generator) -> Iterator[Contact]:
    wet = kind == "sponge"
    for _ in range(int(rng.integers(1, 4) if wet else rng.integers(2, 5))):
        end = now + float(rng.uniform(0.15, 0.35) if wet else rng.uniform(0.2, 0.4))
        conductance = float(rng.uniform(0.15, 0.40) if wet else rng.uniform(0.02, 0.05))
        yield Contact(now, end, conductance, 1000.0 if wet else 0.3, 0.0, 98.0 if wet else BOARD_C)
        now = end + float(rng.uniform(0.4, 0.8) if wet else rng.uniform(0.3, 0.6))


# -- the physics, of all trials at once ------------------------------------------------------------


@dataclass
class Plants:
    """The constants of each trial, a value a trial."""

    rated_w: Floats
    heater: Floats  # J/K
    tip: Floats  # J/K
    between: Floats  # W/K from heater to tip
    loss: Floats  # W/K to the air
    sees_tip: Floats  # share of the tip in what the thermocouple feels
    lag_s: Floats
    gain: Floats  # of the whole power per K
    integral_s: Floats
    rate_s: Floats
    noise_c: Floats


def plants_of(seeds: Sequence[int]) -> Plants:
    """Other time constants in every trial."""
    rngs = [np.random.default_rng([seed, 1]) for seed in seeds]

    def each(low: float, high: float) -> Floats:
        return np.array([rng.uniform(low, high) for rng in rngs])

    return Plants(
        each(90, 150),
        each(0.25, 0.60),
        each(0.6, 1.8),
        each(2.0, 5.0),
        each(0.02, 0.05),
        each(0.3, 0.8),
        each(0.05, 0.20),
        each(0.02, 0.05),
        each(0.8, 2.0),
        each(0.0, 0.10),
        each(0.2, 0.6),
    )


@dataclass
class Recorded:
    """What could be seen at every step: a row a trial, a column a step."""

    temperature: Floats
    power: Floats


def simulate(plants: Plants, scripts: Sequence[Script], steps: int) -> Recorded:
    """All trials, in steps of `STEP_S`."""
    trials, rows = len(scripts), np.arange(len(scripts))
    contact, table = contact_at(scripts, steps)
    aim = np.array([aims(script, steps) for script in scripts])
    heater, tip, felt = (np.full(trials, AMBIENT_C) for _ in range(3))
    work, wetted, before = np.full(trials, BOARD_C), np.zeros(trials), np.full(trials, -1)
    integral, owed, asked, told = (
        np.zeros(trials),
        np.zeros(trials),
        np.zeros(trials),
        np.zeros(trials),
    )
    felt_before, firing = felt.copy(), np.zeros(trials)
    out = Recorded(np.empty((trials, steps)), np.empty((trials, steps)))
    for step in range(steps):
        touching = contact[:, step]
        if step % 2 == 0:  # the regulator's clock: one mains cycle
            error = aim[:, step] - felt
            rate, felt_before = (felt - felt_before) / 0.02, felt.copy()
            wanted = plants.gain * (error - plants.rate_s * rate) + integral
            integral = np.where(
                (wanted < 1) & (wanted > -0.2),
                integral + plants.gain * error * 0.02 / plants.integral_s,
                integral,
            )
            integral, asked = np.clip(integral, 0, 1), np.clip(wanted, 0, 1)
            owed = owed + asked
            firing = (owed >= 1).astype(np.float64)
            owed = owed - firing
        conductance, capacity, leak, begins = (
            table[rows, touching + 1, column] for column in range(4)
        )
        fresh = (touching != before) & ~np.isnan(begins)
        work, before = np.where(fresh, begins, work), touching
        wetted = np.where(touching < 0, 0.0, wetted + STEP_S * (1 - wetted) / 0.08)
        flow = conductance * wetted * (tip - work)
        across = plants.between * (heater - tip)
        heater = (
            heater
            + STEP_S
            * (plants.rated_w * firing - across - 0.3 * plants.loss * (heater - AMBIENT_C))
            / plants.heater
        )
        tip = tip + STEP_S * (across - flow - 0.7 * plants.loss * (tip - AMBIENT_C)) / plants.tip
        work = work + STEP_S * (flow - leak * (work - BOARD_C)) / capacity
        felt = (
            felt
            + STEP_S
            * (plants.sees_tip * tip + (1 - plants.sees_tip) * heater - felt)
            / plants.lag_s
        )
        told = told + STEP_S * (asked - told) / 0.06
        out.temperature[:, step], out.power[:, step] = felt, told
    return out


def contact_at(scripts: Sequence[Script], steps: int) -> tuple[NDArray[np.int64], Floats]:
    """Which contact there is at each step (-1: none), and each trial's contacts, the first of them
    none.
    """
    most = max((len(script.contacts) for script in scripts), default=0)
    table = np.tile(np.array([0.0, 0.2, 0.1, np.nan]), (len(scripts), most + 1, 1))
    contact = np.full((len(scripts), steps), -1)
    for row, script in enumerate(scripts):
        for number, one in enumerate(script.contacts):
            contact[row, round(one.start / STEP_S) : round(one.end / STEP_S)] = number
            begins = np.nan if one.begins_c is None else one.begins_c
            table[row, number + 1] = one.conductance, one.capacity, one.leak, begins
    return contact, table


def aims(script: Script, steps: int) -> Floats:
    """What the regulator aims at, at each step."""
    aim = np.empty(steps)
    for start, setting in script.settings:
        aim[round(start / STEP_S) :] = setting
    for start, end in script.sleeps:
        aim[round(start / STEP_S) : round(end / STEP_S)] = SLEEP_C
    return aim


# -- the record ------------------------------------------------------------------------------------


def trials(
    seeds: Sequence[int], seconds: float = TRIAL_S, rates: Sequence[float] = (10.0, 5.0, 2.0, 1.0)
) -> dict[float, list[Trial]]:
    """The same trials as recorded at each of `rates` in Hz."""
    plants, steps = plants_of(seeds), round(seconds / STEP_S)
    scripts = [script_of(np.random.default_rng([seed, 2]), seconds) for seed in seeds]
    seen = simulate(plants, scripts, steps)
    return {
        hz: [_recorded(plants, scripts[n], seen, n, seed, hz) for n, seed in enumerate(seeds)]
        for hz in rates
    }


def _recorded(
    plants: Plants, script: Script, seen: Recorded, row: int, seed: int, hz: float
) -> Trial:
    """One trial at one rate: each tick is read up to 15 ms late, one reading of 200 is lost."""
    rng = np.random.default_rng([seed, 3, round(hz)])
    ticks = np.arange(int(seen.power.shape[1] * STEP_S * hz)) / hz
    at = np.minimum(
        ((ticks + rng.uniform(0, 0.015, len(ticks))) / STEP_S).astype(np.int64),
        seen.power.shape[1] - 1,
    )
    temperature = np.round(seen.temperature[row, at] + rng.normal(0, plants.noise_c[row], len(at)))
    power = np.round(seen.power[row, at] * 100) * 10.0
    working = np.ones(len(at), dtype=np.bool_)
    for start, end in script.sleeps:
        working[(ticks >= start) & (ticks < end)] = False
    lost = rng.random(len(at)) < 0.005
    for start, end in script.gaps:
        lost |= (ticks >= start) & (ticks < end)
    temperature[lost] = power[lost] = np.nan
    setting = np.full(len(at), np.nan)
    for start, value in script.settings:
        setting[ticks >= start] = value
    setting[(np.arange(len(at)) % max(round(5 * hz), 1) != 0) | lost] = np.nan
    return Trial(ticks, temperature, power, setting, working & ~lost, script.truths, script.gaps)
