"""Build the result of an audit from the ledger."""

from __future__ import annotations

import difflib
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from shlex import quote
from typing import Final

from jbclog.config.task_names import STATED
from jbclog.config.tasks_file import Task
from jbclog.core.errors import UsageError
from jbclog.maintenance.counter_totals.history import History, histories
from jbclog.maintenance.counter_totals.judging import BESIDE, BREAKS
from jbclog.maintenance.counter_totals.observed import Count, Entry, Observation
from jbclog.maintenance.counter_totals.span import Interval
from jbclog.maintenance.counter_totals.totals import (
    DOUBTFUL,
    CounterTotal,
    Difference,
    DifferenceKind,
    Trace,
    per_day,
)
from jbclog.maintenance.counter_totals.tracing import Traces, traces_of
from jbclog.maintenance.due import TaskState, states_of
from jbclog.maintenance.fleet import BEFORE, FLEET, Drift, FleetAudit, Meter, StationAudit
from jbclog.maintenance.ledger import Book
from jbclog.maintenance.use import WORK, Past, use_of
from jbclog.maintenance.weeks import weeks_of

# -- naming ----------------------------------------------------------------------------------------
# Names of stations and tasks, looked up in the ledger and the tasks file; errors list the nearest
# names.

USUAL: Final = (
    "tip-change",
    "cartridge-change",
    "pump-filter",
    "feeder-rollers",
    "feeder-cutter",
    "verification",
    "service",
)
"""The tasks that can be recorded without a tasks file."""
MOST_NEAR: Final = 3

Place = tuple[str, str]
"""A line's name and a station's."""


def place_of(wanted: str, book: Book, also: Iterable[Place] = ()) -> Place:
    """Return the station ``NAME`` or ``LINE/NAME`` of the ledger or `also`. Raises `UsageError`."""
    known = {(one.line, one.station) for one in book.entries} | set(also)
    found = sorted(one for one in known if wanted in (one[1], "/".join(one)))
    if len(found) == 1:
        return found[0]
    if found:
        raise UsageError(
            f"--station {wanted}: several lines have a station of that name; give"
            f" {' or '.join(map('/'.join, found))}"
        )
    if not known:
        raise UsageError(
            f"{book.path} has no station yet: audit first, give --line, or name another ledger with"
            " --ledger"
        )
    raise UsageError(
        f"--station {wanted}: {book.path} has no station of that name;"
        f" {_near(wanted, {name for _, name in known})}"
    )


def expect_port(port: int | None, place: Place, book: Book) -> None:
    """Raise `UsageError` if the station, as last seen, has no such port."""
    last = next(
        (
            one
            for one in reversed(book.observations)
            if one.seen and (one.line, one.station) == place
        ),
        None,
    )
    ports = sorted({count.port for count in last.counts}) if last is not None else []
    if port is not None and ports and port not in ports:
        has = (
            f"its port is {ports[0]}"
            if len(ports) == 1
            else f"its ports are {', '.join(map(str, ports))}"
        )
        raise UsageError(f"--port {port}: {place[1]} has no such port; {has}")


def task_of(wanted: str, book: Book, names: Sequence[str] | None = None) -> str:
    """Return the task of that name (tasks file, usual ones, ledger). Raises `UsageError`."""
    known = {*STATED, *(fact.task for fact in book.facts), *(USUAL if names is None else names)}
    if wanted in known:
        return wanted
    more = "; give a tasks file with other tasks with --tasks" if names is None else ""
    raise UsageError(
        f"--task {wanted}: there is no task of that name; {_near(wanted, known)}{more}"
    )


def _near(wanted: str, known: Iterable[str]) -> str:
    names = sorted(known)
    near = difflib.get_close_matches(wanted[:64], names, n=MOST_NEAR, cutoff=0.6)
    return f"did you mean {', '.join(near)}?" if near else f"there are {', '.join(names)}"


