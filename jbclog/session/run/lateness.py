"""How late ticks are, and whether the computer or the station caused it."""

from __future__ import annotations

import types
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from jbclog.core.io_requests import Ask, IoResult, Listen, Request, Steps, T, Wait
from jbclog.core.rows import Severity, StationFacts
from jbclog.core.text import count_text
from jbclog.session.run.log import SessionLog
from jbclog.session.scheduler import Grid

# Skipped ticks are reported in groups, so that a busy hour does not become thousands of events:
# after `QUIET_S` without one, and every `LONGEST_S` during a long series.

KIND: Final = "host.busy"
SLOW_KIND: Final = "station.slow"
QUIET_S: Final = 10.0
LONGEST_S: Final = 300.0


@dataclass(slots=True)
class SkippedTicks:
    """Skipped ticks not reported yet. Times are monotonic seconds; `since` is when the first tick
    was due.
    """

    ticks: int = 0
    places: int = 0
    late_s: float = 0.0
    since: float = 0.0
    last: float = 0.0

    def add(self, ticks: int, due: float, late_s: float, now: float) -> None:
        """Count `ticks` skipped from the one due at `due` on, which was `late_s` late at `now`."""
        if not self.ticks:
            self.since = due
        self.ticks += ticks
        self.places += 1
        self.late_s = max(self.late_s, late_s)
        self.last = now

    def is_due(self, now: float) -> bool:
        return self.ticks > 0 and (now - self.last >= QUIET_S or now - self.since >= LONGEST_S)

    def text(self, period_s: float) -> str:
        why = "the computer was busy, or something paused the recorder"
        return (
            f"The recorder was late ({why}): {self._what(period_s)}. Less load on the computer"
            " helps."
        )

    def text_of_station(self, period_s: float) -> str:
        return (
            f"The station answered slowly or not at all: {self._what(period_s)}. A lower rate"
            " leaves more time."
        )

    def _what(self, period_s: float) -> str:
        skipped = f"{sampling_times(self.ticks)} {'was' if self.ticks == 1 else 'were'} skipped"
        places = "" if self.places == 1 else f" in {self.places} places"
        return (
            f"{skipped}{places} (one is due every {period_s:g} s), up to {self.late_s:.2f} s late"
        )


def sampling_times(ticks: int) -> str:
    """Format a number of ticks for messages."""
    return count_text(ticks, "sampling time")


# A hanging station makes a tick late, and so does a suspended host, which is an event of its own
# (docs/reference/tables.md). The request distinguishes them: it states its latest end.

# A stopped process and a busy or suspended computer are not always distinguishable, so the texts
# name both.
WHY_STILL: Final = "the computer was suspended or stood still, or something stopped the recorder"
SUSPENDED_S = 5.0  # a longer standstill of the host is an event, and its ticks have no rows


UNTIL: Final = (Listen, Wait)


class LateSpan(NamedTuple):
    """The interval from the latest time at which a request should have returned to when it did, in
    monotonic seconds.
    """

    begin: float
    end: float


