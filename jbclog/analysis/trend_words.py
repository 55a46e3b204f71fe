"""Trends as text: lines for a terminal, values for JSON, an HTML page with the chart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from html import escape
from typing import TYPE_CHECKING, Final

from jbclog.analysis import spc
from jbclog.analysis.notebook_html import table, text
from jbclog.analysis.trend import Point, Trend, metric_text, title_of
from jbclog.core.text import count_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST: Final = 10
STYLE: Final = (
    "body{font:16px/1.45 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0"
    " 1rem;color:#1a1a1a}svg{max-width:100%;height:auto}table{border-collapse:collapse;margin:1rem"
    " 0;font-variant-numeric:tabular-nums}th,td{text-align:left;padding:.2rem .8rem .2rem"
    " 0;border-bottom:1px solid #ccc;vertical-align:top}@media print{body{margin:0;max-width:none}}"
)


def lines(trend: Trend) -> Iterator[str]:
    """Yield mean and standard deviation, the chart's result, signals, capability, changes, and
    missing values.
    """
    head = (
        f"{trend.station} port {trend.port}  {trend.metric}  {len(trend.values)} of"
        f" {len(trend.points)} runs"
    )
    spread = "" if trend.sd is None else f", sd {trend.sd:.3g}"
    yield head if trend.mean is None else f"{head}, mean {trend.mean:.4g} {trend.uom}{spread}"
    yield from (f"  warning: {text}" for text in trend.warnings)
    yield f"  chart: {chart_text(trend)}"
    for run, why in trend.signals[:MOST]:
        yield f"    {run}: {why}"
    if len(trend.signals) > MOST:
        yield f"    and {len(trend.signals) - MOST} more"
    if trend.capability is not None:
        yield f"  capability: {capability_text(trend.capability)}"
    yield from (f"  changed: {change}" for change in trend.changes)
    for reason, count in Counter(
        point.why for point in trend.points if point.value is None
    ).most_common():
        yield f"  no value in {count_text(count, 'run')}: {reason}"


def chart_text(trend: Trend) -> str:
    """Return the control limits and the number of signals, or why there are none."""
    if isinstance(trend.chart, spc.Refused):
        return f"none. {trend.chart.text}"
    values = trend.chart[0]
    return (
        f"individuals {values.centre:.4g}, limits {values.lower[0]:.4g} to {values.upper[0]:.4g}"
        f" {trend.uom}; {signals_text(trend.signals)}"
    )


def signals_text(signals: Sequence[object]) -> str:
    """Return the number of signals in words."""
    return count_text(len(signals), "signal") if signals else "no signal"


def capability_text(found: spc.Capability | spc.Refused, each: str = "run") -> str:
    """Return the capability indices with bounds, or why there are none. `each`: kind of a value."""
    if isinstance(found, spc.Refused):
        return f"none. {found.text}"
    named = (("Cp", found.cp), ("Cpk", found.cpk), ("Pp", found.pp), ("Ppk", found.ppk))
    # otherwise Cp and Cpk are equal
    shown = named if found.distribution == "normal" else named[2:]
    indices = [
        f"{name} {index.value:.2f} (at least {index.bound:.2f})"
        for name, index in shown
        if index is not None
    ]
    method = (
        "" if found.distribution == "normal" else f" by {_named(found.distribution)} (ISO 22514-2)"
    )
    return f"{', '.join(indices)}; 95 % bounds of {found.n} {each}s{method}"


def _named(distribution: str) -> str:
    return (
        "the values' own percentiles"
        if distribution == "percentiles"
        else f"the percentiles of a {distribution} distribution"
    )


def facts(trend: Trend) -> dict[str, object]:
    """Return the trend as values for JSON."""
    chart: dict[str, object]
    if isinstance(trend.chart, spc.Refused):
        chart = {"refused": asdict(trend.chart)}
    else:
        values = trend.chart[0]
        limits = {"lower": float(values.lower[0]), "upper": float(values.upper[0])}
        chart = {
            "centre": values.centre,
            "sigma": values.sigma,
            **limits,
            "signals": [list(one) for one in trend.signals],
        }
    return {
        "station": trend.station,
        "port": trend.port,
        "metric": trend.metric,
        "uom": trend.uom,
        "n": len(trend.values),
        "mean": trend.mean,
        "sd": trend.sd,
        "chart": chart,
        "capability": capability_facts(trend.capability),
        "changes": trend.changes,
        "warnings": trend.warnings,
        "points": [
            {**asdict(point), "start": point.start and point.start.isoformat()}
            for point in trend.points
        ],
    }


def capability_facts(found: spc.Capability | spc.Refused | None) -> dict[str, object] | None:
    """Return the capability, or why it is refused, as values for JSON."""
    if found is None:
        return None
    return {"refused": asdict(found)} if isinstance(found, spc.Refused) else asdict(found)


def page(trends: Sequence[Trend], metric: str, figure: Figure) -> str:
    """Return an HTML page without external resources: definition, chart, results, all values."""
    from jbclog.analysis.figures.canvas import svg_text  # imports matplotlib

    results = "".join(
        f"<p>{'<br>'.join(escape(_shown(line)) for line in lines(one))}</p>" for one in trends
    )
    cells = [_cells(one, point) for one in trends for point in one.points]
    heads = ("run", "started", "station", "port", "value", "uom", "n", "why there is no value")
    values = table(heads, cells)
    title = f"{text(title_of(metric).capitalize())} over {len({row[0] for row in cells})} runs"
    head = "<meta charset='utf-8'><meta name='viewport' content='width=device-width'>"
    claim = "<p>Figures describe the record. None of them proves that a joint is good.</p>"
    heading = f"<h1>{title}</h1><p>{escape(metric_text(metric))}</p>"
    body = f"{heading}{svg_text(figure)}{results}{values}{claim}"
    style = f"<title>{title}</title><style>{STYLE}</style>"
    return f"<!doctype html><html lang='en'><head>{head}{style}</head><body>{body}</body></html>\n"


def _cells(trend: Trend, point: Point) -> tuple[object, ...]:
    start = None if point.start is None else f"{point.start:%Y-%m-%d %H:%M}"
    value = "" if point.value is None else f"{point.value:.4g}"
    return (point.run, start, trend.station, trend.port, value, trend.uom, point.n, point.why)


def _shown(line: str) -> str:
    return "".join(sign if sign.isprintable() else "�" for sign in line)
