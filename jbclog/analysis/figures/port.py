"""The figure of one port: temperature, power and lanes on one time axis; only lanes for a station
without a temperature.

A figure contains numbers and words from fixed lists; the words of a foreign record's lanes are
cleaned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jbclog.analysis.figures import style
from jbclog.analysis.figures.axes import (
    Label,
    bars,
    dots,
    labelled,
    panel,
    rectangles,
    size_pt,
    steps,
    ticked,
    valued,
)
from jbclog.analysis.figures.canvas import new_figure, styled
from jbclog.analysis.figures.curves import (
    Envelope,
    Floats,
    Readings,
    Span,
    envelope,
    lone,
    merged,
    quantile_of_readings,
    widened,
)
from jbclog.analysis.figures.lanes import LANE_PT, Lane, draw_lanes, lanes_of, least_seen_s
from jbclog.analysis.figures.style import Format, Look
from jbclog.analysis.figures.ticks import round_values, time_marks
from jbclog.analysis.figures.trace import JOINED_PERIODS, SETTING_JOINED_S, Trace

LEFT, RIGHT, TOP, BOTTOM = 38.0, 49.0, 12.0, 19.0  # margins in points
NAMED_LEFT, NAMED_RIGHT, NAMED_TOP = 56.0, 16.0, 7.0  # margins of a figure with lanes only
# between the panels; the temperature's share of the height
BETWEEN, ABOVE_LANES, UPPER = 15.0, 7.0, 0.7
STATE_LANE_PT = 19.0  # in a figure with lanes only
SHORT_S = 1.0
WIDE_JOINT = 3.0  # a joint longer than this many visible minimums is shaded over the full height
RARE = 0.02  # share of samples that may lie in the coarse part of a scale
COARSE: Final = 0.2  # share of the height below a knee


class Scale(NamedTuple):
    """Scale of the temperature in °C; below the knee, if there is one, it is coarser."""

    low: float
    high: float
    knee: float | None


def draw(trace: Trace, form: Format, scale: Scale | None = None) -> Figure:
    """Return the figure of one port. `scale`: the result of `scale_of`, if already known."""
    lanes = lanes_of(trace, form)
    with styled():
        figure = new_figure(form.width_pt, height_pt(trace, lanes, form))
        draw_at(figure, 0.0, trace, lanes, form, scale=scale)
    return figure


def height_pt(trace: Trace, lanes: list[Lane], form: Format) -> float:
    """Return the height of a port's figure in points."""
    return (
        STATE_LANE_PT * len(lanes) + 30 if trace.states else form.height_pt + LANE_PT * len(lanes)
    )


def draw_at(
    figure: Figure,
    top: float,
    trace: Trace,
    lanes: list[Lane],
    form: Format,
    *,
    has_knee: bool = True,
    scale: Scale | None = None,
) -> list[Axes]:
    """Draw a port into a figure, `top` points below its upper edge, and return the panels, the
    lowest last.

    `has_knee`: rare low temperatures may have a coarser part of the scale.
    """
    panels = _panels(figure, top, trace, lanes, form)
    marks = time_marks(trace.grid.t0_utc_us, trace.start, trace.end, form.time_marks)
    for axes in panels:
        axes.set_xlim(*trace.dates([trace.start, trace.end]).tolist())
        places, labels = trace.dates([second for second, _ in marks]), [label for _, label in marks]
        ticked(axes, places, labels, is_lowest=axes is panels[-1])
    if len(panels) > 1:
        _temperature(panels[0], trace, form, scale or scale_of(trace, has_knee=has_knee))
        _power(panels[1], trace, form)
    draw_lanes(panels[-1], lanes, trace, form)
    return panels


def _panels(
    figure: Figure, top: float, trace: Trace, lanes: list[Lane], form: Format
) -> list[Axes]:
    if trace.states:
        width = form.width_pt - NAMED_LEFT - NAMED_RIGHT
        return [panel(figure, NAMED_LEFT, top + NAMED_TOP, width, STATE_LANE_PT * len(lanes))]
    width, low = form.width_pt - LEFT - RIGHT, LANE_PT * len(lanes)
    free = height_pt(trace, lanes, form) - TOP - BOTTOM - low - BETWEEN - ABOVE_LANES
    heights = (UPPER * free, (1 - UPPER) * free, low)
    tops = (TOP, TOP + heights[0] + BETWEEN, TOP + free + BETWEEN + ABOVE_LANES)
    return [
        panel(figure, LEFT, top + one, width, height)
        for one, height in zip(tops, heights, strict=True)
    ]


def _known(values: Readings) -> Readings:
    """Return the values without NaN; `values` itself if it has none."""
    there = ~np.isnan(values)
    return values if there.all() else values[there]


