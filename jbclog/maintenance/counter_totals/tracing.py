"""Trace every counter through a station's history.

A history with doubtful roll-overs is traced twice: the first pass learns the counters' rates and
ratios from known differences.
"""

from __future__ import annotations

import math
from collections import Counter as Counted
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from jbclog.config.task_names import REPLACED, RESET
from jbclog.maintenance.counter_totals.judging import (
    OPEN,
    RULES,
    Judged,
    MakeSpan,
    Ratios,
    Resets,
    counted_on,
    is_ordinary,
    judge,
    judge_doubted,
    misread,
    ratios_of,
    replaced,
)
from jbclog.maintenance.counter_totals.observed import (
    DRIFT,
    FIVE_DIGITS,
    HOURS,
    Count,
    Entry,
    Fact,
    Observation,
    Standing,
    Trait,
    modulus_of,
    trait_of,
)
from jbclog.maintenance.counter_totals.span import (
    LEAST_HOURS,
    NOTHING,
    Elapsed,
    Interval,
    Reading,
    Span,
    seconds,
    top_of,
)
from jbclog.maintenance.counter_totals.totals import Difference, DifferenceKind, Join, Point, Trace

# -- history ---------------------------------------------------------------------------------------
# The entries of one station in the ledger, in order: its looks and its facts.

Key = tuple[int, str]
"""A counter of a station: port and name."""

MOVES_AT_MOST = 1000.0  # reads of one look that differ by more are not those of a moving counter


@dataclass
class History:
    """One station of one line. `looks`: observations that it answered; `all`: the others, too."""

    line: str
    station: str
    all: list[Observation] = field(default_factory=list)
    facts: list[Fact] = field(default_factory=list)

    @cached_property
    def looks(self) -> list[Observation]:
        return [one for one in self.all if one.seen]

    @cached_property
    def times(self) -> list[float]:
        """Times of the looks in seconds since 1970, by the host's clock."""
        return [seconds(one.time) for one in self.looks]

    @cached_property
    def elapsed(self) -> Elapsed:
        return Elapsed(self.times)

    @cached_property
    def readings(self) -> dict[Key, list[Reading]]:
        """The readings of every counter, oldest first."""
        found: dict[Key, list[Reading]] = {}
        for look, seen in enumerate(self.looks):
            for count in seen.counts:
                shown = _shown(count)
                if shown is not None:
                    found.setdefault((count.port, count.counter), []).append(Reading(look, shown))
        return found

    def stated(self, task: str, begin: int, end: int) -> Iterator[Fact]:
        """Yield the facts of a task of `STATED` whose time is between two looks."""
        for fact in self.facts:
            if fact.task == task and self.times[begin] < seconds(fact.time) <= self.times[end]:
                yield fact


def _shown(count: Count) -> Interval | None:
    if count.standing is Standing.OK and count.value is not None:
        return Interval(count.value, count.value)
    if count.standing is Standing.MOVING and count.values:
        low, high = min(count.values), max(count.values)
        return Interval(low, high) if high - low <= MOVES_AT_MOST else None
    return None


def histories(entries: Iterable[Entry]) -> dict[tuple[str, str], History]:
    """Return the histories by line and station, in the order of their first entries."""
    found: dict[tuple[str, str], History] = {}
    for entry in entries:
        history = found.setdefault((entry.line, entry.station), History(entry.line, entry.station))
        if isinstance(entry, Fact):
            history.facts.append(entry)
        else:
            history.all.append(entry)
    return found


# -- fast path -------------------------------------------------------------------------------------
# Looks without an event: every counter continues, and every port rules out a reset. Most looks are
# such.
#
# A long ledger has half a million differences. The fast path applies the rules of `judging.py` and
# `span.py` to a whole look at once, in plain numbers, and leaves every other look to them.

LAST_HOUR = top_of(FIVE_DIGITS, HOURS)
Readings = Mapping[Key, Reading]


@dataclass(slots=True)
class Counter:
    """The constants of a counter. `pace`: the greatest usual advance per hour of `hours`; None if
    too little was seen.
    """

    key: Key
    trait: Trait
    modulus: float
    pace: float | None
    step: float = field(init=False)
    top: float = field(init=False)
    fastest: float = field(init=False)
    is_time: bool = field(init=False)
    hours: tuple[Key, ...] = field(init=False)

    def __post_init__(self) -> None:
        self.step, self.fastest, self.is_time = (
            self.trait.step,
            self.trait.fastest,
            self.trait.is_time,
        )
        self.top = top_of(self.modulus, self.trait)
        self.hours = tuple((self.key[0], name) for name in self.trait.hours)


