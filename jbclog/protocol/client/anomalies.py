"""What a station does otherwise than recommended, and is taken all the same: counted, and reported once.

docs/reference/contradictions.md has every form.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Anomaly:
    """The first of its kind. `number` is the B-number, `place` says where it was met, `raw` is what came."""

    number: int
    place: str
    raw: str
    port: int | None = None


class Anomalies:
    """All that one station was met with: `counts` by B-number, `untold` what nobody has been told of yet."""

    def __init__(self) -> None:
        self.counts: Counter[int] = Counter()
        self.untold: list[Anomaly] = []
        self._told: set[int] = set()

    def meet(self, number: int, place: str, raw: str, port: int | None = None, *, times: int = 1) -> None:
        """Count it `times` times, and put the first of its kind on the list of what is to be told."""
        self.counts[number] += times
        if number not in self._told:
            self._told.add(number)
            self.untold.append(Anomaly(number, place, raw, port))

    def take(self) -> list[Anomaly]:
        """What has not been told yet; it counts as told from now on."""
        untold, self.untold = self.untold, []
        return untold
