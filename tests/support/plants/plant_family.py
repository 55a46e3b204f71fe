"""A family of plants, on which finding joints is tuned besides the simulator and the second plant:
no two trials are alike.

Each trial draws from its seed: heat capacities of heater and tip, the resistance between them, the
loss, how much of it is radiation and how it wanders with the air, where the sensor sits and how it
lags, its noise; how the told power comes about (mean over a window, late, with noise, in steps);
how fast work is wetted; and one of five control laws (`LAWS`). Temperature is told in whole
degrees.

==========  =======================================================================================
pid         PID with feed-forward of the loss and a limit of the rate at which power changes; power
            as asked
on_off      all or nothing with hysteresis, and a shortest time for each
bursts      PI that fires whole mains cycles
droop       proportional with a slow integral part, in steps of 5 %
boost       all power while far below the setting, else PI with a low gain
==========  =======================================================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from support.plants.second_plant import (
    AMBIENT_C,
    BOARD_C,
    STEP_S,
    Floats,
    Recorded,
    Script,
    aims,
    contact_at,
)

LAWS = ("pid", "on_off", "bursts", "droop", "boost")
CLOCK = 2  # steps between two decisions of the regulator


@dataclass
class Plants:
    """The constants of each trial, a value a trial."""

    law: Floats  # place in LAWS
    rated_w: Floats
    heater: Floats  # J/K
    tip: Floats  # J/K
    between: Floats  # W/K
    loss: Floats  # W/K near the setting
    radiates: Floats  # share of the loss that grows with the fourth power
    sees_tip: Floats
    lag_s: Floats
    noise_c: Floats
    gain: Floats  # of the whole power per K
    integral_s: Floats
    rate_s: Floats
    change: Floats  # of the whole power per s
    hysteresis_k: Floats
    shortest_s: Floats
    window_s: Floats
    late_s: Floats
    step: Floats  # of the told power, ‰
    wets_s: Floats
    draught: Floats  # share by which the loss wanders
    wanders_s: Floats
    told_noise: Floats  # ‰


def plants_of(seeds: Sequence[int], sizes: Floats) -> Plants:
    """Of tips that are `sizes` times as large as a medium one."""
    rngs = [np.random.default_rng([seed, 1]) for seed in seeds]

    def each(low: float, high: float) -> Floats:
        return np.array([rng.uniform(low, high) for rng in rngs])

    def spread(low: float, high: float) -> Floats:
        return np.exp(each(np.log(low), np.log(high)))

    return Plants(
        np.array([rng.integers(len(LAWS)) for rng in rngs]),
        spread(70, 170) * sizes,
        spread(0.15, 0.8) * sizes,
        spread(0.4, 1.8) * sizes,
        spread(1.5, 8.0) * sizes,
        each(0.02, 0.06) * sizes,
        each(0.0, 0.3),
        each(0.0, 1.0),
        each(0.02, 0.30),
        each(0.05, 0.7),
        spread(0.008, 0.06),
        each(0.7, 4.0),
        each(0.0, 0.15),
        spread(2.0, 40.0),
        each(0.3, 1.5),
        each(0.02, 0.2),
        each(0.04, 0.4),
        each(0.0, 0.12),
        np.array([rng.choice([1.0, 5.0, 10.0]) for rng in rngs]),
        each(0.03, 0.12),
        each(0.0, 0.15),
        spread(3.0, 40.0),
        np.maximum(each(-20.0, 40.0), 0.0),
    )


@dataclass
class Regulator:
    """What the five laws remember, a value a trial."""

    integral: Floats
    asked: Floats
    owed: Floats
    before: Floats
    since_s: Floats


def simulate(plants: Plants, scripts: Sequence[Script], steps: int) -> Recorded:
    """All trials, in steps of `STEP_S`."""
    trials, rows = len(scripts), np.arange(len(scripts))
    contact, table = contact_at(scripts, steps)
    aim = np.array([aims(script, steps) for script in scripts])
    heater, tip, felt = (np.full(trials, AMBIENT_C) for _ in range(3))
    work, wetted, before = np.full(trials, BOARD_C), np.zeros(trials), np.full(trials, -1)
    regulator = Regulator(
        np.zeros(trials), np.zeros(trials), np.zeros(trials), felt.copy(), np.ones(trials)
    )
    firing, wind = np.zeros(trials), np.zeros(trials)
    rng = np.random.default_rng(7)
    out = Recorded(np.empty((trials, steps)), np.empty((trials, steps)))
    for step in range(steps):
        touching = contact[:, step]
        if step % CLOCK == 0:
            firing = _decided(plants, regulator, aim[:, step], felt)
        conductance, capacity, leak, begins = (
            table[rows, touching + 1, column] for column in range(4)
        )
        fresh = (touching != before) & ~np.isnan(begins)
        work, before = np.where(fresh, begins, work), touching
        wetted = np.where(touching < 0, 0.0, wetted + STEP_S * (1 - wetted) / plants.wets_s)
        flow = conductance * wetted * (tip - work)
        across = plants.between * (heater - tip)
        pull = STEP_S / plants.wanders_s
        wind = wind * (1 - pull) + plants.draught * np.sqrt(2 * pull) * rng.normal(0, 1, trials)
        heater = (
            heater
            + STEP_S
            * (plants.rated_w * firing - across - 0.4 * (1 + wind) * _loss(plants, heater))
            / plants.heater
        )
        tip = tip + STEP_S * (across - flow - 0.6 * (1 + wind) * _loss(plants, tip)) / plants.tip
        work = work + STEP_S * (flow - leak * (work - BOARD_C)) / capacity
        felt = (
            felt
            + STEP_S
            * (plants.sees_tip * tip + (1 - plants.sees_tip) * heater - felt)
            / plants.lag_s
        )
        out.temperature[:, step], out.power[:, step] = felt, firing
    return Recorded(
        out.temperature, np.array([_told(plants, row, out.power[row]) for row in range(trials)])
    )


def _loss(plants: Plants, celsius: Floats) -> Floats:
    """W to the air; `loss` per K at 350 °C, more above and less below."""
    return (
        plants.loss
        * (celsius - AMBIENT_C)
        * (1 + plants.radiates * (((celsius + 273) / 623) ** 3 - 1))
    )


def _decided(plants: Plants, regulator: Regulator, aim: Floats, felt: Floats) -> Floats:
    """The share of the whole power that the heater gets until the next decision."""
    clock, error = CLOCK * STEP_S, aim - felt
    rate, regulator.before = (felt - regulator.before) / clock, felt.copy()
    gain = np.where(plants.law == LAWS.index("droop"), 0.7 * plants.gain, plants.gain)
    forward = np.where(
        plants.law == LAWS.index("pid"), plants.loss * (aim - AMBIENT_C) / plants.rated_w, 0.0
    )
    damped = np.isin(plants.law, [LAWS.index("pid"), LAWS.index("bursts")]) * plants.rate_s * rate
    integral_s = np.where(
        plants.law == LAWS.index("droop"), 4 * plants.integral_s, plants.integral_s
    )
    wanted = gain * (error - damped) + regulator.integral + forward
    winds = (wanted < 1) & (wanted > -0.1)
    regulator.integral = np.clip(
        regulator.integral + winds * gain * error * clock / integral_s, -1, 1
    )
    limit = np.where(plants.law == LAWS.index("pid"), plants.change * clock, 1.0)
    asked = np.clip(np.clip(wanted, 0, 1), regulator.asked - limit, regulator.asked + limit)
    asked = np.where(plants.law == LAWS.index("droop"), np.round(20 * asked) / 20, asked)
    asked = np.where((plants.law == LAWS.index("boost")) & (error > 12), 1.0, asked)
    regulator.since_s += clock
    turned = np.where(
        error > plants.hysteresis_k,
        1.0,
        np.where(error < -plants.hysteresis_k, 0.0, regulator.asked),
    )
    turned = np.where(regulator.since_s >= plants.shortest_s, turned, regulator.asked)
    asked = np.where(plants.law == LAWS.index("on_off"), np.round(turned), asked)
    regulator.since_s = np.where(asked != regulator.asked, 0.0, regulator.since_s)
    regulator.asked = asked
    regulator.owed = regulator.owed + asked
    fires = regulator.owed >= 1
    regulator.owed = regulator.owed - fires
    return np.where(plants.law == LAWS.index("bursts"), fires, asked)


def _told(plants: Plants, row: int, fired: Floats) -> Floats:
    """The share of the whole power as the station tells it: a mean over its window, late."""
    window, late = max(round(plants.window_s[row] / STEP_S), 1), round(plants.late_s[row] / STEP_S)
    sums = np.concatenate((np.zeros(window + late), np.cumsum(fired)))
    mean = (sums[window : window + len(fired)] - sums[: len(fired)]) / window
    told = 1000 * mean + np.random.default_rng([row, 9]).normal(
        0, plants.told_noise[row], len(fired)
    )
    return np.asarray(np.clip(np.round(told / plants.step[row]) * plants.step[row], 0, 1000) / 1000)
