"""When a maintenance task is due: the rate of its counter, the forecast, its state."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jbclog.config.tasks_file import DAYS, Task
from jbclog.maintenance.counter_totals.observed import Fact
from jbclog.maintenance.counter_totals.span import NOTHING, Interval, seconds
from jbclog.maintenance.counter_totals.totals import Trace

# -- pace ---------------------------------------------------------------------------------------------------------------------
# How fast a counter goes, and how sure that is: what a forecast stands on.
#
# Use is uneven: weekends, holidays, products, orders. It is measured in weeks, so that weekends are in each; how much weeks, and
# months, differ from each other says how far a forecast can be off. A station that was watched for a short time only is taken to
# vary as stations do (`USUAL`), until it shows otherwise.

DAY: Final = 86400.0
WEEK: Final = 7 * DAY
USUAL: Final = 0.6  # the variance of a week's use, of its square, long-run: with what it has in common with the weeks beside it
USUAL_WEIGHT: Final = 6.0  # blocks that this counts as
BLOCK: Final = 4  # weeks
LEAST_DAYS: Final = 21.0  # of daily audits, before weekdays are distinguished
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
        for day, part_s in days_between(step.begin, step.end):
            worked[day] += step.worked * part_s / (step.end - step.begin)
            lasted[day] += part_s
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


# -- forecast -----------------------------------------------------------------------------------------------------------------
# When so much more will have been worked: a moment for each chance, none where it is beyond what can be told.
#
# Over t weeks a pace of one week's use each comes to t, with a variance of v (t + t^2 / n): the weeks to come differ by v each,
# and the pace itself is known from n weeks only. The moment by which an amount of d weeks is reached with a chance of which the
# normal deviate is z is the t with t - d = z sqrt(v (t + t^2 / n)).

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


# -- due ----------------------------------------------------------------------------------------------------------------------

LEAST_AUDITS: Final = 4
OVERDUE_PERCENT: Final = 120.0
SINCE_FIRST: Final = "counted since the first audit"


class State(StrEnum):
    """How a task stands; the worst of a station's is the station's."""

    FINE = "fine"
    UNKNOWN = "unknown"  # what was used since it was done cannot be told
    SOON = "soon"  # from 80 % on
    DUE = "due"  # from 100 %
    OVERDUE = "overdue"  # from 120 %


@dataclass(frozen=True, slots=True)
class Due:
    """When the task's life will have been used, as UTC dates: with a chance of 10, 50 and 90 % by then. Null: after the horizon."""

    p10: str | None
    p50: str | None
    p90: str | None


@dataclass(frozen=True, slots=True)
class TaskState:
    """One task of one station; `port` null where it is of the whole station.

    `used` and `percent` are intervals; null where nothing is known. `since` is when it was done last, or else since when it is
    counted (`is_told` false). `due` null says why in `why`: ``not enough data: 2 of 4 audits``. `told_by` says from where it is
    known when it was done; empty where the ledger has it.
    """

    task: str
    title: str
    port: int | None
    counter: str
    unit: str
    life: float
    used: Interval | None
    percent: Interval | None
    state: State
    since: str | None
    is_told: bool
    part: str = ""
    due: Due | None = None
    why: str = ""
    told_by: str = ""


def states_of(task: Task, traces: Sequence[Trace], facts: Sequence[Fact], now: str) -> Iterator[TaskState]:
    """The task at every port that has its counter, or once for the station. `facts` are the station's, oldest first.

    Those that are not in the ledger (`seq` 0) come where they belong by when they were told.
    """
    done = [fact for fact in facts if fact.task == task.name]
    if not all(fact.seq for fact in done):
        done.sort(key=lambda fact: seconds(fact.told))
    if task.counter == DAYS:
        yield _of_days(task, traces, done, now)
        return
    counted = [trace for trace in traces if trace.counter == task.counter and trace.points]
    groups = [counted] if task.of_station and counted else [[trace] for trace in counted]
    for group in groups:
        port = None if task.of_station else group[0].port
        told = [fact for fact in done if port is None or fact.port in (None, port)]
        yield _of_counter(task, group, port, told[-1] if told else None)


def _stands(task: Task, used: Interval) -> State:
    """By what was used at least; what can have been used warns."""
    least, most = 100 * used.low / task.life, 100 * used.high / task.life
    if least >= 100:
        return State.OVERDUE if least >= OVERDUE_PERCENT else State.DUE
    if most >= 100 and used.width > task.life / 2:
        return State.SOON if least >= task.warn_percent else State.UNKNOWN
    return State.SOON if most >= task.warn_percent else State.FINE


# -- by the calendar ------------------------------------------------------------------------------------------------------------


