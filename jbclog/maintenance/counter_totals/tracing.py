"""Traces every counter through a station's history.

A history with possible roll-overs is traced twice: the first pass learns how fast the counters
usually advance. So is one with a break that a later look shows: the looks since the last reading
before it are doubted, too.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from jbclog.config.task_names import REPLACED
from jbclog.maintenance.counter_totals.history import History, Key
from jbclog.maintenance.counter_totals.judging import (
    BREAKS,
    RULES,
    UNSURE,
    Doubts,
    Judged,
    beside,
    judge,
)
from jbclog.maintenance.counter_totals.observed import (
    DRIFT,
    FIVE_DIGITS,
    HOURS,
    Identity,
    Trait,
    modulus_of,
    trait_of,
)
from jbclog.maintenance.counter_totals.span import (
    LEAST_HOURS,
    NOTHING,
    Interval,
    Reading,
    Span,
    top_of,
)
from jbclog.maintenance.counter_totals.totals import (
    CONTINUED,
    Difference,
    DifferenceKind,
    Join,
    Point,
    Trace,
)

MARGIN = 10.0  # factor by which other work may advance a counter faster than ever seen
LEAST_SEEN = 6  # fewer may all be from quiet weeks
LAST_HOUR = top_of(FIVE_DIGITS, HOURS)

Readings = Mapping[Key, Reading]


@dataclass
class Traces:
    """The counters of the current station."""

    history: History
    now: dict[Key, Trace] = field(default_factory=dict)


def traces_of(history: History) -> Traces:
    """Return the trace of every counter."""
    readings = history.readings()
    first = _Pass(history, readings)
    first.run()
    if not first.is_unsure and not first.late:
        return first.traces
    paces = first.paces() if first.is_unsure else {}
    late = first.late
    del first  # of a long ledger each pass takes hundreds of megabytes
    second = _Pass(history, readings, paces, late)
    second.run()
    return second.traces


@dataclass(slots=True)
class _Counter:
    """Constants of a counter, and what was seen of its rate. `pace`: the greatest usual advance per
    hour of its hour counter; None if too little was seen.
    """

    key: Key
    trait: Trait
    modulus: float
    pace: float | None
    seen: int = 0
    fastest: float = 0.0

    def possible(self, lasted_h: float) -> tuple[float, float]:
        """Return the greatest advance in that time at a plausible rate, and at its usual one."""
        most = lasted_h if self.trait.is_time else lasted_h * self.trait.fastest
        if self.pace is None:
            return most, most
        return most, min(most, self.pace * max(lasted_h, LEAST_HOURS))

    def learn(self, judged: Judged) -> None:
        """Note the rate of a known advance."""
        hours = judged.span.most / self.trait.fastest
        if judged.is_known and not self.trait.is_time and hours >= LEAST_HOURS:
            self.seen += 1
            self.fastest = max(self.fastest, judged.delta.high / hours)


class _Pass:
    """One pass through a history, with the `paces` of an earlier pass. `doubted`: looks before
    which the record may be broken, as later looks showed; `late`: those that this pass finds.
    """

    def __init__(
        self,
        history: History,
        readings: Mapping[Key, Sequence[Reading]],
        paces: Mapping[Key, float] | None = None,
        doubted: Collection[int] = (),
    ) -> None:
        self.history = history
        self.traces = Traces(history)
        self.is_unsure = False
        self.late: set[int] = set()
        self._doubted = frozenset(doubted)
        self._doubts = Doubts()
        self._counters = {
            key: _Counter(
                key,
                trait_of(key[1]),
                modulus_of(key[1], (reading.shown.high for reading in found)),
                (paces or {}).get(key),
            )
            for key, found in readings.items()
        }
        self._by_look: list[dict[Key, Reading]] = [{} for _ in history.looks]
        for key, found in readings.items():
            for reading in found:
                self._by_look[reading.look][key] = reading
        self._last: dict[Key, Reading] = {}
        self._of_other: dict[Key, Reading] = {}
        self._rolled: dict[Key, float] = {}  # added to a reading for its roll-overs

    def paces(self) -> dict[Key, float]:
        """Return the greatest advance of each counter per hour of its hour counter, with a
        margin.
        """
        return {
            key: MARGIN * counter.fastest
            for key, counter in self._counters.items()
            if counter.seen >= LEAST_SEEN
        }

    def run(self) -> None:
        """Trace all looks."""
        for look, readings in enumerate(self._by_look):
            rule = self._replaced(look) if look else None
            if rule is not None:
                self._start_new_station()
            spans = [self._span(key, now) for key, now in readings.items() if key in self._last]
            for judged in self._judged(spans, look):
                self._keep(judged)
            for key, reading in readings.items():
                if key not in self.traces.now:
                    self._begin(key, reading, rule)

    def _replaced(self, look: int) -> str | None:
        """Return the rule by which the station was replaced; None for the same station."""
        if self.history.stated_h(REPLACED, look - 1, look):
            return "stated_replaced"
        before, now = self.history.looks[look - 1].identity, self.history.looks[look].identity
        if before is None or now is None:
            return None
        return _other(before, now)

    def _start_new_station(self) -> None:
        self._of_other, self._last = self._last, {}
        self.traces.now, self._rolled, self._doubts = {}, {}, Doubts()

    def _judged(self, spans: Sequence[Span], look: int) -> list[Judged]:
        if look in self._doubted:
            return [beside(span) for span in spans]
        judged = judge(spans, look, self._doubts, self.history)
        if self._doubts.broken == look:
            since = max(one.span.before.look for one in judged if one.rule in BREAKS)
            self.late.update(range(since + 1, look))
        return judged

    # -- spans -------------------------------------------------------------------------------------

    def _span(self, key: Key, after: Reading) -> Span:
        """Return the span from the last reading of a counter, with the time bounded by its hour
        counters.
        """
        counter, before = self._counters[key], self._last[key]
        elapsed_h = self.history.elapsed.at_most_h(before.look, after.look)
        most, usual = counter.possible(self._lasted_h(counter, before, after, elapsed_h))
        grown = Interval(after.shown.low - before.shown.high, after.shown.high - before.shown.low)
        return Span(
            *key, counter.trait, counter.modulus, before, after, elapsed_h, most, usual, grown
        )

    def _lasted_h(
        self, counter: _Counter, before: Reading, after: Reading, elapsed_h: float
    ) -> float:
        """Return how long a counter of events can have counted: by its first hour counter, or by
        the elapsed time.

        An hour counter at its last number may have stopped, and is not used.
        """
        then, now = self._by_look[before.look], self._by_look[after.look]
        for name in counter.trait.hours:
            first, last = then.get((counter.key[0], name)), now.get((counter.key[0], name))
            if first and last and first.shown.low <= last.shown.high < LAST_HOUR:
                return min(elapsed_h * DRIFT, last.shown.high - first.shown.low + 1.0)
        return elapsed_h * DRIFT

    # -- traces ------------------------------------------------------------------------------------

    def _keep(self, judged: Judged) -> None:
        span = judged.span
        key, trace = span.key, self.traces.now[span.key]
        self._counters[key].learn(judged)
        self.is_unsure |= judged.rule in UNSURE
        rolled = self._rolled.get(key, 0.0) if judged.join is Join.ON else 0.0
        rolled += judged.roll_overs * span.modulus
        self._rolled[key] = rolled
        shown = span.after.shown
        if rolled:
            shown = Interval(shown.low + rolled, shown.high + rolled)
        time = self.history.looks[span.after.look].time
        trace.points.append(Point(span.after.look, time, shown, judged.join, judged.lost))
        # without roll-overs, the points show what was read
        is_plain = judged.rule in CONTINUED and not rolled
        trace.kept.append(None if is_plain else self._difference(judged))
        self._last[key] = span.after

    def _begin(self, key: Key, reading: Reading, rule: str | None) -> None:
        """Begin the trace of a counter with its first reading."""
        time = self.history.looks[reading.look].time
        trace = Trace(*key, trait_of(key[1]).step, [Point(reading.look, time, reading.shown)])
        if rule is not None and key in self._of_other:
            self._last[key] = self._of_other[key]
            replaced = Judged(self._span(key, reading), DifferenceKind.REPLACED, rule)
            trace.aside.append(self._difference(replaced))
        self.traces.now[key], self._last[key] = trace, reading

    def _difference(self, judged: Judged) -> Difference:
        span, looks = judged.span, self.history.looks
        return Difference(
            port=span.port,
            counter=span.counter,
            start=looks[span.before.look].time,
            stop=looks[span.after.look].time,
            before=span.before.shown.low,
            after=span.after.shown.low,
            kind=judged.kind,
            rule=judged.rule,
            text=RULES[judged.rule],
            delta=NOTHING if judged.kind is DifferenceKind.REPLACED else judged.delta,
            is_known=judged.is_known,
        )


def _other(before: Identity, now: Identity) -> str | None:
    """Return the rule by which another station answers under this name."""
    for rule, was, is_now in (
        ("other_model", before.model, now.model),
        ("other_uid", before.uid, now.uid),
    ):
        if was is not None and is_now is not None and was != is_now:
            return rule
    return None
