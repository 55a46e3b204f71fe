"""Times and figures as a report shows them; `jbclog/core/text.py` has what all pages share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import floor
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from jbclog.core.text import number

Row = dict[str, object]
"""A row of a table by its columns."""
RowView = Mapping[str, object]
"""A read-only row."""


def items(value: object) -> Sequence[Any]:
    """Return the items of a list in a report; empty if it is not a list."""
    return value if isinstance(value, list | tuple) else ()


def row_views(value: object) -> list[RowView]:
    """Return the objects in a list of a report; empty if it is not a list."""
    return [row for row in items(value) if isinstance(row, Mapping)]


def mapping(value: object) -> RowView:
    """Return an object of a report; empty if it is not an object."""
    return value if isinstance(value, Mapping) else {}


def iso_times(times: pa.Array) -> pa.StringArray:
    """Return a column of UTC times as `utc_text` writes them."""
    return pc.strftime(times.cast(pa.int64()).cast(pa.timestamp("us")), "%Y-%m-%dT%H:%M:%SZ")


def clock(text: str | None, *, with_day: bool = False) -> str:
    """Return ``01:30:00.123`` of `utc_text`, with the day ``11-21 01:30:00.123``."""
    if text is None:
        return ""
    return f"{text[5:10]} {text[11:23]}" if with_day else text[11:23]


def interval(row: Mapping[str, object], earliest: str, latest: str) -> str:
    """Return ``14:15:30.372 to 30.478``, the times of two readings; a dash without one."""
    first, last = (
        None if row.get(name) is None else clock(str(row[name])) for name in (earliest, latest)
    )
    if last is None:
        return "–"
    if first is None or first == last:
        return last
    return f"{first} to {last[6:] if first[:6] == last[:6] else last}"


def measured(value: object, unit: str) -> str:
    """Return a figure with its unit. Per cent are never rounded up: 99.996 % of the readings are
    not all of them.
    """
    if isinstance(value, float) and unit == "%":
        value = floor(value * 100 + 1e-9) / 100
    return (
        number(value)
        if value is None or isinstance(value, str) or not unit
        else f"{number(value)} {unit}"
    )


def bound_text(bound: object, unit: str) -> str:
    """Return the 95 % bound of a rule: ``−0.1 to 0.5 °C``, ``up to 0.9 °C``; a dash without one."""
    if not isinstance(bound, Mapping) or not isinstance(bound.get("high"), int | float):
        return "–"
    low, high = bound.get("low"), round(float(bound["high"]), 2)
    return (
        f"up to {measured(high, unit)}"
        if not isinstance(low, int | float)
        else f"{number(round(float(low), 2))} to {measured(high, unit)}"
    )
