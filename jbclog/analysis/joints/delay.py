"""How much later than the power a station reports the temperature, from its regulator.

A regulator acts on the temperature that it measures: when that falls, power rises, at once or soon,
in contact and without. So power that rises before the reported temperature falls shows that the
temperature comes late. This needs neither a model of the tip nor the contacts. The delay is where
the rate of change of the power and the negative rate of change of the temperature agree best: the
maximum of their cross-correlation (C. H. Knapp, G. C. Carter, IEEE Trans. ASSP 24, 1976) over
smoothed readings, between rows by a parabola through three. Readings at the regulator's limits,
where power does not follow, are left out.

The result is a difference of two delays: late power or a slow regulator hides as much of it, and
can make it negative, which is no delay of the temperature. A regulator that looks ahead (the
derivative of a PID) also leads, so less than `LEAST_S` is no delay.

Below a correlation of `LEAST_CORRELATION` the delay is not known. Its uncertainty is the jackknife
over `BLOCKS` pieces of the record (B. Efron, The Jackknife, 1982): that of the position of the
maximum, not of what hides a part of the delay.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.heat_up_end import ReadyStretch
from jbclog.analysis.joints.thermal import Delay, smooth
from jbclog.analysis.port_data import Floats

RANGE_S: Final = (-0.5, 0.9)  # compared delays
SMOOTH_S, SMOOTH_PERIODS = 0.12, 0.7
LIMITS_PERMILLE: Final = (20.0, 980.0)  # the regulator follows the temperature between these
LEAST_S: Final = 0.1
SLOWEST_S: Final = 0.25  # longest period; slower readings do not show the delay
BLOCKS: Final = 8
LEAST_ROWS: Final = 100
MOST_UNSURE_S: Final = 0.1
LEAST_CORRELATION: Final = 0.6  # noise reaches 0.1; regulators of all kinds reach 0.4 to 1

Rows = NDArray[np.int64]


def delay_of(parts: Sequence[ReadyStretch]) -> Delay:
    """Return the delay of a tool's temperature behind its power, in seconds and in rows, or why it
    is not known.
    """
    period = parts[0].stretch.period_s
    if period > SLOWEST_S:
        return Delay(why=f"Readings {period:g} s apart do not show it.")
    lags = np.arange(round(RANGE_S[0] / period), round(RANGE_S[1] / period) + 1)
    blocks, rows = _cross_correlation(parts, lags)
    if rows < LEAST_ROWS:
        return Delay(
            why=f"The regulator followed the temperature in {rows} readings; it takes {LEAST_ROWS}."
        )
    correlation = blocks.sum(axis=0)
    if correlation.max() < LEAST_CORRELATION:
        return Delay(
            why=(
                f"Power and falling temperature correlate by {correlation.max():.2f} at the most;"
                f" it takes {LEAST_CORRELATION:g}."
            )
        )
    whole = _peak_lag(correlation, lags)
    jackknife = np.array([_peak_lag(correlation - block, lags) for block in blocks])
    seconds, unsure_s = whole * period, float(np.sqrt((BLOCKS - 1) * jackknife.var())) * period
    if not unsure_s <= MOST_UNSURE_S:
        return Delay(
            why="It is not the same in all parts of the record, or beyond what a station has."
        )
    if seconds < max(LEAST_S, 2 * unsure_s):
        return Delay(seconds, unsure_s)
    return Delay(seconds, unsure_s, rows=round(whole), moved_s=seconds)


def _cross_correlation(parts: Sequence[ReadyStretch], lags: Rows) -> tuple[Floats, int]:
    """Return how well rising power agrees with a fall of the temperature `lags` rows later, and the
    number of rows used.

    The array has a row per block and a column per lag; the blocks add up to the correlation
    coefficients.
    """
    period = parts[0].stretch.period_s
    sigma = max(SMOOTH_S / period, SMOOTH_PERIODS)
    products: list[Floats] = []
    squares = np.zeros(2)
    for part in parts:
        rises = smooth(part.stretch.power, sigma, 1)
        falls = -smooth(part.stretch.temperature, sigma, 1)
        follows = (
            part.ready
            & (part.stretch.power > LIMITS_PERMILLE[0])
            & (part.stretch.power < LIMITS_PERMILLE[1])
        )
        products.append(
            np.stack([rises * _shifted(falls, rows) for rows in lags.tolist()], axis=1)[follows]
        )
        squares += np.square(rises[follows]).sum(), np.square(falls[follows]).sum()
    every = np.concatenate(products)
    if len(every) < LEAST_ROWS or not squares.all():
        return np.zeros((BLOCKS, len(lags))), len(every)
    begins = np.linspace(0, len(every), BLOCKS + 1).astype(np.int64)[:-1]
    return np.add.reduceat(every, begins) / float(np.sqrt(squares.prod())), len(every)


def _shifted(values: Floats, rows: int) -> Floats:
    """Return the values shifted ahead by this many rows; zero beyond the record."""
    shifted = np.zeros(len(values))
    if abs(rows) < len(values):
        shifted[max(-rows, 0) : len(values) - max(rows, 0)] = values[
            max(rows, 0) : len(values) + min(rows, 0)
        ]
    return shifted


def _peak_lag(correlation: Floats, lags: Rows) -> float:
    """Return the lag in rows of the greatest correlation; NaN at the end of the range."""
    place = int(correlation.argmax())
    if not 0 < place < len(correlation) - 1:
        return float("nan")
    before, here, after = correlation[place - 1 : place + 2]
    return float(lags[place] + 0.5 * (before - after) / (before - 2 * here + after))
