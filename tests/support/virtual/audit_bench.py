"""An audit's looks at virtual stations in memory, on a clock that jumps: ``see(Bench(folder,
station_text(...)))``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from support.product import CounterCount, Observation, SurveyTarget
from support.virtual.manual import Bench

AUDIT: Final = "2026-11-21T06:17:00.000+00:00"

See = Callable[[Bench], dict[str, Observation]]
"""Looks at all stations of the bench, in the order of its file; gives what was seen by name."""
MakeBench = Callable[..., Bench]


def wanted(bench: Bench) -> list[SurveyTarget]:
    """All stations of the bench."""
    return [SurveyTarget(AUDIT, "hand", bench.target(name)) for name in bench.wires]


def count(seen: Observation, counter: str, port: int = 1) -> CounterCount:
    """That counter of that port."""
    return next(one for one in seen.counts if (one.port, one.counter) == (port, counter))
