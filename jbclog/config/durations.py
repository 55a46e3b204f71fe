"""Durations as people write them: ``90s``, ``15m``, ``8h``, ``1h30m``."""

from __future__ import annotations

import re
from typing import Final

LONGEST_S: Final = 366 * 86400.0
EXAMPLES: Final = "a time such as 90s, 15m, 8h or 1h30m"
_PARTS: Final = re.compile(
    r"(?:(\d+(?:\.\d+)?)h)?(?:(\d+(?:\.\d+)?)m)?(?:(\d+(?:\.\d+)?)s?)?", re.ASCII
)


def span_s(text: str) -> float | None:
    """Parse a duration such as ``90s``, ``15m``, ``8h``, ``1h30m`` or a bare number of seconds;
    None if it is no duration or over a year.
    """
    found = _PARTS.fullmatch(text.strip())
    parts = [float(part or 0) for part in found.groups()] if found else []
    seconds = sum(part * unit for part, unit in zip(parts, (3600, 60, 1), strict=False))
    return seconds if 0 < seconds <= LONGEST_S else None
