"""Limits in per cent, judged with the resolution of the run: readings are counted one by one.

A limit that lies between two counts is the lower one: of 194 readings 99.5 % are 193.03, and 193 keep it. 100 % are all of them.
"""

from __future__ import annotations

from math import ceil, floor
from typing import Final

RESOLVES: Final = 20
"""With fewer readings than this one of them is too much to let pass."""


def allowed_misses(due: int, least_percent: float) -> int:
    """How many of the readings due may be missing."""
    return ceil(due * (100 - least_percent) / 100 - 1e-9)


def floored(percent: float) -> float:
    """Two decimals, never rounded up to a limit that is missed."""
    return floor(percent * 100 + 1e-9) / 100


def shown(figure: float) -> str:
    """Up to two decimals, without the zeros behind."""
    return f"{figure:.2f}".rstrip("0").rstrip(".")
