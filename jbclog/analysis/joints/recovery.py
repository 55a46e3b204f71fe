"""What a joint does to the tip: how far below its level it begins, how low it falls, and whether it is back before the next one.

Definitions. The *level* is where the tip rests at this setpoint (`levels`), or the setpoint where no rest was seen. At the start
of a joint the tip is `deficit_c` below its setpoint and `resting_below_c` below the level at which it rests. *Depth* is the
temperature at the start minus the lowest from then until the tip is back.

The tip is *back* at the first moment after its lowest at which it is no more than the band (`recovered_within_c`) below the level,
and stays so for `BACK_FOR_S`; it is back at once where it never left the band. *Recovery* is the time from the joint's start until
then. A joint that is followed by the next draw of heat before that is *not recovered*: its recovery is longer than the time that
it had. A joint that the end of the record, a gap, a stand or another setpoint cuts off is censored: it is neither.

*Energy* is the power above what holds the tip, from the start until it is back, ‰·s (trapezoids).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jbclog.analysis.joints.draw import Draw
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.thermal import AIR_C
from jbclog.analysis.joints.track import Track, track_of
from jbclog.analysis.verdict.idle import Flags, Floats, setting_in_force

BACK_FOR_S: Final = 0.3
LOOK_S: Final = 60.0  # a tip that is not back by then is cut off: what is looked at of one joint stays small
NEXT_CAME: Final = "The next joint began before the tip was back."
FEED_CAME: Final = "A feed without a draw of heat came before the tip was back."
FEED_ALONE: Final = "Only the feeder tells of it; no draw of heat was found."
NOT_READ: Final = "Nothing was read at its start."
GAP: Final = "The record has a gap in it."
UNKNOWN_SETPOINT: Final = "The setpoint is not known."


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint: a draw of heat, and what it did to the tip. °C and s; None where it is not known, and `why`.

    `recovered` is None where the joint was cut off; `had_s` is how long the tip had until the next draw or until it was cut off.
    """

    draw: Draw
    heat_j: float | None = None
    setpoint_c: float | None = None
    deficit_c: float | None = None
    resting_below_c: float | None = None
    depth_c: float | None = None
    lowest_c: float | None = None
    end_c: float | None = None
    recovered: bool | None = None
    recovery_s: float | None = None
    had_s: float | None = None
    energy: float | None = None
    why: str | None = None

    @property
    def start_s(self) -> float:
        return self.draw.start_s

    @property
    def end_s(self) -> float:
        return self.draw.end_s

    @property
    def dwell_s(self) -> float | None:
        """None where only the feeder tells of it."""
        return None if self.draw.heat is None else self.draw.dwell_s

    @property
    def heat(self) -> float | None:
        return self.draw.heat

    @property
    def peak(self) -> float | None:
        return self.draw.peak

    @property
    def fed(self) -> bool | None:
        return self.draw.fed

    @property
    def kind(self) -> str:
        return self.draw.kind

    @property
    def confidence(self) -> float:
        return self.draw.confidence


def joints_of(
    series: Series, draws: Sequence[Draw], every: Sequence[Draw], levels: Mapping[float, float], within_c: float
) -> list[Joint]:
    """The joints that these draws are; `every` draw, also of those that are none, can come before the tip is back."""
    if not draws or not len(series.seconds):
        return [Joint(draw, why=NOT_READ) for draw in draws]
    tip = _Tip(track_of(series, series.rows.temperature), levels, within_c, series.rated_w)
    drawn, fed = [draw for draw in draws if draw.heat is not None], [draw for draw in draws if draw.heat is None]
    joints: list[Joint] = []
    if drawn:
        seen = _seen(series, tip.track, drawn, every, fed)
        joints = _with_energy(series, [_joint(tip, seen, number, draw) for number, draw in enumerate(drawn)])
    return sorted([*joints, *(Joint(draw, why=FEED_ALONE) for draw in fed)], key=lambda joint: joint.start_s)


