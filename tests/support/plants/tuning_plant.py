"""The plant on which finding joints was tuned: the tip of `jbclog sim` with work of other sizes
than the demo's.

One heat capacity under a proportional and integral regulator (`jbclog.sim.tip`), half of them with
a second one behind a resistance; the reading may lag. Its shares, sizes and
seeds have nothing to do with those of `second_plant`, on which nothing is tuned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jbclog.sim.tip import Tip
from support.plants.second_plant import Floats, Trial, Truth

SEEDS = tuple(range(1, 81))
STEP_S, TRIAL_S = 0.02, 300.0
KINDS = [
    "small",
    "medium",
    "large",
    "saturated",
    "double",
    "pair",
    "touch",
    "sponge",
    "brass",
    "set",
    "sleep",
]
SHARES = np.array([4, 6, 4, 1, 2, 2, 2, 2, 2, 1, 0.5])


@dataclass(frozen=True)
class Load:
    """What the tip touches from `start` to `end`: W/K, J/K (infinite: keeps its temperature), W/K
    to the board, °C.
    """

    start: float
    end: float
    conductance: float
    capacity: float
    leak: float
    celsius: float


SIZES = {  # dwell s, conductance W/K, capacity J/K, leak W/K
    "small": ((0.7, 1.2), (0.10, 0.35), (0.03, 0.12), (0.025, 0.08)),
    "medium": ((0.9, 2.0), (0.20, 0.50), (0.08, 0.30), (0.05, 0.12)),
    "large": ((1.5, 3.5), (0.30, 0.80), (0.20, 0.60), (0.10, 0.30)),
    "saturated": ((2.0, 4.0), (0.80, 1.50), (0.50, 1.50), (0.30, 0.60)),
    "touch": ((0.2, 0.8), (0.005, 0.03), (0.5, 1.0), (0.3, 0.5)),
}


def trial(seed: int, hz: float = 10.0, seconds: float = TRIAL_S) -> Trial:
    """One record of a tip that is soldered with, as the samples have it."""
    rng = np.random.default_rng([seed, 77])
    truths, loads, settings, sleeps = _script(rng, seconds)
    temperature, power = _run(rng, loads, settings, sleeps, seconds)
    ticks = np.arange(int(seconds * hz)) / hz
    at = np.minimum((ticks / STEP_S + rng.uniform(0, 1, len(ticks))).astype(int), len(power) - 1)
    noise = rng.normal(0, rng.uniform(0.0, 0.8), len(at))
    setting = np.full(len(ticks), np.nan)
    setting[:: max(round(5 * hz), 1)] = 1.0
    for start, celsius in settings:
        setting[(ticks >= start) & ~np.isnan(setting)] = celsius
    working = np.ones(len(ticks), dtype=np.bool_)
    for start, end in sleeps:
        working[(ticks >= start) & (ticks < end)] = False
    return Trial(
        ticks, np.round(temperature[at] + noise), np.round(power[at]), setting, working, truths, []
    )


Script = tuple[list[Truth], list[Load], list[tuple[float, float]], list[tuple[float, float]]]


def _script(rng: np.random.Generator, seconds: float) -> Script:
    truths: list[Truth] = []
    loads: list[Load] = []
    settings, sleeps = [(0.0, float(rng.integers(62, 80) * 5))], []
    now = 12.0
    while now < seconds - 20:
        kind = str(rng.choice(KINDS, p=SHARES / SHARES.sum()))
        end = now + 5.0
        if kind == "set":
            settings.append(
                (now, float(np.clip(settings[-1][1] + rng.choice([-40, -25, 25, 40]), 290, 410)))
            )
        elif kind == "sleep":
            end = now + float(rng.uniform(8, 20))
            sleeps.append((now, end))
        elif kind == "pair":
            first = _joint("small", now, rng)
            second = _joint("medium", first.end + float(rng.uniform(1.0, 1.6)), rng)
            loads += [first, second]
            truths.append(Truth(first.start, first.end, kind))
            now, end = second.start, second.end
        else:
            new = _loads(kind, now, rng)
            loads += new
            end = new[-1].end
        truths.append(Truth(now, end, kind))
        now = end + float(rng.uniform(2.5, 6.0))
    return truths, loads, settings, sleeps


def _joint(kind: str, now: float, rng: np.random.Generator) -> Load:
    dwell, conductance, capacity, leak = (float(rng.uniform(*bounds)) for bounds in SIZES[kind])
    return Load(now, now + dwell, conductance, capacity, leak, float(rng.uniform(30, 110)))


def _loads(kind: str, now: float, rng: np.random.Generator) -> list[Load]:
    if kind in SIZES:
        return [_joint(kind, now, rng)]
    if kind == "double":
        one = _joint("medium", now, rng)
        middle = now + float(rng.uniform(0.5, 0.9))
        again = middle + float(rng.uniform(0.2, 0.45))
        last = again + float(rng.uniform(0.5, 0.9))
        return [
            Load(now, middle, one.conductance, one.capacity, one.leak, one.celsius),
            Load(again, last, one.conductance, one.capacity, one.leak, 180.0),
        ]
    loads, wet = [], kind == "sponge"
    for _ in range(int(rng.integers(1, 4))):
        end = now + float(rng.uniform(0.12, 0.35))
        conductance = float(rng.uniform(0.1, 0.45) if wet else rng.uniform(0.015, 0.06))
        loads.append(Load(now, end, conductance, np.inf, 0.0, 98.0 if wet else 50.0))
        now = end + float(rng.uniform(0.4, 0.9))
    return loads


def _run(
    rng: np.random.Generator,
    loads: Sequence[Load],
    settings: Sequence[tuple[float, float]],
    sleeps: Sequence[tuple[float, float]],
    seconds: float,
) -> tuple[Floats, Floats]:
    """Temperature as read, and power in ‰, at each step."""
    tip, lag, steps = (
        Tip(23.0, float(np.exp(rng.uniform(np.log(50), np.log(160))))),
        float(rng.uniform(0.01, 0.25)),
        round(seconds / STEP_S),
    )
    seen, temperature, power = 23.0, np.empty(steps), np.empty(steps)
    across, heavy, point = (
        float(rng.choice([0.0, rng.uniform(1.5, 5.0)])),
        float(rng.uniform(0.3, 1.5)),
        23.0,
    )
    pending, now_load, work = list(loads), None, 0.0
    for step in range(steps):
        now = step * STEP_S
        aim = next(celsius for start, celsius in reversed(settings) if start <= now)
        aim = 150.0 if any(start <= now < end for start, end in sleeps) else aim
        if now_load is not None and now >= now_load.end:
            now_load = None
        if pending and now >= pending[0].start:
            now_load = pending.pop(0)
            work = now_load.celsius
        touching = now_load.conductance if now_load else 0.0
        if across:  # every other tip has its point behind a resistance
            tip.step(STEP_S, aim, across, point)
            flow = touching * (point - work)
            point += STEP_S * (across * (tip.temperature_c - point) - flow) / heavy
        else:
            tip.step(STEP_S, aim, touching, work)
            flow = touching * (tip.temperature_c - work)
        if now_load is not None:
            work += STEP_S * (flow - now_load.leak * (work - 40.0)) / now_load.capacity
        seen += (tip.temperature_c - seen) * (1 - np.exp(-STEP_S / lag))
        temperature[step], power[step] = seen, 1000 * tip.power_w / tip.rated_w
    return temperature, power
