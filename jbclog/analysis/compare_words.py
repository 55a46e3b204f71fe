"""The comparison of two runs as text: lines for a terminal, values for JSON."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import asdict
from typing import Final

import pandas as pd

from jbclog.analysis.compare import Comparison, SameIdle
from jbclog.analysis.spc import Refused

MOST_SETTINGS: Final = 200


def lines(found: Comparison) -> Iterator[str]:
    """Yield all differences, and all metrics."""
    yield f"first   {found.first.place}"
    yield f"second  {found.second.place}"
    yield from (f"warning: {text}" for text in found.warnings)
    yield from (f"{one.what}: {one.first} | {one.second}" for one in found.facts)
    yield from (
        ["", "The recipes differ:", *found.recipe]
        if found.recipe
        else ["", "The recipes are the same."]
    )
    if len(found.settings):
        yield from ("", "Settings as read back, first | second:")
        for row in found.settings.head(MOST_SETTINGS).to_dict("records"):
            place = f"{row['station']} port {row['port']}" if row["port"] else row["station"]
            yield (
                f"  {place}  {row['setting']}: {_or_none(row['first'])} | {_or_none(row['second'])}"
                f" {row['uom']}"
            )
        if (more := len(found.settings) - MOST_SETTINGS) > 0:
            yield f"  and {more} more; --json lists all"
    yield from ("", "Metrics, first | second (difference):")
    yield from _metric_lines(found)
    yield from ("", "Alarm episodes, first | second:")
    yield from _alarm_lines(found)
    yield from ("", f"Idle means, second minus first, within ±{found.margin_c:g} °C:")
    yield from (f"  {one.station} port {one.port}: {idle_text(one)}" for one in found.idle)


def _metric_lines(found: Comparison) -> Iterator[str]:
    port = None
    for row in found.metrics.itertuples():
        if (row.station, row.port) != port:
            port = row.station, row.port
            yield f"  {row.station} port {row.port}"
        if not (_is_none(row.first) and _is_none(row.second)):
            difference = "" if _is_none(row.difference) else f"  ({_figure(row.difference)})"
            yield (
                f"    {row.metric:28} {_figure(row.first):>10} | {_figure(row.second):<10}"
                f" {row.uom}{difference}"
            )


def _alarm_lines(found: Comparison) -> Iterator[str]:
    if not len(found.alarms):
        yield "  none in either"
    for row in found.alarms.itertuples():
        yield (
            f"  {row.station} port {row.port}  {row.side}, detector {row.detector}: {row.first} |"
            f" {row.second}"
        )


def idle_text(one: SameIdle) -> str:
    """Return the result of the equivalence test as a sentence."""
    if isinstance(one.result, Refused):
        return f"not known. {one.result.text}"
    test = one.result
    return (
        f"{test.verdict}: {test.difference:+.2f} °C, 90 % interval {test.low:+.2f} to"
        f" {test.high:+.2f} °C (p = {test.p:.2g})"
    )


def _figure(value: object) -> str:
    """Return a number with four digits; ``-`` for a missing one."""
    return f"{value:.4g}" if isinstance(value, int | float) and not _is_none(value) else "-"


def _or_none(value: object) -> str:
    return "not read" if _is_none(value) else str(value)


def _is_none(value: object) -> bool:
    return value is None or value is pd.NA or (isinstance(value, float) and value != value)


def facts(found: Comparison) -> dict[str, object]:
    """Return the comparison as values for JSON."""
    tables = {name: getattr(found, name) for name in ("settings", "metrics", "alarms")}
    rows = {
        name: [_plain(row) for row in table.to_dict("records")] for name, table in tables.items()
    }
    idle = [{"station": one.station, "port": one.port, **_result(one)} for one in found.idle]
    head = {"first": found.first.place, "second": found.second.place, "margin_c": found.margin_c}
    head["warnings"] = found.warnings
    return {
        **head,
        "facts": [asdict(one) for one in found.facts],
        "recipe": found.recipe,
        **rows,
        "idle": idle,
    }


def _plain(row: Mapping[Hashable, object]) -> dict[str, object]:
    return {str(name): None if _is_none(cell) else cell for name, cell in row.items()}


def _result(one: SameIdle) -> dict[str, object]:
    if isinstance(one.result, Refused):
        return {"verdict": "not known", "refused": asdict(one.result)}
    return {"verdict": one.result.verdict, **asdict(one.result)}