def _temperature(axes: Axes, trace: Trace, form: Format, scale: Scale) -> None:
    _scale(axes, scale)
    _shade_spans(axes, trace, form)
    _joints(axes, trace, form)
    _curve(
        axes,
        trace,
        trace.temperature,
        form,
        (style.TEMPERATURE, style.TEMPERATURE_BAND, "temperature"),
    )
    labels = [*_setting(axes, trace, form), *_limits(axes, trace), *_external(axes, trace, form)]
    of_work = any(text == "work" for _, text, _ in labels)
    axes.set_title(
        f"{'Tip' if trace.air is None else 'Air'} temperature in"
        f" °C{', and that of the work' * of_work}"
    )
    labelled(axes, labels, form.font_pt)


def scale_of(trace: Trace, *, has_knee: bool = True) -> Scale:
    """Return a scale that contains readings, settings and limits; `has_knee`: a part of it may be
    coarser.
    """
    read, external = (
        _known(trace.temperature),
        np.empty(0) if trace.air is None else _known(trace.air.external),
    )
    lines = [external, _known(trace.setting), *(np.array(limit.celsius) for limit in trace.limits)]
    low, high = _range([read, *lines], least=20)
    return Scale(low, high, _knee([read, external], lines[1:], low, high) if has_knee else None)


def _scale(axes: Axes, scale: Scale) -> None:
    low, high, knee = scale
    axes.set_ylim(low, high)
    if knee is not None:
        axes.set_yscale("function", functions=_bent(low, knee, high))
        axes.axhspan(
            low, knee, facecolor=style.COARSER_TINT, linewidth=0, zorder=0.1, gid="coarser"
        )
        look: Look = {
            "ha": "right",
            "va": "center_baseline",
            "color": style.QUIET,
            "fontsize": "medium",
            "zorder": 3,
        }
        axes.text(
            1 - 3 / size_pt(axes)[0], COARSE / 2, "coarser scale", transform=axes.transAxes, **look
        )
    valued(axes, round_values(low, high, 5) if knee is None else _bent_values(low, knee, high))


def _range(parts: Sequence[Readings], least: float) -> tuple[float, float]:
    ends = [
        (float(known.min()), float(known.max())) for part in parts if len(known := _known(part))
    ]
    if not ends:
        return 0.0, 400.0
    low, high = min(one for one, _ in ends), max(one for _, one in ends)
    margin = max(0.06 * (high - low), (least - (high - low)) / 2, 2.0)
    return low - margin, high + margin


def _knee(
    read: Sequence[Readings], lines: Sequence[Readings], low: float, high: float
) -> float | None:
    """Return the temperature below which the scale may be coarser: few samples, no line, and enough
    height saved; else None.
    """
    # an empty part would make all of them 64 bits wide
    parts = [part for part in read if len(part)]
    if not parts:
        return None
    floor = min(
        float(_known(part).min())
        for part in (np.array([quantile_of_readings(parts, RARE)]), *lines)
        if len(_known(part))
    )
    knee = 10 * np.floor((floor - 5) / 10)
    return float(knee) if high - knee < 0.5 * (high - low) else None


def _bent(
    low: float, knee: float, high: float
) -> tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]:
    """Return a scale with `COARSE` of the height below the knee, and its inverse."""
    values, shares = [low, knee, high], [0.0, COARSE, 1.0]
    return (lambda celsius: np.interp(celsius, values, shares)), (
        lambda share: np.interp(share, shares, values)
    )


def _bent_values(low: float, knee: float, high: float) -> list[float]:
    """Return ticks above the knee, and a few below that are not too close to it."""
    return [
        *(one for one in round_values(low, knee, 2) if one <= knee - 0.3 * (knee - low)),
        *round_values(knee, high, 5),
    ]


def _joints(axes: Axes, trace: Trace, form: Format) -> None:
    """Draw a bar at the foot for each joint, higher if the tip did not recover before the next."""
    least, high = least_seen_s(trace, form), size_pt(axes)[1]
    for word, colour in style.JOINT_COLOURS.items():
        spans = [
            widened(span, least)
            for span in merged((one for one in trace.joints if one.word == word), least)
        ]
        places = [
            (*trace.dates([one.start, one.end]).tolist(), 0.0, style.JOINT_HEIGHTS[word] / high)
            for one in spans
        ]
        rectangles(
            axes, places, f"joint {word}", facecolor=colour, transform=axes.get_xaxis_transform()
        )


def _setting(axes: Axes, trace: Trace, form: Format) -> list[Label]:
    """Draw a dot at each reading of the setting and a line between equal ones; no line after the
    last nor across an outage.
    """
    known = _known(trace.setting)
    if not len(known):
        return []
    curve = envelope(trace.seconds, trace.setting, form.stretches, SETTING_JOINED_S)
    if curve.whole:
        axes.plot(*_held(trace, curve), gid="set", **style.LINES["set"])
        if len(known) <= form.most_dots:
            dots(axes, trace.dates(curve.seconds), curve.mean, 1.8, style.SETTING, "set")
    else:
        axes.plot(*steps(trace.dates(curve.seconds), curve.high), gid="set", **style.LINES["set"])
    return [(float(known[-1]), f"set {known[-1]:g}", style.SETTING)]


