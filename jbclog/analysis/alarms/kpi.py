"""Alarm KPIs of one station (ISA-18.2): rate, floods, chattering, fleeting and stale alarms.

Definitions. *Rate*: the highest number of alarms raised in any ten minutes. *Flood*: begins with
more than `FLOOD_BEGINS` alarms in ten minutes and ends with fewer than `FLOOD_ENDS`. *Chattering*:
one limit of one port raises `CHATTERING` or more alarms within a minute. *Fleeting*: lasts less
than `FLEETING_S`. *Stale*: active for longer than `STALE_S`. *Time between alarms* (MTBA): recorded
time divided by the number of alarms raised in it, if there are two or more. *Acknowledgement
latency*: from raised to acknowledged, median and 95 % quantile over the acknowledged alarms; alarms
are acknowledged after the run is sealed, so it includes the rest of the run. The thresholds are
those of ISA-18.2 and EEMUA 191 (as quoted by vendors) for the console of one operator; here they
apply to one station.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import floor
from types import MappingProxyType
from typing import Final

from jbclog.analysis.alarms.state_machine import Detector, Episode

WINDOW_S: Final = 600.0
FLOOD_BEGINS: Final = 10
FLOOD_ENDS: Final = 5
CHATTERING: Final = 3
MINUTE_S: Final = 60.0
FLEETING_S: Final = 5.0
STALE_S: Final = 86400.0
TOP: Final = 10
LEAST_FOR_MTBA: Final = 2


@dataclass(frozen=True, slots=True)
class Source:
    """One limit of one port, as ``port 1 high``: the number and share (%) of its alarms."""

    name: str
    count: int
    percent: float


@dataclass(frozen=True, slots=True)
class Seconds:
    """A duration in s from `n` alarms; if None, `why` has the reason."""

    value: float | None
    n: int
    why: str | None = None


@dataclass(frozen=True, slots=True)
class Figures:
    """The KPIs of one station by one detector. Times are UTC microseconds; a flood that has not
    ended has None as its end.

    - `apart`: mean time between alarms
    - `ack_p50`, `ack_p95`: acknowledgement latency
    - `per_10_min`: mean over the record; None if nothing was recorded
    - `chattering`: chattering limit -> highest number of alarms within a minute
    """

    station: str
    detector: Detector
    count: int
    active: int
    per_10_min: float | None
    most_in_10_min: int
    floods: tuple[tuple[int, int | None], ...]
    chattering: dict[str, int]
    fleeting: int
    stale: int
    top: tuple[Source, ...]
    apart: Seconds
    ack_p50: Seconds
    ack_p95: Seconds


def figures(
    station: str,
    detector: Detector,
    episodes: Iterable[Episode],
    begin_us: int | None,
    end_us: int | None,
    acknowledged_us: Mapping[str, int] = MappingProxyType({}),
) -> Figures:
    """Return the KPIs of a station over its record from `begin_us` to `end_us` (None: nothing was
    recorded).

    `acknowledged_us`: name of an episode -> when it was acknowledged.
    """
    mine = [one for one in episodes if one.station == station and one.detector is detector]
    raised = sorted(_raised_us(one) for one in mine)
    floods, most = _floods(raised, end_us)
    length_s = None if begin_us is None or end_us is None else (end_us - begin_us) / 1e6
    names, waited = Counter(_source(one) for one in mine), _waited_s(mine, acknowledged_us)
    return Figures(
        station=station,
        detector=detector,
        count=len(mine),
        active=sum(one.end_us is None for one in mine),
        per_10_min=None if not length_s else len(mine) * WINDOW_S / max(length_s, WINDOW_S),
        most_in_10_min=most,
        floods=floods,
        chattering=_chattering(mine),
        fleeting=sum(one.seconds is not None and one.seconds < FLEETING_S for one in mine),
        stale=sum(_lasted_s(one, end_us) > STALE_S for one in mine),
        top=tuple(
            Source(name, n, round(100 * n / len(mine), 1)) for name, n in names.most_common(TOP)
        ),
        apart=_apart(len(mine), length_s),
        ack_p50=_latency(waited, len(mine), 0.50),
        ack_p95=_latency(waited, len(mine), 0.95),
    )


def _apart(count: int, length_s: float | None) -> Seconds:
    if length_s is None:
        return Seconds(None, count, "Nothing was recorded.")
    if not count:
        return Seconds(None, 0, f"No alarm was raised in {length_s:.0f} s.")
    if count < LEAST_FOR_MTBA:
        return Seconds(
            None,
            count,
            f"One alarm was raised in {length_s:.0f} s; a mean time between alarms takes two.",
        )
    return Seconds(round(length_s / count, 6), count)


def _waited_s(episodes: Sequence[Episode], acknowledged_us: Mapping[str, int]) -> list[float]:
    """Return the sorted latencies of acknowledged episodes, without negative ones, which come from
    a clock that was set back.
    """
    waited = [
        (acknowledged_us[one.id] - _raised_us(one)) / 1e6
        for one in episodes
        if one.id in acknowledged_us
    ]
    return sorted(seconds for seconds in waited if seconds >= 0)


def _latency(waited: Sequence[float], count: int, share: float) -> Seconds:
    """Return a quantile of the latencies, linearly interpolated."""
    if not waited:
        return Seconds(
            None, 0, "No alarm was raised." if not count else f"None of {count} was acknowledged."
        )
    place = share * (len(waited) - 1)
    below = floor(place)
    above = min(below + 1, len(waited) - 1)
    return Seconds(
        round(waited[below] + (place - below) * (waited[above] - waited[below]), 3), len(waited)
    )


def _raised_us(episode: Episode) -> int:
    return episode.onset_us if episode.raised_us is None else episode.raised_us


def _source(episode: Episode) -> str:
    return f"port {episode.port} {episode.side}"


def _lasted_s(episode: Episode, now_us: int | None) -> float:
    end = now_us if episode.end_us is None else episode.end_us
    return 0.0 if end is None else (end - episode.onset_us) / 1e6


def _floods(
    raised: Sequence[int], now_us: int | None
) -> tuple[tuple[tuple[int, int | None], ...], int]:
    """Return the floods, and the highest number of alarms in any ten minutes."""
    window = round(WINDOW_S * 1e6)
    # an alarm leaves the window ten minutes after it was raised
    moments = sorted(
        [(moment, 1) for moment in raised] + [(moment + window, -1) for moment in raised]
    )
    floods: list[tuple[int, int | None]] = []
    count = most = 0
    for moment, change in moments:
        if now_us is not None and moment > now_us and change < 0:
            break
        count += change
        most = max(most, count)
        in_flood = bool(floods) and floods[-1][1] is None
        if not in_flood and count > FLOOD_BEGINS:
            floods.append((moment, None))
        elif in_flood and count < FLOOD_ENDS:
            floods[-1] = (floods[-1][0], moment)
    return tuple(floods), most


def _chattering(episodes: Sequence[Episode]) -> dict[str, int]:
    """Return chattering limit -> highest number of alarms within a minute."""
    most: dict[str, int] = {}
    recent: dict[str, deque[int]] = {}
    for one in sorted(episodes, key=_raised_us):
        name, now = _source(one), _raised_us(one)
        window = recent.setdefault(name, deque())
        window.append(now)
        while now - window[0] >= MINUTE_S * 1e6:
            window.popleft()
        most[name] = max(most.get(name, 0), len(window))
    return {name: count for name, count in most.items() if count >= CHATTERING}
