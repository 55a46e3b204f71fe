"""A tip that is soldered with by the script: joints where the test says, on the simulator's own
tip, as the samples have it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.series import Series
from jbclog.analysis.verdict.idle import Block
from jbclog.sim.tip import Tip

STEP_S = 0.02
Floats = NDArray[np.float64]
Contact = tuple[float, float]


def soldered(
    contacts: Sequence[Contact],
    seconds: float,
    hz: float = 10.0,
    begins_c: float = 23.0,
    settings: Sequence[tuple[float, float]] = ((0.0, 350.0),),
    conductance: float = 0.3,
    leak: float = 0.08,
    rated_w: float = 130.0,
    noise_c: float = 0.3,
    seed: int = 1,
) -> Series:
    """A record of `seconds`: the tip touches fresh work (0.15 J/K, 40 °C) from and to these
    seconds; W/K, W, °C.

    `leak` is what the work gives to its board, W/K.
    """
    steps = round(seconds / STEP_S)
    tip, work, owner = Tip(begins_c, rated_w), 40.0, -1
    at, temperature, power, aim = (
        np.arange(steps) * STEP_S,
        np.empty(steps),
        np.empty(steps),
        np.empty(steps),
    )
    for start, celsius in settings:
        aim[at >= start] = celsius
    contact = np.full(steps, -1)
    for number, (start, end) in reversed([*enumerate(contacts)]):
        contact[(start <= at) & (at < end)] = number
    for step, (setpoint_c, touching) in enumerate(zip(aim.tolist(), contact.tolist(), strict=True)):
        work, owner = (40.0 if touching != owner else work), touching
        tip.step(STEP_S, setpoint_c, conductance if touching >= 0 else 0.0, work)
        if touching >= 0:
            flow = conductance * (tip.temperature_c - work)
            work += STEP_S * (flow - leak * (work - 40.0)) / 0.15
        temperature[step], power[step] = tip.temperature_c, 1000 * tip.power_w / rated_w
    return _read(temperature, power, aim, seconds, hz, noise_c, seed)


def _read(
    temperature: Floats,
    power: Floats,
    aim: Floats,
    seconds: float,
    hz: float,
    noise_c: float,
    seed: int,
) -> Series:
    rng = np.random.default_rng(seed)
    at = np.arange(round(seconds * hz)) / hz
    rows = np.minimum((at / STEP_S).astype(np.int64), len(power) - 1)
    setting = aim[rows].copy()
    setting[np.arange(len(at)) % max(round(5 * hz), 1) != 0] = np.nan
    there = np.ones(len(at), dtype=np.bool_)
    read = np.round(temperature[rows] + rng.normal(0, noise_c, len(at)))
    return Series(
        Block(at, read, np.round(power[rows]), setting, there), there, 1 / hz, rated_w=130.0
    )


def shown_late(series: Series, rows: int) -> Series:
    """The same with its temperature shown so many rows later than it was."""
    temperature = series.rows.temperature
    late = np.concatenate([np.full(rows, temperature[0]), temperature[: len(temperature) - rows]])
    return replace(series, rows=replace(series.rows, temperature=late))


def after(first: Series, second: Series, gap_s: float) -> Series:
    """Two records as one, the second beginning so long after the first: another tool of the same
    code, pulled and put in.
    """
    shift = float(first.seconds[-1]) + gap_s
    one, other = first.rows, second.rows
    missing = np.arange(1, round(gap_s / first.period_s)) * first.period_s + float(
        first.seconds[-1]
    )
    none = np.full(len(missing), np.nan)
    columns = [
        np.concatenate([getattr(one, name), none, getattr(other, name)])
        for name in ("temperature", "power", "setting")
    ]
    working = np.concatenate([one.working, np.zeros(len(missing), dtype=np.bool_), other.working])
    tool = np.concatenate(
        [np.full(len(one.seconds), 1.0), np.zeros(len(missing)), np.full(len(other.seconds), 1.0)]
    )
    seconds = np.concatenate([one.seconds, missing, other.seconds + shift])
    rows = Block(seconds, *columns, working, tool, np.zeros(len(seconds)))
    return replace(first, rows=rows, known=np.ones(len(seconds), dtype=np.bool_))
