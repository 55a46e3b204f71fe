"""Whether the host stood still: time that passed although nothing was asked and nothing waited for.

A station that babbles or hangs makes a tick late, and so does a host that was suspended; only the second is an event of
its own (docs/reference/tables.md). What tells them apart is the wish: it says until when it may last.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from jbclog.core.io_requests import Ask, Heard, Listen, Request, Steps, T, Wait, relay

SUSPENDED_S = 5.0  # a standstill of the host that is an event; its ticks have no rows. A busy host may be late by less


class Span(NamedTuple):
    """From the moment by which a wish ought to have come back to the one at which it did, monotonic seconds."""

    begin: float
    end: float

    @property
    def seconds(self) -> float:
        return self.end - self.begin


@dataclass(slots=True)
class Standstill:
    """When the host stood still, since `spans` was last emptied, and by how much all wishes together came back too late.

    What is waited for is no standstill, whoever waits and however long: it begins where the wish that is out should have ended.
    """

    spans: list[Span] = field(default_factory=list)
    late_s: float = 0.0
    _due: float = -inf  # the last moment at which it is known that the host went on, or need not have

    def watch(self, steps: Steps[T], now: float) -> Steps[T]:
        """Do `steps` as they are, from `now` on, and note by how much their wishes came back too late."""
        self._due = max(self._due, now)

        def timed(wish: Request) -> Steps[Heard]:
            try:
                heard = yield wish
            except Exception:  # nobody says when: what it may have taken is not the host's
                self._due = _latest(wish, self._due)
                raise
            self._note(Span(min(_latest(wish, self._due), _held_up(wish, heard)), heard.now))
            self._due = heard.now
            return heard

        return relay(steps, timed)

    def _note(self, late: Span) -> None:
        self.late_s += max(late.seconds, 0.0)
        if late.seconds > SUSPENDED_S:
            self.spans.append(late)

    def covers(self, moment: float) -> bool:
        """Whether the host stood still at `moment`."""
        return any(span.begin < moment <= span.end for span in self.spans)


def _latest(wish: Request, now: float) -> float:
    """The moment by which `wish` ought to have come back. Nobody can say how long opening a port may take, or the others."""
    match wish:
        case Ask():
            return now + wish.patience_s
        case Listen() | Wait():
            return max(now, wish.until)
        case _:
            return inf


def _held_up(wish: Request, heard: Heard) -> float:
    """Since when an answer may have been there, unheard. In any other wish the driver being late matters at its end only."""
    return heard.now - heard.late_s if isinstance(wish, Ask | Listen) and heard.data else inf