# -- drift -----------------------------------------------------------------------------------------
# Software and parameters that differ from the last audit or from the fleet.
#
# Software is compared among stations of one model, a parameter among ports of one family with the
# same tool. A value drifts if at least three of the group, and three quarters of it, have one other
# value. A fleet with several recipes has no such majority.

FEWEST: Final = 3
MAJORITY: Final = 3 / 4


@dataclass(frozen=True, slots=True)
class Held:
    """One value of a station, with its name and the group in which it is compared (`alike`)."""

    station: str
    name: str
    value: str
    alike: tuple[str, ...]


def drifts(looks: Mapping[str, Sequence[Observation]]) -> dict[str, tuple[Drift, ...]]:
    """Return what drifted at each station; `looks` are those that it answered, oldest first."""
    held = {name: list(_held(seen[-1])) for name, seen in looks.items() if seen}
    groups: dict[tuple[str, ...], Counter[str]] = defaultdict(Counter)
    for values in held.values():
        for one in values:
            groups[one.alike][one.value] += 1
    return {
        name: (*_since_last(looks[name]), *_from_fleet(values, groups))
        for name, values in held.items()
    }


def _held(look: Observation) -> Iterator[Held]:
    if look.identity is None:
        return
    kind = look.identity.model or look.identity.family
    tools = {str(port): tool for port, tool in look.tool_names.items()}
    if look.identity.software is not None:
        yield Held(look.station, "software", look.identity.software, ("software", kind))
    for name, value in sorted(look.parameters.items()):
        port, _, setting = name.rpartition(".")
        alike = (setting, look.identity.family, tools.get(port, ""))
        yield Held(look.station, name, value, alike)


def _since_last(seen: Sequence[Observation]) -> Iterator[Drift]:
    if len(seen) < 2:
        return
    before = {one.name: one for one in _held(seen[-2])}
    for one in _held(seen[-1]):
        was = before.get(one.name)
        if was is not None and was.alike == one.alike and was.value != one.value:
            yield Drift(one.name, one.value, was.value, BEFORE)


def _from_fleet(
    values: Sequence[Held], groups: Mapping[tuple[str, ...], Counter[str]]
) -> Iterator[Drift]:
    for one in values:
        group = groups[one.alike]
        value, held_by = group.most_common(1)[0]
        if value != one.value and held_by >= max(FEWEST, MAJORITY * group.total()):
            yield Drift(one.name, one.value, value, FLEET, held_by, group.total() - 1)


# -- fleet of ledger -------------------------------------------------------------------------------

NOTED = DOUBTFUL | {DifferenceKind.RESET, DifferenceKind.REPLACED}
MOST_NAMED: Final = 3  # counters of a question


def fleet_of(
    book: Book,
    seen: Sequence[Observation],
    audit: str,
    tasks: Sequence[Task] = (),
    watts: Mapping[Place, float] | None = None,
    beside: Iterable[Entry] = (),
) -> FleetAudit:
    """Return the result of an audit: a row for each of its observations `seen`, in order.

    `book` contains them, too, except those that could not be written (`beside`). `watts`: rated
    power by station, if declared.
    """
    found = histories([*book.entries, *beside])
    past = {place: found.get(place, History(*place)) for place in map(_place, seen)}
    drifted = drifts({"/".join(place): history.looks for place, history in past.items()})
    rows = [
        _row(
            one,
            past[_place(one)],
            tasks,
            (watts or {}).get(_place(one)),
            drifted.get("/".join(_place(one)), ()),
        )
        for one in seen
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
    now: Observation,
    history: History,
    tasks: Sequence[Task],
    watts: float | None,
    drifted: tuple[Drift, ...],
) -> StationAudit:
    traces = traces_of(history)
    last = history.looks[-1] if history.looks else None
    who = now.identity or (last.identity if last else None)
    past = Past(traces.now, history.looks, now.time, watts, history.elapsed.is_right)
    work = [trace for (_, name), trace in sorted(traces.now.items()) if name == WORK]
    changes = list(_changes(now, traces))
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
        notes=tuple(_notes(changes)),
        question=_question(changes, now.station),
    )


