"""Effect of a joint on the tip: how far below its level it begins, how low it falls, and whether it
recovers before the next one.

The *level* is the temperature at which the tip rests at this setpoint (`levels`), or the setpoint
if it was never at rest. At the start of a joint the tip is `deficit_c` below its setpoint and
`resting_below_c` below its level. *Depth* is the temperature at the start minus the lowest until
the tip is back.

The tip is *back* at the first moment after its lowest at which it is no more than the band
(`recovered_within_c`) below the level, and stays so for `BACK_FOR_S`; it is back at once if it
never left the band. *Recovery* is the time from the joint's start until then. A joint followed by
the next draw of heat before that is *not recovered*: its recovery is longer than the time it had. A
joint cut off by the end of the record, a gap, a stand or another setpoint is censored: neither.

*Energy* is the power above what holds the tip, from the start until it is back, in ‰·s
(trapezoids).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np

from jbclog.analysis.joints.draws import Draw
from jbclog.analysis.joints.segments import Places, Segments, segments
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.thermal import AIR_C
from jbclog.analysis.joints.track import Track, track_of
from jbclog.analysis.port_data import Flags, Floats, setting_in_force

BACK_FOR_S: Final = 0.3
# a tip that is not back by then is cut off, which bounds the rows of one joint
MOST_RECOVERY_S: Final = 60.0
NEXT_CAME: Final = "The next joint began before the tip was back."
FEED_CAME: Final = "A feed without a draw of heat came before the tip was back."
FEED_ALONE: Final = "Only the feeder tells of it; no draw of heat was found."
NOT_READ: Final = "Nothing was read at its start."
GAP: Final = "The record has a gap in it."
UNKNOWN_SETPOINT: Final = "The setpoint is not known."


class Joint(NamedTuple):
    """A joint: a draw of heat, and its effect on the tip in °C and s; None if not known, for the
    reason in `why`.

    `recovered` is None if the joint was cut off; `had_s` is the time from its start until the next
    draw or until it was cut off.
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
        """The dwell in s; None if only the feeder shows the joint."""
        return None if self.draw.heat is None else self.draw.dwell_s

    @property
    def heat(self) -> float | None:
        return self.draw.heat

    @property
    def kind(self) -> str:
        return self.draw.kind


def joints_of(
    series: Series,
    draws: Sequence[Draw],
    every: Sequence[Draw],
    levels: Mapping[float, float],
    within_c: float,
) -> list[Joint]:
    """Return these draws as joints. `every` has all draws, also those that are not joints, because
    any of them can precede the recovery.
    """
    if not draws or not len(series.seconds):
        return [Joint(draw, why=NOT_READ) for draw in draws]
    tip = _Tip(track_of(series, series.rows.temperature), levels, within_c, series.rated_w)
    drawn = [draw for draw in draws if draw.heat is not None]
    fed = [draw for draw in draws if draw.heat is None]
    joints = (
        _measured_joints(tip, series, _timing(series, tip.track, drawn, every, fed), drawn)
        if drawn
        else []
    )
    return sorted(
        [*joints, *(Joint(draw, why=FEED_ALONE) for draw in fed)], key=attrgetter("draw.start_s")
    )


@dataclass(frozen=True, slots=True)
class _Tip:
    """The temperature of a port, with the references of its recovery."""

    track: Track
    levels: Mapping[float, float]
    within_c: float
    rated_w: float | None


@dataclass(frozen=True, slots=True)
class _Timing:
    """When the temperature shows each joint: its setpoint (NaN: not known), and until when and why
    its recovery can be watched.

    In `cuts`, None is the next draw. `first`, `last` and `touched` are indices of its readings: the
    first, the one after the last, and the one after the last of its contact.
    """

    starts: Floats
    ends: Floats
    setpoints: Floats
    stops: Floats
    cuts: list[str | None]
    first: Places
    last: Places
    touched: Places
    broken: Flags
    gaps: Flags


def _timing(
    series: Series, track: Track, draws: Sequence[Draw], every: Sequence[Draw], fed: Sequence[Draw]
) -> _Timing:
    late = np.array([draw.late_s for draw in draws])
    starts = np.array([draw.start_s for draw in draws]) + late
    ends = np.array([draw.end_s for draw in draws]) + late
    setpoints = setting_in_force(series.seconds, series.rows.setting)
    rows = np.clip(np.searchsorted(series.moments, starts + 1e-6) - 1, 0, None)
    following = np.unique([one.start_s + one.late_s for one in every if one.heat is not None])
    stops, cuts = _stops(series, starts, ends, following, np.array([draw.start_s for draw in fed]))
    # the reading at the start, or the one before it
    before = np.clip(track.last(starts) - 1, 0, None)
    unread = (
        starts - track.seconds[before] > series.gap_s
        if len(track.seconds)
        else np.ones(len(starts), dtype=np.bool_)
    )
    broken = unread | track.has_gap(starts, np.maximum(ends, starts + series.period_s))
    last, touched = track.last(stops), track.last(ends)
    return _Timing(
        starts,
        ends,
        setpoints[rows],
        stops,
        cuts,
        before,
        last,
        touched,
        broken,
        track.has_gap(starts, stops),
    )


