"""Time limits for the steps that make the tools of one station safe.

A station has a few seconds for its feeder and all its tools, and any answer may be lost. The client
waits four times as long as the slowest recent answer took: two lost answers could take all of the
time, and the last tools would get no order. So each step has its own end (`in_time`): its share of
the remaining time, or the usual time for its answers, whichever is shorter.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from jbclog.core.errors import AnswerTimeout
from jbclog.core.io_requests import Ask, IoResult, Listen, Request, Steps, T, Wait, do, relay
from jbclog.protocol.client.interface import Client

FIRST_S = 0.2  # patience for an answer in the first round, at least,
PATIENCE = 4  # or this many times the quickest answer's time
LEAST_SHARE_S = 0.3  # to ask again after a lost answer; most tools need a tenth of it
# time reserved for one order with its read-back, at most; the fastest so far, once known
ORDER_S = 0.25
ORDER_PER_LOOK = 1.5  # duration of an order and two answers, relative to two answers
MARGIN_S = 0.5  # additional time for lost frames


@dataclass(slots=True)
class TimeBudget:
    """Time for all rounds of one station, and how fast it answers. Moments are monotonic seconds.

    `end`: of the last round. `rounds`: number completed. `answer_s`: time of the quickest answer so
    far. `order_s`: reserved for one order with its read-back.
    """

    client: Client
    end: float = 0.0
    rounds: int = 0
    answer_s: float = inf
    order_s: float = ORDER_S

    @property
    def left_s(self) -> float:
        return self.end - self.client.now

    def note_answer(self) -> None:
        """Register how long the answer to the last request took, if there was one."""
        client = self.client
        if client.heard > client.sent:
            self.answer_s = min(self.answer_s, client.heard - client.sent)

    def note_look(self, begun: float) -> None:
        """Register that two answers have given a tool's state since `begun`."""
        self.order_s = min(self.order_s, ORDER_PER_LOOK * (self.client.now - begun))

    def share_ends(self, end: float, parts: int, answers: int) -> float:
        """Return until when to wait: for one of `parts` equal parts of the time until `end`, but no
        longer than `answers` answers usually take.

        Each round is twice as patient: a station that is slow now may have answered quickly before.
        """
        patience_s = max(FIRST_S, PATIENCE * self.answer_s) * float(1 << self.rounds)
        now = self.client.now
        share_s = max((end - now) / parts, LEAST_SHARE_S)
        return min(now + min(share_s, answers * patience_s), end)

    def latest(self, orders: int) -> float:
        """Return the latest time to begin `orders` orders, with read-back."""
        return self.end - MARGIN_S - orders * self.order_s if orders else self.end


def in_time(steps: Steps[T], now: float, end: float) -> Steps[T]:
    """Run `steps`, which begin at `now`, until `end` (monotonic seconds).

    A later request is not sent; its sender gets a time-out.
    """

    async def done_by_then(request: Request) -> IoResult:
        nonlocal now
        if now >= end and isinstance(request, Ask):
            raise AnswerTimeout("no time is left to ask")
        heard = await do(_cut(request, now, end))
        now = heard.now
        return heard

    return relay(steps, done_by_then)


def _cut(request: Request, now: float, end: float) -> Request:
    if isinstance(request, Ask):
        return Ask(request.data, min(request.patience_s, end - now))
    if isinstance(request, Listen | Wait):
        return type(request)(min(request.until, end))
    return request