def is_plain(
    look: int, last: Readings, now: Readings, counters: Mapping[Key, Counter], elapsed_h: float
) -> bool:
    """Whether every counter read at a look continues from the look before, at most `elapsed_h`
    (finite) earlier.
    """
    ports, sure = set(), set()
    for key, after in now.items():
        before, counter = last.get(key), counters[key]
        if before is None or before.look != look - 1:
            return False
        lasted = (
            elapsed_h * DRIFT
            if counter.is_time
            else lasted_h(counter.hours, last, now, before.look, elapsed_h)
        )
        if not _continues(counter, before.shown, after.shown, lasted):
            return False
        ports.add(key[0])
        if after.shown.low > elapsed_h * (DRIFT if counter.is_time else counter.fastest):
            sure.add(key[0])
    return bool(ports) and ports == sure


def lasted_h(
    hours: Sequence[Key], last: Readings, now: Readings, look: int, elapsed_h: float
) -> float:
    """Return how long a counter of events can have counted: by its first hour counter, or by the
    elapsed time.

    An hour counter at its last number may have stopped, and is not used."""
    for key in hours:
        before, after = last.get(key), now.get(key)
        if (
            before
            and after
            and before.look == look
            and before.shown.low <= after.shown.high < LAST_HOUR
        ):
            return min(elapsed_h * DRIFT, after.shown.high - before.shown.low + 1.0)
    return elapsed_h * DRIFT


def _continues(counter: Counter, before: Interval, after: Interval, lasted: float) -> bool:
    """Whether it advanced at a plausible rate and cannot have rolled over (see `counted_on`)."""
    if after.high >= counter.top or after.high < before.low:
        return False
    grown, most = after.low - before.high, lasted if counter.is_time else lasted * counter.fastest
    if grown > most + counter.step:
        return False
    usual = most if counter.pace is None else min(most, counter.pace * max(lasted, LEAST_HOURS))
    return (usual + counter.step - grown) / counter.modulus < 1.0


def difference(
    counter: Counter, before: Reading, after: Reading, begin: str, end: str
) -> Difference:
    """Return the difference of a counter that continues."""
    low, high = after.shown.low - before.shown.high, after.shown.high - before.shown.low
    is_unchanged = low <= 0 <= high
    rule = "unchanged" if is_unchanged else "went_on"
    worked = Interval(max(0.0, low - counter.step), max(0.0, high) + counter.step)
    kind = DifferenceKind.ZERO if is_unchanged else DifferenceKind.NORMAL
    return Difference(
        *counter.key,
        begin,
        end,
        before.shown.low,
        after.shown.low,
        kind,
        rule,
        RULES[rule],
        worked,
        is_known=True,
    )


# -- tracing ---------------------------------------------------------------------------------------

MARGIN = 10.0  # factor by which other work may advance a counter faster than ever seen
LEAST_SEEN = 6  # fewer may all be from quiet weeks
UNSURE = frozenset({*OPEN, "rolled_over_or_reset"})


@dataclass
class Traces:
    """The counters of the current station (`now`) and of those that it replaced (`earlier`)."""

    history: History
    now: dict[Key, Trace] = field(default_factory=dict)
    earlier: list[Trace] = field(default_factory=list)


def traces_of(history: History) -> Traces:
    """Return the trace of every counter."""
    first = _Pass(history, {}, {})
    first.run()
    is_unsure = any(one.rule in UNSURE for judged in first.judged for one in judged)
    if not is_unsure and not first.late:
        return first.traces
    judged = [*first.judged, *first.plain()]
    paces, ratios = (_paces(judged), ratios_of(judged)) if is_unsure else ({}, {})
    second = _Pass(history, paces, ratios, first.late)
    second.run()
    return second.traces


def _doubted_looks(left_out: Iterable[Collection[int]]) -> Iterator[int]:
    """Yield the looks that another unit answered once, because several counters are ignored, and
    the looks after them.
    """
    for look, counters in Counted(look for looks in left_out for look in looks).items():
        if counters > 1:
            yield from (look, look + 1)


def _paces(looks: Sequence[Sequence[Judged]]) -> dict[Key, float]:
    """Return the greatest advance of each counter per hour of its hour counter, with a margin."""
    seen: dict[Key, list[float]] = {}
    for one in (one for judged in looks for one in judged):
        hours = one.span.most / one.span.trait.fastest
        if one.is_known and not one.span.trait.is_time and hours >= LEAST_HOURS:
            seen.setdefault((one.span.port, one.span.counter), []).append(one.delta.high / hours)
    return {key: MARGIN * max(paces) for key, paces in seen.items() if len(paces) >= LEAST_SEEN}


