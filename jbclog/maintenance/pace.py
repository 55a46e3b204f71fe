"""How fast a counter goes, and how sure that is: what a forecast stands on.

Use is uneven: weekends, holidays, products, orders. It is measured in weeks, so that weekends are in each; how much weeks, and
months, differ from each other says how far a forecast can be off. A station that was watched for a short time only is taken to
vary as stations do (`USUAL`), until it shows otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

DAY: Final = 86400.0
WEEK: Final = 7 * DAY
USUAL: Final = 0.6  # the variance of a week's use, of its square, long-run: with what it has in common with the weeks beside it
USUAL_WEIGHT: Final = 6.0  # blocks that this counts as
BLOCK: Final = 4  # weeks
LEAST_DAYS: Final = 21.0  # of daily looks, before weekdays are told apart
LEAST_LASTED: Final = 2 * DAY

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """What was worked from one look to the next, as its middle; times in seconds since 1970."""

    begin: float
    end: float
    worked: float


@dataclass(frozen=True, slots=True)
class Pace:
    """`a_week`: what is worked in a week. `variance`: of a week's use, in units of its square, as it adds up over many weeks.
    `weeks`: how long it was watched. `weekdays`: the share of each, Monday first, of which the mean is 1."""

    a_week: float
    variance: float
    weeks: float
    weekdays: tuple[float, ...]


def pace_of(steps: Sequence[Step]) -> Pace | None:
    """The pace that these steps show; None where they last less than two days or nothing was worked."""
    lasted = sum(step.end - step.begin for step in steps)
    worked = sum(step.worked for step in steps)
    if lasted < LEAST_LASTED or worked <= 0:
        return None
    weeks = lasted / WEEK
    return Pace(worked / weeks, _variance(steps, worked / weeks), weeks, _weekdays(steps))


def _variance(steps: Sequence[Step], a_week: float) -> float:
    """As it was seen in blocks of weeks, and as it usually is."""
    usual = max(1.0, float(np.median([step.end - step.begin for step in steps])) / WEEK)
    total, weight = USUAL * USUAL_WEIGHT, USUAL_WEIGHT
    for length in (BLOCK * math.ceil(usual),):
        blocks = _blocks(steps, length)
        if len(blocks) > 1:
            seen = length * float(np.var(blocks / length / a_week, ddof=1))
            total, weight = total + seen * (len(blocks) - 1), weight + len(blocks) - 1
    return total / weight


def _blocks(steps: Sequence[Step], weeks: float) -> Numbers:
    """What was worked in each block of so many weeks, counted back from the last look; a rest is left out."""
    lasted = np.concatenate([[0.0], np.cumsum([step.end - step.begin for step in steps])])
    worked = np.concatenate([[0.0], np.cumsum([step.worked for step in steps])])
    ends = np.arange(lasted[-1], -1e-6, -weeks * WEEK)[::-1]
    return np.diff(np.interp(ends, lasted, worked))


def _weekdays(steps: Sequence[Step]) -> tuple[float, ...]:
    """By looks a day apart at most; all alike where there are not enough."""
    daily = [step for step in steps if 0.5 * DAY < step.end - step.begin < 1.5 * DAY]
    if len(daily) < LEAST_DAYS or len(daily) < 0.5 * len(steps):
        return (1.0,) * 7
    worked, lasted = np.zeros(7), np.zeros(7)
    for step in daily:
        for day, seconds in days_between(step.begin, step.end):
            worked[day] += step.worked * seconds / (step.end - step.begin)
            lasted[day] += seconds
    if worked.sum() <= 0 or not lasted.all():
        return (1.0,) * 7
    shares = worked / lasted
    return tuple(float(one) for one in shares / shares.mean())


def days_between(begin: float, end: float) -> list[tuple[int, float]]:
    """Weekdays (UTC, Monday 0) with the seconds of each that lie between."""
    found = []
    while begin < end:
        stop = min(end, (math.floor(begin / DAY) + 1) * DAY)
        found.append((weekday(begin), stop - begin))
        begin = stop
    return found


def weekday(time: float) -> int:
    """Monday is 0."""
    return (math.floor(time / DAY) + 3) % 7  # 1970 began on a Thursday
