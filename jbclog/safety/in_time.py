"""Steps that must be over by a moment: what they wait for is cut off there, and nothing is asked behind it."""

from __future__ import annotations

from typing import TypeVar

from jbclog.effects import Ask, Listen, Steps, Wait, Wish
from jbclog.errors import AnswerTimeout

T = TypeVar("T")


def in_time(steps: Steps[T], now: float, end: float) -> Steps[T]:
    """Pull `steps`, which begin at `now` and are over at `end` (monotonic seconds) but for what they still make of it.

    A question that would leave later is not sent; to who asks it was not answered.
    """
    try:
        wish = next(steps)
        while True:
            try:
                if now >= end and isinstance(wish, Ask):
                    raise AnswerTimeout("no time is left to ask")
                heard = yield _cut(wish, now, end)
            except Exception as error:  # whatever a driver throws is for the steps
                wish = steps.throw(error)
            else:
                now = heard.now
                wish = steps.send(heard)
    except StopIteration as done:
        value: T = done.value
        return value
    finally:
        steps.close()


def _cut(wish: Wish, now: float, end: float) -> Wish:
    if isinstance(wish, Ask):
        return Ask(wish.data, min(wish.patience_s, end - now))
    if isinstance(wish, Listen | Wait):
        return type(wish)(min(wish.until, end))
    return wish
