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
from jbclog.maintenance.ledger import unit_of

# -- pace ------------------------------------------------------------------------------------------
# The rate of a counter and its uncertainty: the basis of a forecast.
#
# Use is uneven: weekends, holidays, products, orders. The unit is a week, so that each has its
# weekend; the variance between weeks and months bounds the forecast. A station with a short history
# starts with the usual variance (`USUAL`).

DAY: Final = 86400.0
WEEK: Final = 7 * DAY
# long-run variance of a week's use relative to its square, correlation with neighbouring weeks
# included
USUAL: Final = 0.6
USUAL_WEIGHT: Final = 6.0  # number of blocks that it counts as
BLOCK: Final = 4  # weeks
LEAST_DAYS: Final = 21.0  # daily audits needed before weekdays are distinguished
LEAST_LASTED: Final = 2 * DAY

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """The middle of the advance from one look to the next; times in seconds since 1970."""

    start: float
    stop: float
    worked: float


@dataclass(frozen=True, slots=True)
class Pace:
    """The rate of a counter.

    - `a_week`: the advance in a week
    - `variance`: long-run, of a week's advance relative to its square
    - `weeks`: the length of the history
    - `weekdays`: the share of each day, Monday first, with a mean of 1
    """

    a_week: float
    variance: float
    weeks: float
    weekdays: tuple[float, ...]


def pace_of(steps: Sequence[Step]) -> Pace | None:
    """Return the rate over these steps; None for less than two days or no advance."""
    lasted = sum(step.stop - step.start for step in steps)
    worked = sum(step.worked for step in steps)
    if lasted < LEAST_LASTED or worked <= 0:
        return None
    weeks = lasted / WEEK
    return Pace(worked / weeks, _variance(steps, worked / weeks), weeks, _weekdays(steps))


def _variance(steps: Sequence[Step], a_week: float) -> float:
    """Return the weighted mean of the usual variance and that of blocks of weeks."""
    median_weeks = max(1.0, float(np.median([step.stop - step.start for step in steps])) / WEEK)
    length = BLOCK * math.ceil(median_weeks)
    blocks = _blocks(steps, length)
    if len(blocks) < 2:
        return USUAL
    seen, weight = length * float(np.var(blocks / length / a_week, ddof=1)), len(blocks) - 1
    return (USUAL * USUAL_WEIGHT + seen * weight) / (USUAL_WEIGHT + weight)


def _blocks(steps: Sequence[Step], weeks: float) -> Numbers:
    """Return the advance in each block of `weeks`, back from the last look, without the rest."""
    lasted = np.concatenate([[0.0], np.cumsum([step.stop - step.start for step in steps])])
    worked = np.concatenate([[0.0], np.cumsum([step.worked for step in steps])])
    ends = np.arange(lasted[-1], -1e-6, -weeks * WEEK)[::-1]
    return np.diff(np.interp(ends, lasted, worked))


def _weekdays(steps: Sequence[Step]) -> tuple[float, ...]:
    """Return the share of each weekday by looks a day apart; equal shares if there are too few."""
    daily = [step for step in steps if 0.5 * DAY < step.stop - step.start < 1.5 * DAY]
    if len(daily) < LEAST_DAYS or len(daily) < 0.5 * len(steps):
        return (1.0,) * 7
    worked, lasted = np.zeros(7), np.zeros(7)
    for step in daily:
        for day, part_s in days_between(step.start, step.stop):
            worked[day] += step.worked * part_s / (step.stop - step.start)
            lasted[day] += part_s
    if worked.sum() <= 0 or not lasted.all():
        return (1.0,) * 7
    shares = worked / lasted
    return tuple(float(one) for one in shares / shares.mean())


def days_between(begin: float, end: float) -> list[tuple[int, float]]:
    """Return the weekdays (UTC, Monday 0) between two times, with the seconds of each."""
    found = []
    while begin < end:
        stop = min(end, (math.floor(begin / DAY) + 1) * DAY)
        found.append((weekday(begin), stop - begin))
        begin = stop
    return found


def weekday(time: float) -> int:
    """Return the weekday of a time; Monday is 0."""
    return (math.floor(time / DAY) + 3) % 7  # 1970 began on a Thursday


# -- forecast --------------------------------------------------------------------------------------
# When a counter will have advanced by an amount: a time for each probability, none beyond the
# horizon.
#
# The use of t weeks, in units of the mean week, has the mean t and the variance v (t + t^2 / n):
# each future week varies by v, and the mean itself is known from n weeks only. The time by which an
# amount of d weeks is reached with the probability of the normal deviate z is the t that solves t -
# d = z sqrt(v (t + t^2 / n)).