def _held(trace: Trace, curve: Envelope) -> tuple[Floats, Floats]:
    """Return the readings of the setting, with a break before each that differs from the previous
    one or follows an outage.
    """
    outages = np.array([gap.start for gap in trace.gaps if gap.seconds >= SHORT_S])
    is_over = np.diff(np.searchsorted(outages, curve.seconds)) > 0  # nothing was read in between
    # NaN differs from everything
    changes = np.flatnonzero((np.diff(curve.mean) != 0) | is_over) + 1
    return trace.dates(np.insert(curve.seconds, changes, np.nan)), np.insert(
        curve.mean, changes, np.nan
    )


def _limits(axes: Axes, trace: Trace) -> list[Label]:
    """Draw the limits as steps; each label is the limit in force at the end."""
    for limit in trace.limits:
        seconds = np.array([*limit.seconds, max(trace.end, limit.seconds[-1])])
        celsius = np.array([*limit.celsius, limit.celsius[-1]])
        axes.plot(*steps(trace.dates(seconds), celsius), gid=limit.side, **style.LINES[limit.side])
    last = [
        (limit.celsius[-1], limit.side) for limit in trace.limits if not np.isnan(limit.celsius[-1])
    ]
    return [(celsius, f"{side} {celsius:g}", style.ALARM) for celsius, side in last]


def _external(axes: Axes, trace: Trace, form: Format) -> list[Label]:
    """Draw the external thermocouple of hot air, if there is one."""
    if trace.air is None or np.isnan(trace.air.external).all():
        return []
    _curve(axes, trace, trace.air.external, form, (style.EXTERNAL, style.EXTERNAL_BAND, "external"))
    return [(float(_known(trace.air.external)[-1]), "work", style.EXTERNAL)]


def _power(axes: Axes, trace: Trace, form: Format) -> None:
    known = _known(trace.power)
    axes.set_ylim(0, max(100.0, 1.08 * float(known.max())) if len(known) else 1000.0)
    valued(axes, round_values(*axes.get_ylim(), 3))
    _shade_spans(axes, trace, form)
    _curve(axes, trace, trace.power, form, (style.POWER, style.POWER_BAND, "power"), is_filled=True)
    axes.set_title("Power in ‰")
    if len(known):
        labelled(axes, [(float(known.max()), f"max {known.max():g}", style.POWER)], form.font_pt)


def _curve(
    axes: Axes,
    trace: Trace,
    values: Readings,
    form: Format,
    look: tuple[str, str, str],
    *,
    is_filled: bool = False,
) -> None:
    """Draw the mean as a line within minimum and maximum, a lone reading as a dot or a bar."""
    colour, band, of = look
    curve = envelope(trace.seconds, values, form.stretches, JOINED_PERIODS * trace.period_s)
    x, alone = trace.dates(curve.seconds), lone(curve)
    if not curve.whole:
        axes.fill_between(
            x,
            curve.low,
            curve.high,
            facecolor=band,
            edgecolor=colour,
            linewidth=0.25,
            gid=of,
            zorder=1.5,
        )
        bars(
            axes,
            trace.dates(alone.seconds),
            alone.low,
            alone.high,
            of,
            color=band,
            linewidth=0.8,
            zorder=1.5,
        )
    elif is_filled:
        axes.fill_between(x, 0, curve.high, facecolor=band, linewidth=0, gid=of, zorder=1.5)
    axes.plot(x, curve.mean, color=colour, gid=of)
    dots(axes, trace.dates(alone.seconds), alone.mean, 1.1, colour, of)


def _shade_spans(axes: Axes, trace: Trace, form: Format) -> None:
    """Shade joints, alarms and errors below the grid, gaps above it.

    A gap shorter than both `SHORT_S` and the visible minimum is only in the lanes: a hundred single
    lost readings would hide a curve that is nearly complete.
    """
    least = least_seen_s(trace, form)
    wide = [joint for joint in trace.joints if joint.seconds > WIDE_JOINT * least]
    _shaded(axes, trace, wide, "joint", facecolor=style.JOINT_TINT, zorder=0.2)
    for kind, tint in style.MARK_TINTS.items():
        spans = [widened(mark.span, least) for mark in trace.marks if mark.kind == kind]
        _shaded(axes, trace, spans, "mark", facecolor=tint, zorder=0.3)
    gaps = merged((gap for gap in trace.gaps if gap.seconds >= min(SHORT_S, least)), least)
    hatches = [style.hatch(gap.word, gap.seconds > 4 * least) for gap in gaps]
    for hatch in dict.fromkeys(hatches):
        spans = [
            widened(gap, least) for gap, own in zip(gaps, hatches, strict=True) if own == hatch
        ]
        face = style.NO_DATA_TINT if hatch else style.NO_DATA
        _shaded(
            axes,
            trace,
            spans,
            "gap",
            facecolor=face,
            edgecolor=style.NO_DATA,
            hatch=hatch,
            zorder=0.8,
        )


def _shaded(axes: Axes, trace: Trace, spans: Sequence[Span], of: str, **look: object) -> None:
    places = [(*trace.dates([span.start, span.end]).tolist(), 0.0, 1.0) for span in spans]
    rectangles(axes, places, of, transform=axes.get_xaxis_transform(), **look)
