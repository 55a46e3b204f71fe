"""When so much more will have been worked: a moment for each chance, none where it is beyond what can be told.

Over t weeks a pace of one week's use each comes to t, with a variance of v (t + t^2 / n): the weeks to come differ by v each,
and the pace itself is known from n weeks only. The moment by which an amount of d weeks is reached with a chance of which the
normal deviate is z is the t with t - d = z sqrt(v (t + t^2 / n)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from jbclog.maintenance.pace import DAY, WEEK, Pace, weekday

LATE: Final = 1.2816  # the normal deviate of 90 %
EARLY: Final = 1.6  # of 10 %, and more: work comes in surges, and a part that is worn before it was said does harm
LASTING: Final = 0.03  # the variance of a pace that does not average out: seasons, shutdowns, other work
HORIZON_WEEKS: Final = 520.0


@dataclass(frozen=True, slots=True)
class Forecast:
    """Moments (seconds since 1970) by which it is reached with a chance of 10, 50, 90 %; None: later than in ten years."""

    p10: float | None
    p50: float | None
    p90: float | None


def forecast(now: float, left: float, pace: Pace, doubt: float = 0.0) -> Forecast:
    """When `left` more will have been worked. `doubt` is the variance of `left`."""
    return Forecast(*(_moment(now, _weeks(left, pace, doubt, z), pace) for z in (-EARLY, 0.0, LATE)))


def _weeks(left: float, pace: Pace, doubt: float, z: float) -> float:
    """The root of (t - d)^2 = z^2 (v t + v t^2 / n + u) below d or above it."""
    mean, by = left / pace.a_week, z * z * pace.variance
    square = 1 - by / pace.weeks - z * z * LASTING
    half, rest = mean + by / 2, mean * mean - z * z * doubt / pace.a_week**2
    root = math.sqrt(max(0.0, half * half - square * rest))
    if z > 0:
        return (half + root) / square if square > 1e-9 else math.inf
    return max(0.0, rest / (half + root)) if half + root > 0 else 0.0


def _moment(now: float, weeks: float, pace: Pace) -> float | None:
    """The moment when that many weeks' use has been worked, weekdays as they are."""
    if weeks > HORIZON_WEEKS:
        return None
    whole = math.floor(weeks)
    at, rest = now + whole * WEEK, (weeks - whole) * WEEK
    while rest > 0:
        share, stop = pace.weekdays[weekday(at)], (math.floor(at / DAY) + 1) * DAY
        if share * (stop - at) >= rest:
            return at + rest / share
        rest -= share * (stop - at)
        at = stop
    return at
