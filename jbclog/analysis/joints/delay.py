"""By how much a station shows the temperature later than the power, from what its regulator does.

A regulator acts on the temperature that it measures: where that falls, power rises, at once or soon, in contact and without. So
power that is shown rising before the temperature is shown falling says that the temperature is shown late. No model of the tip is
needed, nor where contacts are. The delay is where the rate of change of the power and that of the temperature, turned around, agree
best: the maximum of their cross-correlation (C. H. Knapp, G. C. Carter, IEEE Trans. ASSP 24, 1976), of smoothed readings, between
rows by a parabola through three. Readings at the regulator's limits, where power does not follow, are left out.

It is the difference of the two: a power that is shown late as well hides as much of it, and so does a regulator that hesitates.
A negative one is of these, and is no delay of the temperature. A regulator that looks ahead (the derivative of a PID) leads by
itself; so what is less than `LEAST_S` is no delay either.

Where the two correlate by less than `LEAST_AGREES`, the record does not tell. The uncertainty is the jackknife's over `BLOCKS`
pieces of the record (B. Efron, The Jackknife, 1982): of the maximum's place, not of what hides a part of the delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.heat_up_end import Readied
from jbclog.analysis.joints.thermal import Delay, smooth
from jbclog.analysis.verdict.idle import Floats

RANGE_S: Final = (-0.5, 0.9)
SMOOTH_S, SMOOTH_PERIODS = 0.12, 0.7
LIMITS_PERMILLE: Final = (20.0, 980.0)
LEAST_S: Final = 0.1
SLOWEST_S: Final = 0.25
BLOCKS: Final = 8
LEAST_ROWS: Final = 100
MOST_UNSURE_S: Final = 0.1
LEAST_AGREES: Final = 0.6  # noise reaches 0.1; regulators of all kinds 0.4 to 1

Rows = NDArray[np.int64]


def delay_of(parts: Sequence[Readied]) -> Delay:
    """The delay of a tool's temperature behind its power, and how many rows that is."""
    period = parts[0].stretch.period_s
    if period > SLOWEST_S:
        return Delay(why=f"Readings {period:g} s apart do not show it.")
    later = np.arange(round(RANGE_S[0] / period), round(RANGE_S[1] / period) + 1)
    blocks, rows = _agreement(parts, later)
    if rows < LEAST_ROWS:
        return Delay(why=f"The regulator followed the temperature in {rows} readings; it takes {LEAST_ROWS}.")
    agrees = blocks.sum(axis=0)
    if agrees.max() < LEAST_AGREES:
        return Delay(why=f"Power and falling temperature correlate by {agrees.max():.2f} at the most; it takes {LEAST_AGREES:g}.")
    whole = _greatest(agrees, later)
    without = np.array([_greatest(agrees - block, later) for block in blocks])
    seconds, unsure_s = whole * period, float(np.sqrt((BLOCKS - 1) * without.var())) * period
    if not unsure_s <= MOST_UNSURE_S:
        return Delay(why="It is not the same in all parts of the record, or beyond what a station has.")
    if seconds < max(LEAST_S, 2 * unsure_s):
        return Delay(seconds, unsure_s)
    return Delay(seconds, unsure_s, rows=round(whole), moved_s=seconds)


def _agreement(parts: Sequence[Readied], later: Rows) -> tuple[Floats, int]:
    """How well rising power agrees with the temperature falling so many rows later, by block and delay; of how many rows.

    The blocks add up to the coefficients of correlation.
    """
    period = parts[0].stretch.period_s
    sigma = max(SMOOTH_S / period, SMOOTH_PERIODS)
    products: list[Floats] = []
    squares = np.zeros(2)
    for part in parts:
        rises, falls = smooth(part.stretch.power, sigma, 1), -smooth(part.stretch.temperature, sigma, 1)
        follows = part.ready & (part.stretch.power > LIMITS_PERMILLE[0]) & (part.stretch.power < LIMITS_PERMILLE[1])
        products.append(np.stack([rises * _moved(falls, rows) for rows in later.tolist()], axis=1)[follows])
        squares += np.square(rises[follows]).sum(), np.square(falls[follows]).sum()
    every = np.concatenate(products)
    if len(every) < LEAST_ROWS or not squares.all():
        return np.zeros((BLOCKS, len(later))), len(every)
    begins = np.linspace(0, len(every), BLOCKS + 1).astype(np.int64)[:-1]
    return np.add.reduceat(every, begins) / float(np.sqrt(squares.prod())), len(every)


def _moved(values: Floats, rows: int) -> Floats:
    """The values so many rows ahead; nothing beyond the record."""
    moved = np.zeros(len(values))
    if abs(rows) < len(values):
        moved[max(-rows, 0) : len(values) - max(rows, 0)] = values[max(rows, 0) : len(values) + min(rows, 0)]
    return moved


def _greatest(agrees: Floats, later: Rows) -> float:
    """At how many rows it is greatest; NaN at the end of the range."""
    place = int(agrees.argmax())
    if not 0 < place < len(agrees) - 1:
        return float("nan")
    before, here, after = agrees[place - 1 : place + 2]
    return float(later[place] + 0.5 * (before - after) / (before - 2 * here + after))
