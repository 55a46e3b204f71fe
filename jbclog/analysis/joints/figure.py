"""A figure: one number with what it rests on, or the reason why there is none.

`n` is how many readings, joints or heat-ups it was made of; `coverage` the share of the readings due in its window that are
there, in per cent; `resolution` the smallest difference that it can show, in its unit. A figure whose window has a gap has no
value, never zero: a gap is a place where two readings that follow each other are more than `GAP_PERIODS` nominal periods apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

GAP_PERIODS = 2.0


@dataclass(frozen=True, slots=True)
class Figure:
    """One metric of one port: its name in the table of definitions, its value (None: see `why`), its unit."""

    name: str
    value: float | None
    unit: str
    n: int
    coverage: float | None = None
    resolution: float | None = None
    why: str | None = None

    def named(self, name: str) -> Figure:
        return replace(self, name=name)


def no_figure(name: str, unit: str, why: str, n: int = 0, coverage: float | None = None) -> Figure:
    """A figure without a value, and the reason as a sentence."""
    return Figure(name, None, unit, n, coverage, None, why)