LATE: Final = 1.2816  # normal deviate of 90 %
# more than that of 10 %: work comes in surges, and a part that wears out before its forecast does
# harm
EARLY: Final = 1.6
LASTING: Final = 0.03  # variance that does not average out: seasons, shutdowns, other work
HORIZON_WEEKS: Final = 520.0


@dataclass(frozen=True, slots=True)
class Forecast:
    """Times (seconds since 1970) by which it is reached with a probability of 10, 50, 90 %; None:
    more than ten years ahead.
    """

    p10: float | None
    p50: float | None
    p90: float | None


def forecast(now: float, left: float, pace: Pace, doubt: float = 0.0) -> Forecast:
    """Return when the counter will have advanced by `left`, whose variance is `doubt`."""
    return Forecast(
        *(_moment(now, _weeks(left, pace, doubt, z), pace) for z in (-EARLY, 0.0, LATE))
    )


def _weeks(left: float, pace: Pace, doubt: float, z: float) -> float:
    """Return the root of (t - d)^2 = z^2 (v t + v t^2 / n + u), below d if z < 0, else above."""
    mean, by = left / pace.a_week, z * z * pace.variance
    square = 1 - by / pace.weeks - z * z * LASTING
    half, rest = mean + by / 2, mean * mean - z * z * doubt / pace.a_week**2
    root = math.sqrt(max(0.0, half * half - square * rest))
    if z > 0:
        return (half + root) / square if square > 1e-9 else math.inf
    return max(0.0, rest / (half + root)) if half + root > 0 else 0.0


def _moment(now: float, weeks: float, pace: Pace) -> float | None:
    """Return the time when that many weeks' use is reached, by the shares of the weekdays."""
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


# -- due -------------------------------------------------------------------------------------------

LEAST_AUDITS: Final = 4
OVERDUE_PERCENT: Final = 120.0
SINCE_FIRST: Final = "counted since the first audit"


class State(StrEnum):
    """The state of a task; a station has that of its worst task."""

    FINE = "fine"
    UNKNOWN = "unknown"  # the use since it was done is not known well enough
    SOON = "soon"  # from 80 % on
    DUE = "due"  # from 100 %
    OVERDUE = "overdue"  # from 120 %


@dataclass(frozen=True, slots=True)
class Due:
    """UTC dates by which the service interval ends with a probability of 10, 50 and 90 %; null:
    beyond the horizon.
    """

    p10: str | None
    p50: str | None
    p90: str | None


@dataclass(frozen=True, slots=True)
class TaskState:
    """One task of one station; `port` is null for a task of the whole station.

    - `used`, `percent`: intervals, null if not known
    - `life`: the service interval
    - `since`: when the task was last done or, if that is not known (`is_told` false), when counting
      started
    - `why`: the reason for a null `due`: ``not enough data: 2 of 4 audits``
    - `told_by`: the source of the service date; empty for the ledger
    """

    task: str
    title: str
    port: int | None
    counter: str
    uom: str
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


