"""What the counter of plugged hours can be after some time: the one thing that tells two stations
of one model and software apart (docs/reference/faults.md, F-17).
"""

from __future__ import annotations

from typing import Final

RESOLUTION_H: Final = 1  # the counters count whole hours
DRIFT: Final = 0.01  # maximum drift between the station's clock and ours
ROLLS_OVER_AT: Final = 100_000  # five digits


def can_be(hours: int, before: int, seconds: float) -> bool:
    """Return True if a counter can go from `before` to `hours` in that time: it never falls, and
    grows no faster than time.
    """
    return (hours - before) % ROLLS_OVER_AT <= seconds / 3600 * (1 + DRIFT) + RESOLUTION_H
