"""A figure: a number with its basis, or the reason why there is none.

- `n`: number of readings, joints or heat-ups in it
- `coverage`: share of the readings due in its window that were obtained, in per cent
- `low`, `high`: between which values it lies, where the record gives such a range
- `resolution`: smallest difference that it can show, in its unit

A figure whose window has a gap has no value, never zero. A gap is where two consecutive readings
are more than `GAP_PERIODS` periods apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

GAP_PERIODS = 2.0


@dataclass(frozen=True, slots=True)
class Figure:
    """One metric of one port: its name in the table of definitions, its value (None: see `why`),
    its unit.
    """

    name: str
    value: float | None
    unit: str
    n: int
    coverage: float | None = None
    resolution: float | None = None
    why: str | None = None
    low: float | None = None
    high: float | None = None

    def named(self, name: str) -> Figure:
        """Return the same figure under another name."""
        return replace(self, name=name)


def no_figure(
    name: str,
    unit: str,
    why: str,
    n: int = 0,
    coverage: float | None = None,
    *,
    low: float | None = None,
    high: float | None = None,
) -> Figure:
    """Return a figure without a value, with the reason as a sentence; its range may be known."""
    return Figure(name, None, unit, n, coverage, None, why, low, high)
