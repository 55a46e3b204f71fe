"""Names of maintenance tasks that need no tasks file: events that affect a station's counters."""

from __future__ import annotations

from typing import Final

RESET: Final = "counters-reset"
REPLACED: Final = "station-replaced"
ROLLED_OVER: Final = "counters-rolled-over"
STATED: Final = (RESET, REPLACED, ROLLED_OVER)
