"""What a joint does to the tip: how deep it falls, how long until it is back, what that costs.

Definitions, for each joint (`joints`). *Before* is the median temperature of the `BEFORE_S` before its start. *Depth* is before
minus the lowest temperature from its start until it is back, or until `LATEST_S` after its end. It is *back* at the first
moment after that lowest at which the temperature is no more than `BACK_C` below before and stays so for `BACK_FOR_S`.
*Recovery* is the time from the start until it is back; zero where it never was further than that below. *Energy* is the power
above holding power from start until back, which includes heating the tip again, in ‰·s; in joules where the full-scale power is
declared.

Each is null where its window has a gap, where the record does not reach, or where the next joint began before the tip was back.
Over a port: the median and the 95 % quantile of the joints that have a value, `n` of them; `coverage` is their share of all joints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from jbclog.features.figure import Figure, no_figure
from jbclog.features.joints import Draw, Found
from jbclog.features.series import RESOLUTION_C, RESOLUTION_PERMILLE, Series, Window

BEFORE_S, LATEST_S = 1.0, 10.0
BACK_C, BACK_FOR_S = 3.0, 0.3
PERCENTILE = 95


@dataclass(frozen=True, slots=True)
class Dip:
    """A joint and what came after it; None where it is not known, and why."""

    draw: Draw
    depth_c: float | None
    recovery_s: float | None
    energy: float | None  # ‰·s
    why: str | None = None


def dips(series: Series, found: Found) -> list[Dip]:
    """What each joint did to the tip."""
    starts: list[float | None] = [draw.start_s for draw in found.joints]
    return [_dip(series, draw, following) for draw, following in zip(found.joints, [*starts[1:], None], strict=False)]


def _dip(series: Series, draw: Draw, next_s: float | None) -> Dip:
    temperature, last = series.rows.temperature, float(series.seconds[-1])
    calm = series.window(temperature, draw.start_s - BEFORE_S, draw.start_s - series.period_s)
    end = min(draw.end_s + LATEST_S, last, np.inf if next_s is None else next_s - series.period_s)
    after = series.window(temperature, draw.start_s, end)
    if not calm.n or calm.gap:
        return Dip(draw, None, None, None, why=calm.gap or "Nothing was read in the second before it.")
    before = float(np.median(calm.values))
    back = _back_s(after, before)
    seen = after if back is None else series.window(temperature, draw.start_s, back)
    touched = series.window(temperature, draw.start_s, draw.end_s)
    if touched.gap or not seen.n:
        return Dip(draw, None, None, None, why=touched.gap or "Nothing was read in it.")
    depth = max(before - float(seen.values.min()), 0.0)
    if back is None or seen.gap:
        return Dip(draw, depth if not seen.gap else None, None, None, why=seen.gap or _never(next_s, end + series.period_s))
    return Dip(draw, depth, back - draw.start_s if depth > BACK_C else 0.0, _energy(series, draw, max(back, draw.end_s)))


def _never(next_s: float | None, end_s: float) -> str:
    if next_s is not None and end_s >= next_s - 1e-6:
        return "The next joint began before the tip was back."
    return f"The tip was not back {LATEST_S:g} s after it, or the record ended."


def _back_s(after: Window, before: float) -> float | None:
    """When the temperature is back after its lowest; None where it is not."""
    if not after.n:
        return None
    lowest = int(np.argmin(after.values))
    low = after.values < before - BACK_C
    for place in np.flatnonzero(~low[lowest:]) + lowest:
        left = after.seconds[place:][low[place:]]
        until = left[0] if len(left) else after.end_s + after.period_s
        if until - after.seconds[place] >= BACK_FOR_S - 1e-6:
            return float(after.seconds[place])
    return None


def _energy(series: Series, draw: Draw, until_s: float) -> float | None:
    """Power above holding power from the joint's start on, ‰·s (trapezoid)."""
    power = series.window(series.rows.power, draw.start_s, until_s)
    if power.gap or power.n < 2:
        return None
    holding = np.interp(power.seconds, draw.flow.stretch.seconds, draw.flow.holding)
    above = power.values - holding
    return float(np.sum(np.diff(power.seconds) * (above[1:] + above[:-1]) / 2.0))


def recovery(series: Series, found: Found, seen: Sequence[Dip]) -> list[Figure]:
    """Number of joints, and depth, recovery, dwell, heat and energy over all of them."""
    count = Figure("joints", float(len(seen)), "count", len(seen), series.whole(series.rows.temperature).coverage, 1.0)
    period = series.period_s
    return [
        _counted(count, series, found),
        _middle("joint_depth_c", "°C", RESOLUTION_C, seen, lambda dip: dip.depth_c),
        _middle("joint_dwell_s", "s", period, seen, lambda dip: dip.draw.main.dwell_s),
        _middle("joint_heat_permille_s", "‰·s", RESOLUTION_PERMILLE * period, seen, heat_of),
        _middle("joint_energy_permille_s", "‰·s", RESOLUTION_PERMILLE * period, seen, lambda dip: dip.energy),
        _middle("recovery_s", "s", period, seen, lambda dip: dip.recovery_s),
        _high("recovery_p95_s", "s", period, seen, lambda dip: dip.recovery_s),
    ]


def heat_of(dip: Dip) -> float:
    """The heat that went into the work, ‰·s."""
    return sum(touch.heat for touch in dip.draw.touches)


def _counted(count: Figure, series: Series, found: Found) -> Figure:
    gap = series.whole(series.rows.temperature).gap or series.whole(series.rows.power).gap
    if gap is None:
        return count
    return no_figure(
        "joints", "count", f"{gap} Joints in gaps are not known; {count.n} were found beside them.", count.n, count.coverage
    )


def _values(seen: Sequence[Dip], value: Callable[[Dip], float | None]) -> list[float]:
    return [known for dip in seen if (known := value(dip)) is not None]


def _middle(name: str, unit: str, resolution: float, seen: Sequence[Dip], value: Callable[[Dip], float | None]) -> Figure:
    return _of_joints(name, unit, resolution, seen, value, 50)


def _high(name: str, unit: str, resolution: float, seen: Sequence[Dip], value: Callable[[Dip], float | None]) -> Figure:
    return _of_joints(name, unit, resolution, seen, value, PERCENTILE)


def _of_joints(
    name: str, unit: str, resolution: float, seen: Sequence[Dip], value: Callable[[Dip], float | None], percentile: int
) -> Figure:
    values = _values(seen, value)
    if not values:
        return no_figure(name, unit, seen[0].why or "No joint has it." if seen else "No joints were found.")
    coverage = round(100.0 * len(values) / len(seen), 3)
    return Figure(name, float(np.percentile(values, percentile)), unit, len(values), coverage, resolution)