@dataclass(slots=True)
class Standstill:
    """Standstills of the host since `spans` was last cleared, and the total time by which requests
    returned late.

    Waiting is no standstill: that begins when the pending request should have ended.
    """

    spans: list[LateSpan] = field(default_factory=list)
    late_s: float = 0.0
    due: float = -inf  # until then the host was running, or had nothing to do

    @types.coroutine
    def watch(self, steps: Steps[T], now: float) -> Generator[Request, IoResult, T]:
        """Run `steps` from `now` on, and measure how late their requests return."""
        self.due = max(self.due, now)
        try:
            request = steps.send(None)
            while True:
                try:
                    heard = yield request
                except Exception as error:
                    self.fail(request)
                    request = steps.throw(error)
                else:
                    self.note(request, heard)
                    request = steps.send(heard)
        except StopIteration as end:
            result: T = end.value
            return result
        finally:
            steps.close()

    def fail(self, request: Request) -> None:
        """Handle a failed `request`: without a time its delay does not count as the host's."""
        self.due = _latest(request, self.due)

    def note(self, request: Request, heard: IoResult) -> None:
        """Register how late `request` returned."""
        now, data, _, late_s = heard
        latest = _latest(request, self.due)
        if late_s and data and isinstance(request, Ask | Listen):
            latest = min(latest, now - late_s)  # since then it may have been waiting
        if now > latest:
            self._note(latest, now)
        self.due = now

    def wait_over(self, wait: Wait, now: float) -> None:
        """Register that `wait` returned at `now`."""
        self._note(max(self.due, wait.until), now)
        self.due = now

    def _note(self, begin: float, end: float) -> None:
        """Register that a request that should have ended at `begin` ended at `end`."""
        if end > begin:
            self.late_s += end - begin
            if end - begin > SUSPENDED_S:
                self.spans.append(LateSpan(begin, end))

    def covers(self, moment: float) -> bool:
        """Return True if `moment` is within a standstill."""
        return any(span.begin < moment <= span.end for span in self.spans)


def _latest(request: Request, now: float) -> float:
    """Return the time by which `request` should have returned. Reopening a port, and `Gather`, have
    no limit.
    """
    if isinstance(request, Ask):
        return now + request.patience_s
    if isinstance(request, UNTIL):
        return max(now, request.until)
    return inf


class SkippedTickReport:
    """Ticks of one station without readings: accounted for by cause, and reported."""

    def __init__(self, facts: StationFacts, log: SessionLog) -> None:
        self._facts = facts
        self._log = log
        self._by_host = SkippedTicks()
        self._by_station = SkippedTicks()
        facts.skipped_by_host = facts.skipped_by_host or 0

    def add(self, grid: Grid, late: Sequence[int], by_host: int, host_s: float) -> None:
        """Count `late` ticks, the last `by_host` of them as the computer's, each group with its
        part of the delay; at most `host_s` of it is the computer's.
        """
        if not late:
            return
        now, first = self._log.now, grid.due(late[0])
        host_s = min(host_s, now - first)
        if by_host:
            self._facts.skipped_by_host = (self._facts.skipped_by_host or 0) + by_host
            self._by_host.add(by_host, grid.due(late[-by_host]), host_s, now)
        if len(late) > by_host:
            self._by_station.add(len(late) - by_host, first, now - first - host_s, now)

    def leave_out(self, grid: Grid, ticks: Sequence[int], spans: Sequence[LateSpan]) -> None:
        """Account for the ticks of each standstill, which have no rows, by an event."""
        self._facts.skipped += len(ticks)
        for begin, end in spans:
            count = sum(begin < grid.due(tick) <= end for tick in ticks)
            text = (
                f"The recorder stood still for {end - begin:.1f} s ({WHY_STILL});"
                f" {sampling_times(count)} {'has' if count == 1 else 'have'} no rows."
            )
            if count:
                self._log.note(
                    "host.suspended", Severity.ERROR, text, since=begin, value=end - begin
                )

    def report(self, period_s: float, *, is_over: bool = False) -> None:
        """Report the ticks skipped by the computer and by the station, after a pause in each
        series, or at the end.
        """
        busy, slow = self._by_host, self._by_station
        if not busy.ticks and not slow.ticks:
            return
        if busy.is_due(self._log.now) or (is_over and busy.ticks):
            self._by_host = SkippedTicks()
            self._note(KIND, busy, busy.text(period_s))
        if slow.is_due(self._log.now) or (is_over and slow.ticks):
            self._by_station = SkippedTicks()
            self._note(SLOW_KIND, slow, slow.text_of_station(period_s))

    def _note(self, kind: str, late: SkippedTicks, text: str) -> None:
        raw = f"late_s={late.late_s:.3f}"
        self._log.note(kind, Severity.WARNING, text, since=late.since, value=late.ticks, raw=raw)