def _stops(
    series: Series, starts: Floats, ends: Floats, draws: Floats, feeds: Floats
) -> tuple[Floats, list[str | None]]:
    """Return until when each joint can be watched, and what then cuts it off."""
    reasons = (
        "The record ended before the tip was back.",
        f"The tip was not back {MOST_RECOVERY_S:g} s after it.",
        "The setpoint changed before the tip was back.",
        "The tool stopped working before the tip was back.",
        FEED_CAME,
    )
    moments = np.stack(
        [
            np.full(len(starts), series.moments[-1]),
            ends + MOST_RECOVERY_S,
            _setpoint_changes(series, starts),
            _next_after(_ends_of_work(series), starts),
            _next_after(feeds, starts),
        ]
    )
    stops, which = moments.min(axis=0), moments.argmin(axis=0).tolist()
    following = _next_after(draws, starts)
    is_next = following <= stops
    cuts = [
        None if after else reasons[place]
        for after, place in zip(is_next.tolist(), which, strict=True)
    ]
    return np.where(is_next, following - series.period_s / 2, stops), cuts


def _next_after(moments: Floats, starts: Floats) -> Floats:
    """Return the first of the moments after each start; infinite if there is none."""
    return np.append(moments, np.inf)[np.searchsorted(moments, starts, side="right")]


def _setpoint_changes(series: Series, starts: Floats) -> Floats:
    """Return since when the setpoint at each start may have changed: its last reading before the
    change.
    """
    read = ~np.isnan(series.rows.setting)
    at, values = series.moments[read], series.rows.setting[read]
    places = np.flatnonzero(np.diff(values) != 0)
    before, behind = np.append(at[places], np.inf), at[places + 1]
    return np.asarray(
        np.maximum(before[np.searchsorted(behind, starts, side="right")], starts), dtype=np.float64
    )


def _ends_of_work(series: Series) -> Floats:
    """Return the times at which the tool stopped working."""
    working = series.rows.working | ~series.known
    return np.asarray(series.moments[1:][working[:-1] & ~working[1:]], dtype=np.float64)


def _measured_joints(
    tip: _Tip, series: Series, timing: _Timing, draws: Sequence[Draw]
) -> list[Joint]:
    """Return the joints, with the effect of each on the tip."""
    complete = np.flatnonzero(~timing.broken)
    places, setpoints = complete.tolist(), timing.setpoints[complete]
    levels = np.array([tip.levels.get(one, np.nan) for one in setpoints.tolist()])
    floors = np.where(np.isnan(levels), setpoints, levels) - tip.within_c
    outcomes = _outcomes(tip, timing, complete, floors)
    known = outcomes.known([timing.cuts[place] for place in places])
    energies = _energies(series, timing, complete, outcomes, draws)
    columns: list[Sequence[Any]] = [
        [draws[place] for place in places],
        [_joules(tip, draws[place]) for place in places],
        *map(_none_where_nan, _fall(tip.track, timing, complete, levels, outcomes)),
        [back for back, _ in known],
        *map(_none_where_nan, (outcomes.recovery, outcomes.had, energies)),
        [why for _, why in known],
    ]
    joints = dict(zip(places, map(Joint._make, zip(*columns, strict=True)), strict=True))
    return [
        joints.get(number) or Joint(draw, _joules(tip, draw), why=GAP)
        for number, draw in enumerate(draws)
    ]


def _fall(
    track: Track, timing: _Timing, complete: Places, levels: Floats, outcomes: _Outcomes
) -> tuple[Floats, ...]:
    """Return the fields of the joints from `Joint.setpoint_c` to `Joint.end_c`."""
    setpoints, first = timing.setpoints[complete], timing.first[complete]
    touched = np.maximum(timing.touched[complete], first + 1)
    begin, end = track.values[first], track.values[touched - 1]
    lowest = np.minimum(segments(first, touched).least(track.values), outcomes.lowest)
    return setpoints, setpoints - begin, levels - begin, begin - lowest, lowest, end


def _joules(tip: _Tip, draw: Draw) -> float | None:
    return None if draw.heat is None or tip.rated_w is None else draw.heat * tip.rated_w / 1000


