"""Whether the host stood still: time that passed although nothing was asked and nothing waited for.

A station that babbles or hangs makes a tick late, and so does a host that was suspended; only the second is an event of
its own (contract, "samples"). What tells them apart is the wish: it says until when it may last.
"""

from __future__ import annotations

from dataclasses import dataclass

from jbclog.effects import Ask, Heard, Listen, Steps, T, Wait, Wish, relay

NOTED_S = 1.0  # a host that is busy may be late by less than this without having stood still


@dataclass(slots=True)
class Standstill:
    """How long the host stood still since `seconds` was last set to zero; `late_s` has what is too short for that, too."""

    seconds: float = 0.0
    late_s: float = 0.0

    def watch(self, steps: Steps[T], now: float) -> Steps[T]:
        """Do `steps` as they are, from `now` on, and add up by how much their wishes came back too late."""

        def timed(wish: Wish) -> Steps[Heard]:
            nonlocal now
            heard = yield wish
            self._note(wish, heard, now)
            now = heard.now
            return heard

        return relay(steps, timed)

    def _note(self, wish: Wish, heard: Heard, now: float) -> None:
        late = heard.now - _latest(wish, now, heard)
        self.late_s += max(late, 0.0)
        if late > NOTED_S:
            self.seconds += late


def _latest(wish: Wish, now: float, heard: Heard) -> float:
    """The moment by which `wish` ought to have come back. Nobody can say how long opening a port may take."""
    match wish:
        case Ask():
            return now + wish.patience_s
        case Listen() | Wait():
            return max(now, wish.until)
        case _:
            return heard.now
