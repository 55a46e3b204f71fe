"""From a station's history to a trace of every counter: look by look, judged, and summed.

Where roll-overs are in doubt it is gone through twice: how fast the counters go, and in what ratio, is learned from all that is
known at first sight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from jbclog.audit.companion import OPEN, Ratios, ratios_of
from jbclog.audit.elapsed import seconds
from jbclog.audit.history import History, Key
from jbclog.audit.interval import NOTHING, Interval
from jbclog.audit.judged import Judged
from jbclog.audit.judging import Resets, judge
from jbclog.audit.misread import MakeSpan, misread
from jbclog.audit.observed import REPLACED, RESET
from jbclog.audit.odometer import Difference, Join, Kind, Point, Trace
from jbclog.audit.replaced import replaced
from jbclog.audit.sentences import RULES
from jbclog.audit.span import Reading, Span
from jbclog.audit.traits import DRIFT, modulus_of, trait_of

MARGIN = 2.0  # by which a counter may go faster than it ever was seen to
LEAST_HOURS, LEAST_SEEN = 4.0, 3
UNSURE = frozenset({*OPEN, "rolled_over_or_reset"})


@dataclass
class Traces:
    """The counters of the station that is there now; `earlier` those of stations that were replaced."""

    history: History
    now: dict[Key, Trace] = field(default_factory=dict)
    earlier: list[Trace] = field(default_factory=list)


def traces_of(history: History) -> Traces:
    """Every counter's trace."""
    first = _Pass(history, {}, {})
    first.go()
    if not any(one.rule in UNSURE for judged in first.judged for one in judged):
        return first.traces
    second = _Pass(history, _paces(first.judged), ratios_of(first.judged))
    second.go()
    return second.traces


def _paces(looks: Sequence[Sequence[Judged]]) -> dict[Key, float]:
    """The fastest that each counter was seen to go, in an hour of what it goes with, with a margin."""
    seen: dict[Key, list[float]] = {}
    for one in (one for judged in looks for one in judged):
        hours = one.span.most / one.span.trait.fastest
        if one.is_known and not one.span.trait.is_time and hours >= LEAST_HOURS:
            seen.setdefault((one.span.port, one.span.counter), []).append(one.delta.high / hours)
    return {key: MARGIN * max(paces) for key, paces in seen.items() if len(paces) >= LEAST_SEEN}


