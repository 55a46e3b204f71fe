"""Steps that must be over by a moment: what they wait for is cut off there, and nothing is asked behind it."""

from __future__ import annotations

from jbclog.core.errors import AnswerTimeout
from jbclog.core.io_requests import Ask, Heard, Listen, Request, Steps, T, Wait, relay


def in_time(steps: Steps[T], now: float, end: float) -> Steps[T]:
    """Pull `steps`, which begin at `now` and are over at `end` (monotonic seconds) but for what they still make of it.

    A question that would leave later is not sent; to who asks it was not answered.
    """

    def done_by_then(wish: Request) -> Steps[Heard]:
        nonlocal now
        if now >= end and isinstance(wish, Ask):
            raise AnswerTimeout("no time is left to ask")
        heard = yield _cut(wish, now, end)
        now = heard.now
        return heard

    return relay(steps, done_by_then)


def _cut(wish: Request, now: float, end: float) -> Request:
    if isinstance(wish, Ask):
        return Ask(wish.data, min(wish.patience_s, end - now))
    if isinstance(wish, Listen | Wait):
        return type(wish)(min(wish.until, end))
    return wish
