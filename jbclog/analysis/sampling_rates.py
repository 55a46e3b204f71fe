"""How often stations were sampled, where runs are held against each other."""

from __future__ import annotations

from math import isclose
from typing import Final

WHAT_A_RATE_CHANGES: Final = (
    "what is found in the readings (joints, recovery, dips, alarm episodes, energy) depends on how often there is one"
)


def rate_text(period_s: float | None) -> str:
    """``5 Hz``; of a station that was asked without pause ``max``."""
    return "max" if period_s is None else f"{1 / period_s:.3g} Hz"


def is_same_rate(one_s: float | None, two_s: float | None) -> bool:
    """Of two periods in seconds; without pause both are None."""
    return one_s == two_s if one_s is None or two_s is None else isclose(one_s, two_s)