class _Pass:
    """One way through a history. `paces` and `ratios` are what is known of the counters before."""

    def __init__(self, history: History, paces: Mapping[Key, float], ratios: Ratios) -> None:
        self.history, self.paces, self.ratios = history, paces, ratios
        self.traces = Traces(history)
        self.judged: list[list[Judged]] = []
        self._moduli = {key: modulus_of(key[1], (one.shown.high for one in found)) for key, found in history.readings.items()}
        self._left_out = {key: misread(found, self._maker(key)) for key, found in history.readings.items()}
        self._last: dict[Key, Reading] = {}
        self._of_other: dict[Key, Reading] = {}
        self._resets = Resets()
        self._turns: dict[Key, float] = {}

    def go(self) -> None:
        """All looks."""
        by_look: list[list[tuple[Key, Reading]]] = [[] for _ in self.history.looks]
        for key, found in self.history.readings.items():
            for reading in found:
                by_look[reading.look].append((key, reading))
        for look, readings in enumerate(by_look):
            self._look(look, readings)

    def _look(self, look: int, readings: list[tuple[Key, Reading]]) -> None:
        fitting = [(key, one) for key, one in readings if look not in self._left_out[key]]
        spans = self._spans(fitting)
        rule = self._replaced(look, spans) if look else None
        if rule is not None:
            self._begin_again()
        else:
            self._resets.stated = self._stated(look)
            judged = judge(spans, look, self._resets, self.ratios)
            self.judged.append(judged)
            for found in judged:
                self._keep(found)
        for key, one in readings:
            self._note(key, one, rule)

    def _replaced(self, look: int, spans: Sequence[Span]) -> str | None:
        before, now = self.history.looks[look - 1], self.history.looks[look]
        stated = any(self.history.told(REPLACED, look - 1, look))
        return replaced(before.identity, now.identity, spans, stated)

    def _begin_again(self) -> None:
        self.traces.earlier += self.traces.now.values()
        self._of_other, self._last = self._last, {}
        self.traces.now, self._turns, self._resets = {}, {}, Resets()

    def _stated(self, look: int) -> dict[int, float]:
        """Hours from the look before to a reset that somebody told, by port."""
        if not look:
            return {}
        begin = self.history.times[look - 1]
        return {fact.port or 0: (seconds(fact.time) - begin) / 3600 for fact in self.history.told(RESET, look - 1, look)}

    # -- spans --------------------------------------------------------------------------------------------------------------

    def _maker(self, key: Key) -> MakeSpan:
        return lambda before, after: self._span(key, before, after, None)

    def _spans(self, readings: list[tuple[Key, Reading]]) -> list[Span]:
        now = dict(readings)
        return [self._span(key, self._last[key], one, self._hours(key, now)) for key, one in readings if key in self._last]

    def _hours(self, key: Key, now: Mapping[Key, Reading]) -> float | None:
        """How long a counter of events can have counted, by the counter of time that it goes with; None where none tells."""
        for name in trait_of(key[1]).hours:
            before, after = self._last.get((key[0], name)), now.get((key[0], name))
            if before and after and before.look == self._last[key].look and after.shown.high >= before.shown.low:
                return after.shown.high - before.shown.low + 1.0
        return None

    def _span(self, key: Key, before: Reading, after: Reading, hours: float | None) -> Span:
        trait, elapsed = trait_of(key[1]), self.history.elapsed.at_most_h(before.look, after.look)
        lasted = elapsed * DRIFT if hours is None else min(elapsed * DRIFT, hours)
        most = elapsed * DRIFT if trait.is_time else lasted * trait.fastest
        usual = min(most, self.paces[key] * max(lasted, LEAST_HOURS)) if key in self.paces else most
        grown = Interval(after.shown.low - before.shown.high, after.shown.high - before.shown.low)
        return Span(*key, trait, self._moduli[key], before, after, elapsed, most, usual, grown)

    # -- what comes of it ---------------------------------------------------------------------------------------------------

    def _keep(self, one: Judged) -> None:
        key, span = (one.span.port, one.span.counter), one.span
        trace = self.traces.now[key]
        if one.join is Join.ON:
            self._turns[key] = self._turns.get(key, 0.0) + one.turns * span.modulus
        else:
            self._turns[key] = 0.0
        by = self._turns[key]
        shown = Interval(span.after.shown.low + by, span.after.shown.high + by)
        trace.points.append(Point(span.after.look, self.history.looks[span.after.look].time, shown, one.join, one.lost))
        trace.differences.append(self._difference(one))
        self._last[key] = span.after

    def _note(self, key: Key, reading: Reading, rule: str | None) -> None:
        """The first reading of a counter; or one that is left out."""
        time = self.history.looks[reading.look].time
        if reading.look in self._left_out[key]:
            self._leave_out(key, reading)
        elif key not in self.traces.now:
            trace = Trace(*key, trait_of(key[1]).step, [Point(reading.look, time, reading.shown)])
            if rule is not None and key in self._of_other:
                span = self._span(key, self._of_other[key], reading, None)
                trace.aside.append(self._difference(Judged(span, Kind.REPLACED, rule)))
            self.traces.now[key], self._last[key] = trace, reading

    def _leave_out(self, key: Key, reading: Reading) -> None:
        if key in self.traces.now:
            span = self._span(key, self._last[key], reading, None)
            self.traces.now[key].aside.append(self._difference(Judged(span, Kind.SUSPECT, "left_out", Join.LOOSE, is_known=False)))

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
            delta=NOTHING if one.kind is Kind.REPLACED else one.delta,
            is_known=one.is_known,
        )