@dataclass(frozen=True, slots=True)
class _Tip:
    track: Track
    levels: Mapping[float, float]
    within_c: float
    rated_w: float | None


@dataclass(frozen=True, slots=True)
class _Seen:
    """Of each joint: setpoint (NaN: not known), until when it can be watched and why not for longer (None: the next draw).

    `first`, `last` and `touched` are places of its readings: the first, behind the last, and behind the last of its contact.
    """

    starts: Floats
    setpoints: Floats
    stops: Floats
    cuts: list[str | None]
    first: list[int]
    last: list[int]
    touched: list[int]
    broken: Flags
    gaps: Flags


def _seen(series: Series, track: Track, draws: Sequence[Draw], every: Sequence[Draw], fed: Sequence[Draw]) -> _Seen:
    starts, ends = np.array([draw.start_s for draw in draws]), np.array([draw.end_s for draw in draws])
    setpoints = setting_in_force(series.seconds, series.rows.setting)
    rows = np.clip(np.searchsorted(series.seconds, starts + 1e-6) - 1, 0, None)
    following = np.array(sorted({draw.start_s for draw in every if draw.heat is not None}))
    stops, cuts = _stops(series, starts, ends, following, np.array([draw.start_s for draw in fed]))
    before = np.clip(track.last(starts) - 1, 0, None)  # the reading at the start, or the one before it
    late = starts - track.seconds[before] > series.gap_s if len(track.seconds) else np.ones(len(starts), dtype=np.bool_)
    broken = late | track.has_gap(starts, np.maximum(ends, starts + series.period_s))
    last, touched = track.last(stops), track.last(ends)
    return _Seen(
        starts, setpoints[rows], stops, cuts, before.tolist(), last.tolist(), touched.tolist(), broken, track.has_gap(starts, stops)
    )


def _stops(series: Series, starts: Floats, ends: Floats, draws: Floats, feeds: Floats) -> tuple[Floats, list[str | None]]:
    """Until when each joint can be watched, and what cuts it off then."""
    reasons = (
        "The record ended before the tip was back.",
        f"The tip was not back {LOOK_S:g} s after it.",
        "The setpoint changed before the tip was back.",
        "The tool stopped working before the tip was back.",
        FEED_CAME,
    )
    moments = np.stack(
        [
            np.full(len(starts), series.seconds[-1]),
            ends + LOOK_S,
            _changed(series, starts),
            _following(_stands(series), starts),
            _following(feeds, starts),
        ]
    )
    stops, which = moments.min(axis=0), moments.argmin(axis=0).tolist()
    following = _following(draws, starts)
    is_next = following <= stops
    cuts = [None if after else reasons[place] for after, place in zip(is_next.tolist(), which, strict=True)]
    return np.where(is_next, following - series.period_s / 2, stops), cuts


def _following(moments: Floats, starts: Floats) -> Floats:
    """The first of the moments after each start; infinite where there is none."""
    return np.append(moments, np.inf)[np.searchsorted(moments, starts, side="right")]


def _changed(series: Series, starts: Floats) -> Floats:
    """From when on the setpoint in force at each start may be another: since it was last read before the change."""
    read = ~np.isnan(series.rows.setting)
    at, values = series.seconds[read], series.rows.setting[read]
    places = np.flatnonzero(np.diff(values) != 0)
    before, behind = np.append(at[places], np.inf), at[places + 1]
    return np.asarray(np.maximum(before[np.searchsorted(behind, starts, side="right")], starts), dtype=np.float64)


def _stands(series: Series) -> Floats:
    """When the tool stopped working."""
    working = series.rows.working | ~series.known
    return np.asarray(series.seconds[1:][working[:-1] & ~working[1:]], dtype=np.float64)


