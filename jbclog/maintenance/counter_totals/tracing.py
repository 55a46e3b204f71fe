"""Traces every counter through a station's history.

A history with doubtful roll-overs is traced twice: the first pass learns the counters' rates and
ratios from known differences.
"""

from __future__ import annotations

import math
from collections import Counter as Counted
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

from jbclog.config.task_names import REPLACED, RESET
from jbclog.maintenance.counter_totals.advance import (
    OPEN,
    MakeSpan,
    Ratios,
    counted_on,
    misread,
    ratios_of,
)
from jbclog.maintenance.counter_totals.fast_path import Counter, is_plain, lasted_h
from jbclog.maintenance.counter_totals.history import History, Key
from jbclog.maintenance.counter_totals.judgement import RULES, Judged
from jbclog.maintenance.counter_totals.judging import (
    Resets,
    is_ordinary,
    judge,
    judge_doubted,
    replaced,
)
from jbclog.maintenance.counter_totals.observed import DRIFT, modulus_of, trait_of
from jbclog.maintenance.counter_totals.span import (
    LEAST_HOURS,
    NOTHING,
    Interval,
    Reading,
    Span,
    seconds,
)
from jbclog.maintenance.counter_totals.totals import (
    Difference,
    DifferenceKind,
    Join,
    Point,
    Trace,
    continued,
)

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
    readings = history.readings()
    first = _Pass(history, readings, {}, {})
    first.run()
    is_unsure = any(one.rule in UNSURE for judged in first.judged for one in judged)
    late = first.late
    if not is_unsure and not late:
        return first.traces
    paces, ratios = _learned(chain(first.judged, first.plain())) if is_unsure else ({}, {})
    del first  # of a long ledger each pass takes hundreds of megabytes
    second = _Pass(history, readings, paces, ratios, late)
    second.run()
    return second.traces


def _doubted_looks(left_out: Iterable[Collection[int]]) -> Iterator[int]:
    """Yield the looks that another unit answered once, because several counters are ignored, and
    the looks after them.
    """
    for look, counters in Counted(look for looks in left_out for look in looks).items():
        if counters > 1:
            yield from (look, look + 1)


def _learned(looks: Iterable[Sequence[Judged]]) -> tuple[dict[Key, float], Ratios]:
    """Return the greatest advance of each counter per hour of its hour counter, with a margin, and
    the ratios to companions. Takes each look once and keeps none.
    """
    seen: dict[Key, list[float]] = {}

    def noted() -> Iterator[Sequence[Judged]]:
        for judged in looks:
            for one in judged:
                hours = one.span.most / one.span.trait.fastest
                if one.is_known and not one.span.trait.is_time and hours >= LEAST_HOURS:
                    key = one.span.port, one.span.counter
                    seen.setdefault(key, []).append(one.delta.high / hours)
            yield judged

    ratios = ratios_of(noted())
    paces = {key: MARGIN * max(found) for key, found in seen.items() if len(found) >= LEAST_SEEN}
    return paces, ratios


class _Pass:
    """One pass through a history, with the `paces` and `ratios` of an earlier pass. `doubted`:
    looks before which the unit may have been exchanged, as later looks showed; `late`: those that
    this pass finds."""

    def __init__(
        self,
        history: History,
        readings: Mapping[Key, Sequence[Reading]],
        paces: Mapping[Key, float],
        ratios: Ratios,
        doubted: Collection[int] = (),
    ) -> None:
        self.history, self.readings = history, readings
        self.paces, self.ratios = paces, ratios
        self.traces = Traces(history)
        self.judged: list[list[Judged]] = []
        self._counters = {key: self._counter(key, found) for key, found in readings.items()}
        self._left_out = {key: misread(found, self._maker(key)) for key, found in readings.items()}
        self._doubted = {*doubted, *_doubted_looks(self._left_out.values())}
        self.late: set[int] = set()
        self._odd = self._doubted.union(*self._left_out.values())
        self._by_look: list[dict[Key, Reading]] = [{} for _ in history.looks]
        self._plain: list[int] = []
        self._last: dict[Key, Reading] = {}
        self._of_other: dict[Key, Reading] = {}
        self._resets = Resets()
        self._rolled: dict[Key, float] = {}  # added to a reading for its roll-overs

    def _counter(self, key: Key, found: Sequence[Reading]) -> Counter:
        return Counter(
            key,
            trait_of(key[1]),
            modulus_of(key[1], (one.shown.high for one in found)),
            self.paces.get(key),
        )

    def run(self) -> None:
        """Trace all looks."""
        for key, found in self.readings.items():
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
            before = self._last[key].shown
            # without roll-overs, the points show what was read
            trace.kept.append(
                continued(*key, trace.step, before, one.shown, begin, end) if by else None
            )
            trace.points.append(Point(look, end, shown))
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
        look = last[key].look
        elapsed_h = self.history.elapsed.at_most_h(look, now[key].look)
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
        counter = self._counters[key]
        elapsed = self.history.elapsed.at_most_h(before.look, after.look)
        most, usual = counter.possible(min(lasted, elapsed * DRIFT))
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
        trace.kept.append(self._difference(one))
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
