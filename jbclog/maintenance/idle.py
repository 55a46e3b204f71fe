"""Hot idle time: working hours in which no joint was made, as far as counters can tell it.

A station counts the hours that its tool works, not what it does with them. Where it counts joints as well, the week in which it
took the least time for each is a pace that it can keep; what it worked beyond that pace, it was hot for nothing. That is a lower
bound: even its best week has idle time in it. Where nothing counts joints, nothing is claimed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from jbclog.maintenance.counter_totals.interval import NOTHING, Interval
from jbclog.maintenance.fleet import UseFigure
from jbclog.maintenance.span_of_use import Stretch, parted, sum_of
from jbclog.maintenance.titles import known, unknown

NAMES: Final = ("idle_hot_h", "idle_hot_percent", "idle_hot_kwh")
STRETCH_DAYS, FEWEST, LEAST_JOINTS = 7.0, 4, 20.0
NO_JOINTS: Final = "this station counts no joints, so that its working hours cannot be told from idle ones"

NONE_SURE: Final = "no idle hour is sure: what is known of hours and joints leaves room for none"

Each = Sequence[Stretch | None]


def idle_of(work: Each, joints: Each, rated_power_w: float | None) -> Iterator[UseFigure]:
    """The figures of ports whose working hours and joints of the last year these are.

    >>> [figure.why for figure in idle_of([None], [None], None)][0]
    'this station counts no joints, so that its working hours cannot be told from idle ones'
    """
    ports = [(one, made) for one, made in zip(work, joints, strict=True) if one is not None and made is not None]
    if not ports:
        yield from (unknown(name, NO_JOINTS) for name in NAMES)
        return
    paces = [list(_paces(*port)) for port in ports]
    fewest = min(len(one) for one in paces)
    if fewest < FEWEST:
        yield from (unknown(name, f"not enough data: {fewest} of {FEWEST} weeks with joints") for name in NAMES)
        return
    hours = sum((_beyond(*port, min(one)) for port, one in zip(ports, paces, strict=True)), NOTHING)
    if hours.low <= 0:
        yield from (unknown(name, NONE_SURE) for name in NAMES)
        return
    yield from _figures(hours, [one for one, _ in ports], rated_power_w)


def _paces(work: Stretch, joints: Stretch) -> Iterator[float]:
    """Hours a joint in each part of a week or more that has joints: no less than it really took."""
    made = {part.times: part.total for part in parted(joints, STRETCH_DAYS)}
    for part in parted(work, STRETCH_DAYS):
        count, hours = made.get(part.times, NOTHING), part.total
        if count.low >= LEAST_JOINTS and hours.low > 0 and hours.is_bounded:
            yield hours.high / count.low


def _beyond(work: Stretch, joints: Stretch, pace_h: float) -> Interval:
    return Interval(max(work.total.low - joints.total.high * pace_h, 0.0), work.total.high)


def _figures(idle: Interval, work: Sequence[Stretch], rated_power_w: float | None) -> Iterator[UseFigure]:
    n, days = work[0].n, work[0].days
    share = Interval(100 * idle.low / max(sum_of(work).high, 1.0), 100.0)
    yield known("idle_hot_h", idle, n, days, stated=idle.low)
    yield known("idle_hot_percent", share, n, days, stated=share.low)
    if rated_power_w is None:
        yield unknown("idle_hot_kwh", "the line file declares no rated_power_w: hours only")
    else:
        most = idle.low * rated_power_w / 1000
        yield known("idle_hot_kwh", Interval(0.0, most), n, days, stated=most)