def states_of(
    task: Task, traces: Sequence[Trace], facts: Sequence[Fact], now: str
) -> Iterator[TaskState]:
    """Yield the task's state at every port that has its counter, or once for the station. `facts`
    are the station's, oldest first.

    Facts that are not in the ledger (`seq` 0) are ordered by the time they were recorded.
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
        of_port = [fact for fact in done if port is None or fact.port in (None, port)]
        yield _of_counter(task, group, port, of_port[-1] if of_port else None)


def _state_of(task: Task, used: Interval) -> State:
    """Return the state by the least use; the greatest possible use only warns."""
    least, most = 100 * used.low / task.life, 100 * used.high / task.life
    if least >= 100:
        return State.OVERDUE if least >= OVERDUE_PERCENT else State.DUE
    if most >= 100 and used.width > task.life / 2:
        return State.SOON if least >= task.warn_percent else State.UNKNOWN
    return State.SOON if most >= task.warn_percent else State.FINE


# -- by the calendar -------------------------------------------------------------------------------


def _of_days(task: Task, traces: Sequence[Trace], facts: Sequence[Fact], now: str) -> TaskState:
    state = TaskState(
        task.name,
        task.title,
        None,
        DAYS,
        "d",
        task.life,
        None,
        None,
        State.UNKNOWN,
        None,
        is_told=False,
    )
    done = _longest_ago({trace.port for trace in traces}, facts)
    if done is None:
        first = min(
            (trace.points[0].time for trace in traces if trace.points), key=seconds, default=now
        )
        return _without_date(state, task, first, now)
    days = _days(done.time, now)
    date = _date(seconds(done.time) + task.life * DAY)
    state = replace(
        state,
        since=done.time,
        is_told=True,
        part=done.part,
        told_by=_source(done),
        due=Due(date, date, date),
    )
    return _with_used(state, task, Interval(days, days))


def _longest_ago(ports: Collection[int], facts: Sequence[Fact]) -> Fact | None:
    """Return the oldest of the ports' last facts: a station is done when all its ports are. Ports
    without a fact do not count.
    """
    last = [
        next((fact for fact in reversed(facts) if fact.port in (None, port)), None)
        for port in sorted(ports)
    ]
    found = [fact for fact in last if fact is not None] or list(facts[-1:])
    return min(found, key=lambda fact: seconds(fact.time), default=None)


def _without_date(state: TaskState, task: Task, first: str, now: str) -> TaskState:
    """Count from the first audit if the last service date is unknown; the use may be greater."""
    at_least = Interval(_days(first, now), math.inf)
    waited = _with_used(
        replace(state, since=first, why=f"{task.never}: {SINCE_FIRST}"), task, at_least
    )
    return replace(state, why=task.never) if waited.state is State.UNKNOWN else waited


def _days(begin: str, end: str) -> float:
    return max(0.0, (seconds(end) - seconds(begin)) / DAY)


def _source(done: Fact) -> str:
    return "" if done.seq else done.text


def _with_used(state: TaskState, task: Task, used: Interval) -> TaskState:
    return replace(state, used=used, percent=used.per(task.life / 100), state=_state_of(task, used))


# -- by a counter ----------------------------------------------------------------------------------


def _of_counter(
    task: Task, group: Sequence[Trace], port: int | None, done: Fact | None
) -> TaskState:
    begin = max(trace.points[0].time for trace in group)
    known = done if done is not None and seconds(done.time) >= seconds(begin) else None
    used = sum((used_since(trace, known.time if known else None) for trace in group), NOTHING)
    state = TaskState(
        task.name,
        task.title,
        port,
        task.counter,
        unit_of(task.counter),
        task.life,
        None,
        None,
        State.UNKNOWN,
        begin,
        is_told=False,
    )
    if known is not None:
        state = replace(
            state, since=known.time, is_told=True, part=known.part, told_by=_source(known)
        )
    elif done is not None:
        state = replace(state, why="done before this station was first seen: counted since then")
    else:
        state = replace(state, why=f"{task.never}: {SINCE_FIRST}")
    state = _with_used(state, task, used)
    return state if state.state in (State.DUE, State.OVERDUE) else _foreseen(state, group)


def used_since(trace: Trace, time: str | None) -> Interval:
    """Return the advance since `time`, or since the first reading."""
    last = len(trace.points) - 1
    if time is None:
        return trace.between(0, last)
    moment = seconds(time)
    begin = next(
        (place for place, point in enumerate(trace.points) if seconds(point.time) >= moment), None
    )
    if begin is None:
        return NOTHING
    used = trace.between(begin, last)
    if not begin:
        return used
    delta = trace.difference(begin - 1).delta.high
    if trace.is_time:
        delta = min(delta, (seconds(trace.points[begin].time) - moment) / 3600)
    return Interval(used.low, used.high + delta)


def _foreseen(state: TaskState, group: Sequence[Trace]) -> TaskState:
    audits = min(len(trace.points) for trace in group)
    if audits < LEAST_AUDITS:
        return _without(state, f"not enough data: {audits} of {LEAST_AUDITS} audits")
    found = foresee(group, state.life, state.used or NOTHING)
    if found is None:
        return _without(state, "not enough data: not used, or for less than two days")
    return replace(state, due=Due(*map(_date, (found.p10, found.p50, found.p90))))


def _without(state: TaskState, why: str) -> TaskState:
    return replace(state, why=f"{why}; {state.why}" if state.why else why)


def foresee(group: Sequence[Trace], life: float, used: Interval) -> Forecast | None:
    """Return when the service interval `life` ends, from the last reading; None without a rate or a
    bound on `used`.
    """
    pace = pace_of(steps_of(group))
    if pace is None or not used.is_bounded:
        return None
    now = seconds(group[0].points[-1].time)
    return forecast(now, max(0.0, life - used.middle), pace, used.width**2 / 12)


def steps_of(group: Sequence[Trace]) -> list[Step]:
    """Return the known advances between looks, of several ports together."""
    found: dict[tuple[float, float], float] = {}
    for trace in group:
        for one, before, after in zip(trace.kept, trace.points, trace.points[1:], strict=False):
            begin, end = seconds(before.time), seconds(after.time)
            if (one is None or one.is_known) and begin < end:
                found[begin, end] = (
                    found.get((begin, end), 0.0) + after.shown.middle - before.shown.middle
                )
    return [Step(*at, worked) for at, worked in sorted(found.items())]


def _date(moment: float | None) -> str | None:
    return None if moment is None else datetime.fromtimestamp(moment, UTC).date().isoformat()