def _tasks(
    tasks: Sequence[Task], now: Observation, family: str | None, traces: Traces, history: History
) -> Iterator[TaskState]:
    for task in tasks:
        if task.is_of(now.station, family):
            yield from states_of(
                task, [trace for _, trace in sorted(traces.now.items())], history.facts, now.time
            )


# -- counters --------------------------------------------------------------------------------------


def _meters(now: Observation, history: History, traces: Traces) -> Iterator[Meter]:
    """Yield every counter read now or earlier, of the current station."""
    read = {(one.port, one.counter): one for one in now.counts} if now.seen else {}
    for key in dict.fromkeys([*read, *traces.now]):
        trace = traces.now.get(key)
        if trace is not None:
            yield _meter(trace, read.get(key), history)
        else:
            one = read[key]
            unknown = CounterTotal(Interval(0.0, math.inf), now.time, 0.0, is_known=False)
            yield Meter(one.port, one.counter, one.uom, one, unknown, None, None)


def _meter(trace: Trace, read: Count | None, history: History) -> Meter:
    is_right = history.elapsed.is_right
    times = [
        history.times[point.look] if is_right(point.look) else math.nan for point in trace.points
    ]
    return Meter(
        port=trace.port,
        counter=trace.counter,
        uom=trace.uom,
        read=read,
        counter_total=trace.counter_total,
        last=trace.difference(-1) if trace.kept else None,
        per_day=per_day(trace, times),
    )


# -- notes -----------------------------------------------------------------------------------------


def _changes(now: Observation, traces: Traces) -> Iterator[Difference]:
    """Yield the differences that end with this look."""
    for _, trace in sorted(traces.now.items()):
        last = [trace.difference(-1)] if trace.kept else []
        yield from (change for change in (*trace.aside, *last) if change.stop == now.time)


def unanswered_falls(book: Book, place: Place) -> list[tuple[str, str]]:
    """Return begin and end of each span in which a station's counters broke off and nobody has
    recorded why, oldest first.
    """
    history = histories(book.entries).get(place)
    if history is None:
        return []
    spans = {
        (change.start, change.stop)
        for trace in traces_of(history).now.values()
        for change in (*trace.aside, *trace.differences)
        if change.rule in BREAKS
    }
    return sorted(spans)


def _question(changes: Iterable[Difference], station: str) -> str:
    """Return what a person must record of counters that do not continue; empty if all do."""
    broken = [change for change in changes if change.rule in BREAKS]
    if not broken:
        return ""
    each = [
        f"port {change.port} {change.counter} {change.before:g}, now {change.after:g}"
        for change in broken[:MOST_NAMED]
    ]
    more = len(broken) - len(each)
    if more:
        each.append(f"and {more} more")
    start, stop = max(change.start for change in broken), broken[0].stop
    command = f"jbclog maintenance done --station {quote(station)} --at {stop} --task"
    return (
        f"{'; '.join(each)}: reset, exchanged, or rolled over between {_minute(start)} and"
        f" {_minute(stop)}. Record which: `{command}` {', '.join(STATED[:-1])} or {STATED[-1]}"
    )


def _minute(time: str) -> str:
    return time[:16].replace("T", " ")


def _notes(changes: Iterable[Difference]) -> Iterator[str]:
    """Yield a sentence for every other doubtful or unknown difference, reset or replacement."""
    for change in changes:
        if change.rule in BREAKS or change.rule == BESIDE:
            continue
        if change.kind in NOTED or not change.is_known:
            yield _note(change)


def _note(one: Difference) -> str:
    return (
        f"port {one.port}, {one.counter}: {one.before:g}, now {one.after:g}:"
        f" {one.kind.value.replace('_', ' ')}. {one.text}"
    )
