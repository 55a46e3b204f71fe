"""From the ledger to the one value of an audit: every station's history traced, its tasks, its use, what drifted."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from jbclog.config.tasks_file import Task
from jbclog.maintenance.counter_totals.history import History, histories
from jbclog.maintenance.counter_totals.interval import Interval
from jbclog.maintenance.counter_totals.observed import Count, Entry, Observation
from jbclog.maintenance.counter_totals.totals import DOUBTFUL, CounterTotal, Difference, Kind, Trace, per_day
from jbclog.maintenance.counter_totals.tracing import Traces, traces_of
from jbclog.maintenance.drift import drifts
from jbclog.maintenance.due import TaskState, states_of
from jbclog.maintenance.fleet import Drift, FleetAudit, Meter, StationAudit
from jbclog.maintenance.gc_pause import uncollected
from jbclog.maintenance.ledger import Book
from jbclog.maintenance.use import WORK, Past, use_of
from jbclog.maintenance.weeks import weeks_of

Place = tuple[str, str]
"""Line and station."""

TOLD = DOUBTFUL | {Kind.RESET, Kind.REPLACED}


@uncollected()
def fleet_of(
    book: Book,
    seen: Sequence[Observation],
    audit: str,
    tasks: Sequence[Task] = (),
    watts: Mapping[Place, float] | None = None,
    beside: Iterable[Entry] = (),
) -> FleetAudit:
    """A row for each of `seen`, what this audit saw, in its order.

    `book` has it too, but for what could not be written (`beside`). `watts` is the rated power of stations that have one.
    """
    found = histories([*book.entries, *beside])
    past = {place: found.get(place, History(*place)) for place in map(_place, seen)}
    drifted = drifts({"/".join(place): history.looks for place, history in past.items()})
    rows = [
        _row(one, past[_place(one)], tasks, (watts or {}).get(_place(one)), drifted.get("/".join(_place(one)), ())) for one in seen
    ]
    return FleetAudit(
        line=", ".join(dict.fromkeys(one.line for one in seen)),
        audit=audit,
        ledger=str(book.path),
        ledger_head=book.head,
        stations=tuple(rows),
        wrong=book.sentences,
        facts=tuple(fact for history in past.values() for fact in history.facts),
    )


def _place(one: Observation) -> Place:
    return one.line, one.station


def _row(
    now: Observation, history: History, tasks: Sequence[Task], watts: float | None, drifted: tuple[Drift, ...]
) -> StationAudit:
    traces = traces_of(history)
    last = history.looks[-1] if history.looks else None
    who = now.identity or (last.identity if last else None)
    past = Past(traces.now, history.looks, now.time, watts, history.elapsed.is_right)
    work = [trace for (_, name), trace in sorted(traces.now.items()) if name == WORK]
    return StationAudit(
        line=now.line,
        station=now.station,
        url=now.url,
        seen=now.seen,
        why=now.why,
        source=now.source,
        last_seen=last.time if last else None,
        audits=len(history.looks),
        identity=who,
        meters=tuple(_meters(now, history, traces)),
        tasks=tuple(_tasks(tasks, now, who.family if who else None, traces, history)),
        use=use_of(past),
        errors=now.errors if now.seen else None,
        drifts=tuple(drifted),
        weeks=weeks_of(work, now.time, history.elapsed.is_right),
        notes=tuple(_notes(now, traces)),
    )


def _tasks(tasks: Sequence[Task], now: Observation, family: str | None, traces: Traces, history: History) -> Iterator[TaskState]:
    for task in tasks:
        if task.is_of(now.station, family):
            yield from states_of(task, [trace for _, trace in sorted(traces.now.items())], history.facts, now.time)


# -- counters -------------------------------------------------------------------------------------------------------------------


def _meters(now: Observation, history: History, traces: Traces) -> Iterator[Meter]:
    """Of every counter that is there now or ever was, as far as it is this station's."""
    read = {(one.port, one.counter): one for one in now.counts} if now.seen else {}
    for key in dict.fromkeys([*read, *traces.now]):
        trace = traces.now.get(key)
        if trace is not None:
            yield _meter(trace, read.get(key), history)
        else:
            one = read[key]
            unknown = CounterTotal(Interval(0.0, math.inf), now.time, 0.0, is_known=False)
            yield Meter(one.port, one.counter, one.unit, one, unknown, None, None)


def _meter(trace: Trace, read: Count | None, history: History) -> Meter:
    is_right = history.elapsed.is_right
    times = [history.times[point.look] if is_right(point.look) else math.nan for point in trace.points]
    return Meter(
        port=trace.port,
        counter=trace.counter,
        unit=trace.unit,
        read=read,
        odometer=trace.odometer,
        last=trace.differences[-1] if trace.differences else None,
        per_day=per_day(trace, times),
    )


# -- what is not as it should be ------------------------------------------------------------------------------------------------


def _notes(now: Observation, traces: Traces) -> Iterator[str]:
    """A sentence for every difference up to now that is no plain one."""
    for _, trace in sorted(traces.now.items()):
        for one in (*trace.aside, *trace.differences[-1:]):
            if one.end == now.time and (one.kind in TOLD or not one.is_known):
                yield _note(one)


def _note(one: Difference) -> str:
    return f"port {one.port}, {one.counter}: {one.before:g}, now {one.after:g}: {one.kind.value.replace('_', ' ')}. {one.text}"
