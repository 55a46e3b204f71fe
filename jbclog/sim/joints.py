"""The schedule of solder joints: when each begins, how long it takes, how much heat it draws.

Joints follow each other evenly, scattered a little by the seed; the n-th joint is the same whenever it is
asked for, so that a run can be repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf
from random import Random

LOAD_W_PER_K = 0.35
LOAD_C = 150.0  # solder and pad while they are being heated
MOST_OF_PERIOD = 0.6  # a joint never lasts longer than this share of the time between two


@dataclass(frozen=True, slots=True)
class Joint:
    """One joint: its begin and end in seconds, and the heat it draws in W/K."""

    start: float
    end: float
    load_w_per_k: float


NEVER = Joint(inf, inf, 0.0)


class Joints:
    """The joints of one tool from `origin` on."""

    __slots__ = ("_origin", "_period", "_seconds", "_seed")

    def __init__(self, per_minute: float, seconds: float, seed: int, origin: float = 0.0) -> None:
        self._period = 60.0 / per_minute if per_minute > 0 else inf
        self._seconds = min(seconds, MOST_OF_PERIOD * self._period)
        self._seed = seed
        self._origin = origin

    def after(self, moment: float) -> Joint:
        """The first joint that begins after `moment`."""
        if self._period == inf:
            return NEVER
        number = max(ceil((moment - self._origin) / self._period) - 1, 0)
        while (joint := self._joint(number)).start <= moment:
            number += 1
        return joint

    def _joint(self, number: int) -> Joint:
        scatter = Random(self._seed * 1_000_003 + number)
        start = self._origin + (number + 0.4 + 0.2 * scatter.random()) * self._period
        return Joint(start, start + self._seconds * (0.85 + 0.15 * scatter.random()), LOAD_W_PER_K * (0.8 + 0.4 * scatter.random()))
