"""A link that repeats old answers."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from random import Random

from support.product import Peer

BEGUN_S = 5.0  # the start is over


class Repeating:
    """A cable that sends an old answer to the same question directly before the true one, for a
    share of the questions.
    """

    def __init__(self, cable: Peer, share: float, seed: int, gap_s: float, *, torn: bool) -> None:
        self._cable = cable
        self._share = share
        self._gap_s = gap_s
        self._torn = torn
        self._random = Random(seed)
        self._old: defaultdict[bytes, list[bytes]] = defaultdict(list)
        self._began: float | None = None
        self._free = 0.0
        self.repeated = 0

    def receive(self, data: bytes, now: float) -> Sequence[tuple[float, bytes]]:
        self._began = now if self._began is None else self._began
        replies = [(max(at, self._free), answer) for at, answer in self._cable.receive(data, now)]
        if not replies:
            return replies
        at, answer = replies[0][0], replies[0][1]
        old = self._old[data]
        earlier = [one for one in old if one != answer]
        old.append(answer)
        is_due = now - self._began > BEGUN_S and self._random.random() < self._share
        if not is_due or not earlier:
            return replies
        self.repeated += 1
        before = self._random.choice(earlier[-20:])
        if self._torn:
            cut = self._random.randrange(1, len(answer))
            self._free = at + self._gap_s
            return [(at, before + answer[:cut]), (self._free, answer[cut:])]
        self._free = at + self._gap_s
        return [(at, before), (self._free, answer)] if self._gap_s else [(at, before + answer)]

    def is_unplugged(self, now: float) -> bool:
        return self._cable.is_unplugged(now)
