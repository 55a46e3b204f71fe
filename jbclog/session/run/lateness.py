"""How late ticks are, and whether the computer or the station caused it."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import Final, NamedTuple

from jbclog.core.io_requests import Ask, IoResult, Listen, Request, Steps, T, Wait, relay
from jbclog.core.text import count_text

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

    def watch(self, steps: Steps[T], now: float) -> Steps[T]:
        """Run `steps` from `now` on, and measure how late their requests return."""
        self.due = max(self.due, now)
        return relay(steps, self._watched)

    def _watched(self, request: Request) -> Steps[IoResult]:
        try:
            heard = yield request
        except Exception:
            self.fail(request)
            raise
        self.note(request, heard)
        return heard

    def fail(self, request: Request) -> None:
        """Handle a failed `request`: without a time its delay does not count as the host's."""
        self.due = _latest(request, self.due)

    def note(self, request: Request, heard: IoResult) -> None:
        """Register how late `request` returned. An answer in time only sets `due`, which a caller
        may do as well.
        """
        self._note(min(_latest(request, self.due), _held_up(request, heard)), heard.now)
        self.due = heard.now

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
    match request:
        case Ask():
            return now + request.patience_s
        case Listen() | Wait():
            return max(now, request.until)
        case _:
            return inf


def _held_up(request: Request, heard: IoResult) -> float:
    """Return since when an answer may have been waiting for the driver; for other requests only
    their end matters.
    """
    return heard.now - heard.late_s if isinstance(request, Ask | Listen) and heard.data else inf
