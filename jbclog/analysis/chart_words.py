"""Charts as text: lines for a terminal, values for JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Final

import numpy as np

from jbclog.analysis import spc
from jbclog.analysis.charts import Charted
from jbclog.analysis.count_charts import Counted, Ranked
from jbclog.analysis.trend_words import capability_facts, capability_text, signals_text

MOST: Final = 10


def lines(one: Charted | Counted | Ranked) -> Iterator[str]:
    """Yield number and mean of the values, charts with their signals, fixed limits, capability."""
    if isinstance(one, Ranked):
        yield from _ranked(one)
    elif isinstance(one, Counted):
        yield from _counted(one)
    else:
        yield from _charted(one)


def _charted(one: Charted) -> Iterator[str]:
    series = one.series
    head = (
        f"{series.station} port {series.port}  {series.metric}  {len(series.values)} {series.each}s"
    )
    missing = f", {series.missing} more without a value" if series.missing else ""
    yield f"{head}{missing}" + (
        f", mean {series.values.mean():.4g} {series.uom}" if len(series.values) else ""
    )
    yield from (f"  {note}" for note in one.notes)
    if isinstance(one.charts, spc.Refused):
        yield f"  chart: none. {one.charts.text}"
    else:
        for chart in one.charts:
            yield from _chart(chart, one.names, one.scale or series.uom)
        rate = spc.FALSE_ALARMS.get(one.charts[0].tests)
        if rate is not None:
            yield f"  tests {', '.join(map(str, one.charts[0].tests))}: {rate.text}"
        if (points := spc.RUN_LENGTHS.get(one.charts[0].name)) is not None:
            yield (
                f"  on a stable process the first false alarm after {points:.0f} points on average"
            )
    if one.fixed is not None:
        yield from _chart(one.fixed, series.names, series.uom, "fixed limits")
    if one.capability is not None:
        yield f"  capability: {capability_text(one.capability, series.each)}"


def _chart(chart: spc.Chart, names: list[str], unit: str, name: str | None = None) -> Iterator[str]:
    shape = "" if chart.distribution == "normal" else f" ({chart.distribution})"
    limits = f"limits {chart.lower[-1]:.4g} to {chart.upper[-1]:.4g}"
    yield (
        f"  {name or chart.name}: centre {chart.centre:.4g}, {limits} {unit}{shape};"
        f" {signals_text(chart.signals)}"
    )
    # a moving range belongs to the later of its two values
    offset = len(names) - len(chart.points)
    for signal in chart.signals[:MOST]:
        yield f"    {names[signal.last + offset]}: {_why(chart, signal)}"
    if len(chart.signals) > MOST:
        yield f"    and {len(chart.signals) - MOST} more"


def _why(chart: spc.Chart, signal: spc.Signal) -> str:
    return (
        f"test {signal.test}: {signal.text}"
        if chart.name in ("individuals", "subgroup means")
        else "beyond the limit"
    )


def _counted(one: Counted) -> Iterator[str]:
    unit = "of the judged runs" if one.kind == "p" else "an hour"
    yield (
        f"{one.metric}: {one.counts.sum():.0f} in {one.sizes.sum():.3g}"
        f" {'runs' if one.kind == 'p' else 'h'}"
    )
    if isinstance(one.chart, spc.Refused):
        yield f"  chart: none. {one.chart.text}"
    else:
        yield from _chart(one.chart, one.names, unit)


def _ranked(one: Ranked) -> Iterator[str]:
    yield f"{one.metric}: {one.total}"
    for name, count, share, so_far in one.rows:
        yield f"  {name:40} {count:8}  {share:5.1f} %  cumulative {so_far:5.1f} %"


def facts(one: Charted | Counted | Ranked) -> dict[str, object]:
    """Return a chart as values for JSON."""
    if isinstance(one, Ranked):
        names = ("name", "count", "percent", "percent_up_to_here")
        return {
            "metric": one.metric,
            "total": one.total,
            "rows": [dict(zip(names, row, strict=True)) for row in one.rows],
        }
    if isinstance(one, Counted):
        chart = (
            {"refused": asdict(one.chart)}
            if isinstance(one.chart, spc.Refused)
            else _facts(one.chart, one.names)
        )
        counted = {"names": one.names, "counts": one.counts.tolist(), "sizes": one.sizes.tolist()}
        return {"metric": one.metric, "kind": one.kind, **counted, "chart": chart}
    series = one.series
    own: object = one.charts
    if isinstance(one.charts, spc.Refused):
        own = {"refused": asdict(one.charts)}
    else:
        own = [_facts(chart, one.names) for chart in one.charts]
    return {
        "station": series.station,
        "port": series.port,
        "metric": series.metric,
        "uom": series.uom,
        "each": series.each,
        "kind": one.kind,
        "scale": one.scale,
        "n": len(series.values),
        "missing": series.missing,
        "names": series.names,
        "values": series.values.tolist(),
        "charts": own,
        "fixed": None if one.fixed is None else _facts(one.fixed, series.names),
        "capability": capability_facts(one.capability),
        "notes": one.notes,
    }


def _facts(chart: spc.Chart, names: list[str]) -> dict[str, object]:
    offset = len(names) - len(chart.points)
    rate = spc.FALSE_ALARMS.get(chart.tests)
    return {
        "name": chart.name,
        "distribution": chart.distribution,
        "centre": chart.centre,
        "sigma": chart.sigma,
        "lower": _same_or_all(chart.lower),
        "upper": _same_or_all(chart.upper),
        "points": chart.points.tolist(),
        "tests": list(chart.tests),
        "false_alarms": None if rate is None else asdict(rate),
        "signals": [[names[one.last + offset], _why(chart, one)] for one in chart.signals],
    }


def _same_or_all(limits: np.ndarray) -> float | list[float]:
    """Return one number if all points have the same limit, else the limit of each."""
    return float(limits[0]) if np.ptp(limits) == 0 else limits.tolist()