def _of_days(task: Task, traces: Sequence[Trace], told: Sequence[Fact], now: str) -> TaskState:
    state = TaskState(task.name, task.title, None, DAYS, "d", task.life, None, None, State.UNKNOWN, None, is_told=False)
    done = _longest_ago({trace.port for trace in traces}, told)
    if done is None:
        return _never(state, task, min((trace.points[0].time for trace in traces if trace.points), key=seconds, default=now), now)
    days = _days(done.time, now)
    date = _date(seconds(done.time) + task.life * DAY)
    state = replace(state, since=done.time, is_told=True, part=done.part, told_by=_source(done), due=Due(date, date, date))
    return _with_used(state, task, Interval(days, days))


def _longest_ago(ports: Collection[int], told: Sequence[Fact]) -> Fact | None:
    """The last fact of each port; of these the oldest, for a station is done when all of it is. Ports that nobody told of aside."""
    last = [next((fact for fact in reversed(told) if fact.port in (None, port)), None) for port in sorted(ports)]
    found = [fact for fact in last if fact is not None] or list(told[-1:])
    return min(found, key=lambda fact: seconds(fact.time), default=None)


def _never(state: TaskState, task: Task, first: str, now: str) -> TaskState:
    """Nobody told of it: it cannot have been done for longer than there are audits, and before that nothing is known."""
    at_least = Interval(_days(first, now), math.inf)
    waited = _with_used(replace(state, since=first, why=f"{task.never}: {SINCE_FIRST}"), task, at_least)
    return replace(state, why=task.never) if waited.state is State.UNKNOWN else waited


def _days(begin: str, end: str) -> float:
    return max(0.0, (seconds(end) - seconds(begin)) / DAY)


def _source(done: Fact) -> str:
    return "" if done.seq else done.text


def _with_used(state: TaskState, task: Task, used: Interval) -> TaskState:
    return replace(state, used=used, percent=used.per(task.life / 100), state=_stands(task, used))


# -- by a counter ---------------------------------------------------------------------------------------------------------------


def _of_counter(task: Task, group: Sequence[Trace], port: int | None, done: Fact | None) -> TaskState:
    begin = max(trace.points[0].time for trace in group)
    told = done if done is not None and seconds(done.time) >= seconds(begin) else None
    used = sum((used_since(trace, told.time if told else None) for trace in group), NOTHING)
    unit = {"h": "h", "mm": "mm"}.get(task.counter.rpartition("_")[2], "count")
    state = TaskState(task.name, task.title, port, task.counter, unit, task.life, None, None, State.UNKNOWN, begin, is_told=False)
    if told is not None:
        state = replace(state, since=told.time, is_told=True, part=told.part, told_by=_source(told))
    elif done is not None:
        state = replace(state, why="it was done before this station was first seen: counted since then")
    else:
        state = replace(state, why=f"{task.never}: {SINCE_FIRST}")
    state = _with_used(state, task, used)
    return state if state.state in (State.DUE, State.OVERDUE) else _foreseen(state, group)


def used_since(trace: Trace, time: str | None) -> Interval:
    """What was worked since `time`, or since the first reading."""
    last = len(trace.points) - 1
    if time is None:
        return trace.between(0, last)
    moment = seconds(time)
    begin = next((place for place, point in enumerate(trace.points) if seconds(point.time) >= moment), None)
    if begin is None:
        return NOTHING
    used = trace.between(begin, last)
    if not begin:
        return used
    delta = trace.differences[begin - 1].delta.high
    if trace.is_time:
        delta = min(delta, (seconds(trace.points[begin].time) - moment) / 3600)
    return Interval(used.low, used.high + delta)


def _foreseen(state: TaskState, group: Sequence[Trace]) -> TaskState:
    audits = min(len(trace.points) for trace in group)
    if audits < LEAST_AUDITS:
        return _without(state, f"not enough data: {audits} of {LEAST_AUDITS} audits")
    found = foresee(group, state.life, state.used or NOTHING)
    if found is None:
        return _without(state, "not enough data: it was not used, or not for two days")
    return replace(state, due=Due(*map(_date, (found.p10, found.p50, found.p90))))


def _without(state: TaskState, why: str) -> TaskState:
    return replace(state, why=f"{why}; {state.why}" if state.why else why)


def foresee(group: Sequence[Trace], life: float, used: Interval) -> Forecast | None:
    """When `life` will have been used, from the last reading on; None where there is no pace yet."""
    pace = pace_of(steps_of(group))
    if pace is None or not used.is_bounded:
        return None
    now = seconds(group[0].points[-1].time)
    return forecast(now, max(0.0, life - used.middle), pace, used.width**2 / 12)


def steps_of(group: Sequence[Trace]) -> list[Step]:
    """What was worked between looks, where it is known; of several ports together."""
    found: dict[tuple[float, float], float] = {}
    for trace in group:
        for one, before, after in zip(trace.differences, trace.points, trace.points[1:], strict=False):
            begin, end = seconds(one.begin), seconds(one.end)
            if one.is_known and begin < end:
                found[begin, end] = found.get((begin, end), 0.0) + after.shown.middle - before.shown.middle
    return [Step(*at, worked) for at, worked in sorted(found.items())]


def _date(moment: float | None) -> str | None:
    return None if moment is None else datetime.fromtimestamp(moment, UTC).date().isoformat()