def _none_where_nan(column: Floats) -> list[float | None]:
    return [None if value != value else value for value in column.tolist()]


@dataclass(frozen=True, slots=True)
class _Outcomes:
    """What follows the start of each joint: whether the tip was back, whether a gap hid it or its
    setpoint is not known, and its lowest temperature until then.

    NaN: not back, or not known. An infinite `lowest` means none besides that of the contact.
    """

    is_back: Flags
    is_lost: Flags
    is_unset: Flags
    recovery: Floats
    had: Floats
    lowest: Floats

    def known(self, cuts: Sequence[str | None]) -> list[tuple[bool | None, str | None]]:
        """Return whether the tip recovered from each joint, and why not; `cuts` are what cut the
        joints off, None for the next draw.
        """
        flags = (self.is_unset, self.is_lost, self.is_back)
        rows = zip(*(some.tolist() for some in flags), cuts, strict=True)
        return [_outcome(*row) for row in rows]


def _outcome(
    is_unset: bool, is_lost: bool, is_back: bool, cut: str | None
) -> tuple[bool | None, str | None]:
    if is_unset:
        return None, UNKNOWN_SETPOINT
    if is_lost:
        return None, GAP
    if is_back:
        return True, None
    return (False, NEXT_CAME) if cut is None else (None, cut)


def _outcomes(tip: _Tip, timing: _Timing, complete: Places, floors: Floats) -> _Outcomes:
    """Return what follows the start of each joint, against the lower edge `floors` of its band; NaN
    without a setpoint.
    """
    track, first, last = tip.track, timing.first[complete], timing.last[complete]
    had = np.maximum(timing.stops[complete] - timing.starts[complete], 0.0)
    back, lowest = np.full(len(complete), -1, dtype=np.int64), np.full(len(complete), np.inf)
    some = np.flatnonzero(last > first)
    watched = segments(first[some], last[some])
    lowest[some] = watched.least(track.values)
    back[some] = _places_back(track, watched, floors[some], timing.stops[complete][some])
    back[had == 0] = -1
    is_back, lost = back >= 0, timing.gaps[complete] & (had > 0)
    lost[is_back] = track.gaps[back[is_back]] > track.gaps[first[is_back]]
    recovery = np.maximum(track.seconds[back] - timing.starts[complete], 0.0)
    recovery[lowest >= floors] = 0.0
    unset = np.isnan(floors)
    hidden = lost | unset
    recovery[~is_back | hidden], had[hidden], lowest[hidden] = np.nan, np.nan, np.inf
    return _Outcomes(is_back, lost, unset, recovery, had, lowest)


def _places_back(track: Track, watched: Segments, floors: Floats, stops: Floats) -> Places:
    """Return the index at which the temperature is back after its lowest, in each piece watched; -1
    where it is not.
    """
    rows, piece = watched.rows, np.repeat(np.arange(len(watched.first)), watched.lengths)
    low, lowest = track.values[rows] < floors[piece], watched.where_least(track.values)[piece]
    behind, before = rows > lowest, np.append(False, low[:-1])
    falls = np.flatnonzero(behind & low & ~before)  # where it leaves the band again
    begins = np.flatnonzero(~low & ((behind & before) | (rows == lowest)))
    ends = np.append(falls, len(rows))[np.searchsorted(falls, begins, side="right")]
    falls_again = ends < (watched.begins + watched.lengths)[piece[begins]]
    until = np.where(
        falls_again, track.seconds[rows[np.where(falls_again, ends, 0)]], stops[piece[begins]]
    )
    stays = np.zeros(len(rows), dtype=np.bool_)
    stays[begins] = until - track.seconds[rows[begins]] >= BACK_FOR_S - 1e-6
    return watched.first_row(stays)


def _energies(
    series: Series, timing: _Timing, complete: Places, outcomes: _Outcomes, draws: Sequence[Draw]
) -> Floats:
    """Return the energy of the joints that recovered; NaN for the others."""
    power = track_of(series, series.rows.power)
    above_air = track_of(series, series.rows.temperature - AIR_C)
    starts = timing.starts[complete]
    ends = np.maximum(starts + np.nan_to_num(outcomes.recovery), timing.ends[complete])
    loss = np.array(
        [np.nan if (one := draws[number].loss) is None else one for number in complete.tolist()]
    )
    late = np.array([draws[number].late_s for number in complete.tolist()])
    energies = power.area_between(starts - late, ends - late) - loss * above_air.area_between(
        starts, ends
    )
    is_known = (
        ~np.isnan(outcomes.recovery)
        & ~power.has_gap(starts - late, ends - late)
        & ~above_air.has_gap(starts, ends)
    )
    return np.where(is_known, energies, np.nan)