class _Pass:
    """One pass through a history, with the `paces` and `ratios` of an earlier pass. `doubted`:
    looks before which the unit may have been exchanged, as later looks showed; `late`: those that
    this pass finds."""

    def __init__(
        self,
        history: History,
        paces: Mapping[Key, float],
        ratios: Ratios,
        doubted: Collection[int] = (),
    ) -> None:
        self.history, self.paces, self.ratios = history, paces, ratios
        self.traces = Traces(history)
        self.judged: list[list[Judged]] = []
        self._counters = {key: self._counter(key, found) for key, found in history.readings.items()}
        self._left_out = {
            key: misread(found, self._maker(key)) for key, found in history.readings.items()
        }
        self._doubted = {*doubted, *_doubted_looks(self._left_out.values())}
        self.late: set[int] = set()
        self._odd = self._doubted.union(*self._left_out.values())
        self._by_look: list[dict[Key, Reading]] = [{} for _ in history.looks]
        self._plain: list[int] = []
        self._last: dict[Key, Reading] = {}
        self._of_other: dict[Key, Reading] = {}
        self._resets = Resets()
        self._rolled: dict[Key, float] = {}  # what roll-overs add to a reading

    def _counter(self, key: Key, found: Sequence[Reading]) -> Counter:
        return Counter(
            key,
            trait_of(key[1]),
            modulus_of(key[1], (one.shown.high for one in found)),
            self.paces.get(key),
        )

    def run(self) -> None:
        """Trace all looks."""
        for key, found in self.history.readings.items():
            for reading in found:
                self._by_look[reading.look][key] = reading
        for look, readings in enumerate(self._by_look):
            if self._is_plain(look, readings):
                self._add_plain(look, readings)
            else:
                self._add_judged(look, readings)

    # -- looks without an event --------------------------------------------------------------------

    def _is_plain(self, look: int, readings: Mapping[Key, Reading]) -> bool:
        if not look or look in self._odd or self._replaced(look, ()) is not None:
            return False
        elapsed_h = self.history.elapsed.at_most_h(look - 1, look)
        return math.isfinite(elapsed_h) and is_plain(
            look, self._last, readings, self._counters, elapsed_h
        )

    def _add_plain(self, look: int, readings: Mapping[Key, Reading]) -> None:
        begin, end = self.history.looks[look - 1].time, self.history.looks[look].time
        for key, one in readings.items():
            trace, by = self.traces.now[key], self._rolled.get(key, 0.0)
            shown = Interval(one.shown.low + by, one.shown.high + by) if by else one.shown
            trace.points.append(Point(look, end, shown))
            trace.differences.append(
                difference(self._counters[key], self._last[key], one, begin, end)
            )
        self._last |= readings
        self._plain.append(look)

    def plain(self) -> Iterator[list[Judged]]:
        """Yield the judgements of event counters at these looks."""
        for look in self._plain:
            before, now = self._by_look[look - 1], self._by_look[look]
            events = (key for key in now if not self._counters[key].is_time)
            yield [counted_on(self._span_of(key, before, now)) for key in events]

    # -- other looks -------------------------------------------------------------------------------

    def _add_judged(self, look: int, readings: Mapping[Key, Reading]) -> None:
        fitting = {key: one for key, one in readings.items() if look not in self._left_out[key]}
        spans = [self._span_of(key, self._last, fitting) for key in fitting if key in self._last]
        rule = self._replaced(look, spans) if look else None
        if rule is not None:
            self._start_new_station()
        else:
            judged = self._judged(spans, look)
            self.judged.append(judged)
            for found in judged:
                self._keep(found)
        for key, one in readings.items():
            self._note(key, one, rule)

    def _judged(self, spans: Sequence[Span], look: int) -> list[Judged]:
        if look in self._doubted:
            return judge_doubted(spans, look, self._resets)
        self._resets.stated = self._stated(look)
        judged = judge(spans, look, self._resets, self.ratios)
        if self._resets.other == look:
            odd = (
                one.before.look
                for one in spans
                if math.isfinite(one.elapsed_h) and not is_ordinary(one)
            )
            since = max(odd, default=look - 1)
            if since < look - 1:
                self.late.update(range(since + 1, look + 1))
        return judged

    def _replaced(self, look: int, spans: Sequence[Span]) -> str | None:
        before, now = self.history.looks[look - 1], self.history.looks[look]
        stated = any(self.history.stated(REPLACED, look - 1, look))
        return replaced(before.identity, now.identity, spans, stated)

    def _start_new_station(self) -> None:
        self.traces.earlier += self.traces.now.values()
        self._of_other, self._last = self._last, {}
        self.traces.now, self._rolled, self._resets = {}, {}, Resets()

    def _stated(self, look: int) -> dict[int, float]:
        """Return the hours from the look before to the last recorded reset, by port."""
        if not look:
            return {}
        begin = self.history.times[look - 1]
        stated: dict[int, float] = {}
        # the last of several: everything before it is lost
        for fact in self.history.stated(RESET, look - 1, look):
            port = fact.port or 0
            stated[port] = max(stated.get(port, 0.0), (seconds(fact.time) - begin) / 3600)
        return stated

    # -- spans -------------------------------------------------------------------------------------

    def _maker(self, key: Key) -> MakeSpan:
        return lambda before, after: self._span(key, before, after)

    def _span_of(self, key: Key, last: Mapping[Key, Reading], now: Mapping[Key, Reading]) -> Span:
        """Return the span of a counter, with the time bounded by its hour counters."""
        look, elapsed_h = (
            last[key].look,
            self.history.elapsed.at_most_h(last[key].look, now[key].look),
        )
        lasted = lasted_h(self._counters[key].hours, self._believed(look), now, look, elapsed_h)
        return self._span(key, last[key], now[key], lasted)

    def _believed(self, look: int) -> Mapping[Key, Reading]:
        """Return the readings of a look without the ignored ones."""
        readings = self._by_look[look]
        return (
            {key: one for key, one in readings.items() if look not in self._left_out[key]}
            if look in self._odd
            else readings
        )

    def _span(self, key: Key, before: Reading, after: Reading, lasted: float = math.inf) -> Span:
        counter, elapsed = (
            self._counters[key],
            self.history.elapsed.at_most_h(before.look, after.look),
        )
        lasted = min(lasted, elapsed * DRIFT)
        most = lasted if counter.is_time else lasted * counter.fastest
        usual = most if counter.pace is None else min(most, counter.pace * max(lasted, LEAST_HOURS))
        grown = Interval(after.shown.low - before.shown.high, after.shown.high - before.shown.low)
        return Span(
            *key, counter.trait, counter.modulus, before, after, elapsed, most, usual, grown
        )

    # -- traces ------------------------------------------------------------------------------------

    def _keep(self, one: Judged) -> None:
        key, span = (one.span.port, one.span.counter), one.span
        trace = self.traces.now[key]
        if one.join is Join.ON:
            self._rolled[key] = self._rolled.get(key, 0.0) + one.roll_overs * span.modulus
        else:
            self._rolled[key] = 0.0
        by = self._rolled[key]
        shown = Interval(span.after.shown.low + by, span.after.shown.high + by)
        trace.points.append(
            Point(
                span.after.look, self.history.looks[span.after.look].time, shown, one.join, one.lost
            )
        )
        trace.differences.append(self._difference(one))
        self._last[key] = span.after

    def _note(self, key: Key, reading: Reading, rule: str | None) -> None:
        """Add the first reading of a counter, or an ignored one."""
        time = self.history.looks[reading.look].time
        if reading.look in self._left_out[key]:
            self._leave_out(key, reading)
        elif key not in self.traces.now:
            trace = Trace(*key, trait_of(key[1]).step, [Point(reading.look, time, reading.shown)])
            if rule is not None and key in self._of_other:
                span = self._span(key, self._of_other[key], reading)
                trace.aside.append(self._difference(Judged(span, DifferenceKind.REPLACED, rule)))
            self.traces.now[key], self._last[key] = trace, reading

    def _leave_out(self, key: Key, reading: Reading) -> None:
        if key in self.traces.now:
            span = self._span(key, self._last[key], reading)
            self.traces.now[key].aside.append(
                self._difference(
                    Judged(span, DifferenceKind.SUSPECT, "left_out", Join.LOOSE, is_known=False)
                )
            )

    def _difference(self, one: Judged) -> Difference:
        span, looks = one.span, self.history.looks
        return Difference(
            port=span.port,
            counter=span.counter,
            begin=looks[span.before.look].time,
            end=looks[span.after.look].time,
            before=span.before.shown.low,
            after=span.after.shown.low,
            kind=one.kind,
            rule=one.rule,
            text=RULES[one.rule],
            delta=NOTHING if one.kind is DifferenceKind.REPLACED else one.delta,
            is_known=one.is_known,
        )
