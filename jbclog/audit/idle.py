"""Hot idle time: working hours in which no joint was made, as far as counters can tell it.

A station counts the hours that its tool works, not what it does with them. Where it counts joints as well, the week in which it
took the least time for each is a pace that it can keep; what it worked beyond that pace, it was hot for nothing. That is a lower
bound: even its best week has idle time in it. Where nothing counts joints, nothing is claimed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from jbclog.audit.fleet import UseFigure
from jbclog.audit.interval import NOTHING, Interval
from jbclog.audit.odometer import Difference
from jbclog.audit.stretch import days_of, parted, total_of
from jbclog.audit.titles import known, unknown

NAMES: Final = ("idle_hot_h", "idle_hot_percent", "idle_hot_kwh")
STRETCH_DAYS, FEWEST, LEAST_JOINTS = 7.0, 4, 20.0
NO_JOINTS: Final = "this station counts no joints, so that its working hours cannot be told from idle ones"

Each = Sequence[Sequence[Difference]]


def idle_of(work: Each, joints: Each, rated_power_w: float | None) -> Iterator[UseFigure]:
    """The figures of ports whose working hours and joints these are, differences of the last year, oldest first.

    >>> [figure.why for figure in idle_of([()], [()], None)][0]
    'this station counts no joints, so that its working hours cannot be told from idle ones'
    """
    ports = [(one, made) for one, made in zip(work, joints, strict=True) if one and made]
    if not ports:
        yield from (unknown(name, NO_JOINTS) for name in NAMES)
        return
    paces = [list(_paces(*port)) for port in ports]
    fewest = min(len(one) for one in paces)
    if fewest < FEWEST:
        yield from (unknown(name, f"not enough data: {fewest} of {FEWEST} weeks with joints") for name in NAMES)
        return
    hours = sum((_beyond(*port, min(one)) for port, one in zip(ports, paces, strict=True)), NOTHING)
    yield from _figures(hours, [one for one, _ in ports], rated_power_w)


def _paces(work: Sequence[Difference], joints: Sequence[Difference]) -> Iterator[float]:
    """Hours a joint in each stretch of a week or more that has joints: no less than it really took."""
    made = {(one[0].begin, one[-1].end): total_of(one) for one in parted(joints, STRETCH_DAYS)}
    for stretch in parted(work, STRETCH_DAYS):
        count = made.get((stretch[0].begin, stretch[-1].end), NOTHING)
        hours = total_of(stretch)
        if count.low >= LEAST_JOINTS and hours.low > 0 and hours.is_bounded:
            yield hours.high / count.low


def _beyond(work: Sequence[Difference], joints: Sequence[Difference], pace_h: float) -> Interval:
    hours, made = total_of(work), total_of(joints)
    return Interval(max(hours.low - made.high * pace_h, 0.0), hours.high)


def _figures(idle: Interval, work: Each, rated_power_w: float | None) -> Iterator[UseFigure]:
    n, days = len(work[0]), days_of(work[0])
    worked = sum((total_of(one) for one in work), NOTHING)
    share = Interval(100 * idle.low / max(worked.high, 1.0), 100.0)
    yield known("idle_hot_h", idle, n, days, stated=idle.low)
    yield known("idle_hot_percent", share, n, days, stated=share.low)
    if rated_power_w is None:
        yield unknown("idle_hot_kwh", "the line file declares no rated_power_w: hours only")
    else:
        most = idle.low * rated_power_w / 1000
        yield known("idle_hot_kwh", Interval(0.0, most), n, days, stated=most)