def _joint(tip: _Tip, seen: _Seen, number: int, draw: Draw) -> Joint:
    heat_j = None if draw.heat is None or tip.rated_w is None else draw.heat * tip.rated_w / 1000
    if seen.broken[number]:
        return Joint(draw, heat_j, why=GAP)
    first, touched = seen.first[number], max(seen.touched[number], seen.first[number] + 1)
    values, setpoint = tip.track.values, float(seen.setpoints[number])
    begin, end, lowest = float(values[first]), float(values[touched - 1]), float(values[first:touched].min())
    if np.isnan(setpoint):
        return Joint(draw, heat_j, depth_c=begin - lowest, lowest_c=lowest, end_c=end, why=UNKNOWN_SETPOINT)
    level = tip.levels.get(setpoint)
    below = None if level is None else level - begin
    after = _after(tip, seen, number, (setpoint if level is None else level) - tip.within_c)
    lowest = min(lowest, after.lowest)
    known = (after.recovered, after.recovery_s, after.had_s)
    return Joint(draw, heat_j, setpoint, setpoint - begin, below, begin - lowest, lowest, end, *known, None, after.why)


@dataclass(frozen=True, slots=True)
class _After:
    """What came after a joint's start: whether the tip was back and after how long, and the lowest until then."""

    recovered: bool | None
    recovery_s: float | None
    had_s: float | None
    lowest: float
    why: str | None


def _after(tip: _Tip, seen: _Seen, number: int, floor: float) -> _After:
    first, last, stop = seen.first[number], seen.last[number], float(seen.stops[number])
    values, seconds = tip.track.values[first:last], tip.track.seconds[first:last]
    had = max(stop - float(seen.starts[number]), 0.0)
    back = _back(seconds, values, floor, stop) if len(values) and had else None
    if back is None:
        lowest = float(values.min()) if len(values) else np.inf
        if seen.gaps[number] and had:
            return _After(None, None, None, np.inf, GAP)
        cut = seen.cuts[number]
        return _After(False if cut is None else None, None, had, lowest, cut or NEXT_CAME)
    if tip.track.gaps[first + back] > tip.track.gaps[first]:
        return _After(None, None, None, np.inf, GAP)
    lowest = float(values[: back + 1].min())
    recovery = 0.0 if lowest >= floor else max(float(seconds[back]) - float(seen.starts[number]), 0.0)
    return _After(True, recovery, had, lowest, None)


def _back(seconds: Floats, values: Floats, floor: float, stop_s: float) -> int | None:
    """The place at which the temperature is back after its lowest; None where it is not."""
    lowest = int(values.argmin())
    low = values < floor
    falls = np.flatnonzero(low[lowest + 1 :] & ~low[lowest:-1]) + lowest + 1  # where it leaves the band again
    begins = [lowest] if not low[lowest] else []
    begins += (np.flatnonzero(~low[lowest + 1 :] & low[lowest:-1]) + lowest + 1).tolist()
    for begin in begins:
        place = bisect_right(falls, begin)
        until = float(seconds[falls[place]]) if place < len(falls) else stop_s
        if until - float(seconds[begin]) >= BACK_FOR_S - 1e-6:
            return int(begin)
    return None


def _with_energy(series: Series, joints: list[Joint]) -> list[Joint]:
    """The joints that recovered with the power above holding power until then."""
    power, above_air = track_of(series, series.rows.power), track_of(series, series.rows.temperature - AIR_C)
    starts = np.array([joint.start_s for joint in joints])
    ends = np.array([max(joint.start_s + (joint.recovery_s or 0.0), joint.end_s) for joint in joints])
    loss = np.array([np.nan if joint.draw.loss is None else joint.draw.loss for joint in joints])
    energies = power.area_between(starts, ends) - loss * above_air.area_between(starts, ends)
    known = ~np.isnan(energies) & ~power.has_gap(starts, ends) & ~above_air.has_gap(starts, ends)
    return [
        replace(joint, energy=float(energy)) if is_known and joint.recovered else joint
        for joint, energy, is_known in zip(joints, energies, known.tolist(), strict=True)
    ]
