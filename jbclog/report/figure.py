"""The figure of one port, its caption, and the minute worth a closer look.

Nothing in a figure comes from outside but numbers and words of our own lists.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jbclog.report import style
from jbclog.report.drawing import Drawing, Stroke
from jbclog.report.panel import LANE_PT, Label, Lane, Panel, draw_lanes, lanes_of, least_seen_s
from jbclog.report.scale import Scale, duration_text, moment, round_marks, time_marks
from jbclog.report.style import WIDE, Format
from jbclog.report.svg import svg_text
from jbclog.report.trace import JOINED_PERIODS, LATE, SETTING_JOINED_S, Envelope, Floats, Trace, envelope, lone, merged, widened

# -- detail window ------------------------------------------------------------------------------------------------------------
# The minute of a long run that is worth a closer look, so that single joints can be seen in it.

WINDOW_S = 60.0
LONG_S = 180.0  # shorter runs are looked at closely enough by their first figure


def closer(trace: Trace) -> tuple[Trace, str] | None:
    """One minute of the trace and why that one; None for a short run."""
    if trace.end - trace.start <= LONG_S:
        return None
    middle, why = _moment(trace)
    start = min(max(middle - WINDOW_S / 2, trace.start), trace.end - WINDOW_S)
    return trace.between(start, start + WINDOW_S), why


def _moment(trace: Trace) -> tuple[float, str]:
    for kind, why in (("alarm", "the first alarm"), ("unconfirmed", "the first doubtful alarm"), ("error", "the first error")):
        first = next((mark for mark in trace.marks if mark.kind == kind), None)
        if first is not None:
            return (first.span.start + first.span.end) / 2, why
    hottest = _hottest(trace)
    return (hottest, "the hottest reading") if hottest is not None else ((trace.start + trace.end) / 2, "the middle of the run")


def _hottest(trace: Trace) -> float | None:
    """When the tip was hottest; None where it was never read."""
    if np.isnan(trace.temperature).all():
        return None
    return float(trace.seconds[int(np.nanargmax(trace.temperature))])


# -- captions -----------------------------------------------------------------------------------------------------------------
# What a figure shows, in words: for the line above it, and for those who cannot see it.

MOST_GAPS_NAMED = 3


def caption(trace: Trace) -> str:
    """The day, what the band means, and the longest gaps by name."""
    parts = [f"{_day(trace)}, times in UTC."]
    read = int(np.count_nonzero(~np.isnan(trace.setting)))
    if read:
        parts.append(f"The setting is known where it was read{', at the dots' if read <= WIDE.most_dots else ''}.")
    if len(trace.seconds) > 2 * WIDE.stretches:
        stretch = (trace.end - trace.start) / WIDE.stretches
        parts.append(f"Line: mean, band: min–max of every {duration_text(stretch)}.")
    if trace.joints:
        parts.append(joints_marked(trace))
    gaps = sorted(trace.gaps, key=lambda gap: (-round(gap.seconds, 6), gap.start))
    named = [
        f"{gap.word.replace('_', ' ')} {duration_text(gap.seconds)} at {_clock(trace, gap.start)}" for gap in gaps[:MOST_GAPS_NAMED]
    ]
    if named:
        more = len(gaps) - len(named)
        parts.append(f"No data: {', '.join(named)}{f' and {more} more' if more else ''}.")
    return " ".join(parts)


def closer_caption(part: Trace, why: str) -> str:
    """Which minute it is and why that one."""
    joints = f" {joints_marked(part)}" if part.joints else ""
    return f"Closer: {_clock(part, part.start)} to {_clock(part, part.end)}, around {why}.{joints}"


def joints_marked(trace: Trace) -> str:
    """What the bars at the foot of the temperature are."""
    count, late = len(trace.joints), sum(one.word == LATE for one in trace.joints)
    bars = f"Bars at the foot: {count} joint{'s' * (count != 1)}"
    return f"{bars}; high and red: {late} after which the next one came before the tip was back." if late else f"{bars}."


def description(place: str, trace: Trace) -> str:
    """The figure without seeing it."""
    if trace.states:
        return f"{place}: its states over {duration_text(trace.end - trace.start)}, {len(trace.gaps)} gaps."
    known = trace.temperature[~np.isnan(trace.temperature)]
    seen = f"from {known.min():g} to {known.max():g} °C" if len(known) else "never read"
    alarms = sum(mark.kind == "alarm" for mark in trace.marks)
    length = duration_text(trace.end - trace.start)
    what = "tip" if trace.air is None else "air"
    joints = f"{len(trace.joints)} joints, " if trace.joints else ""
    return f"{place}: {what} temperature {seen} over {length}, {joints}{alarms} alarms, {len(trace.gaps)} gaps, power below."


def _day(trace: Trace) -> str:
    return moment(trace.grid.t0_utc_us + round(trace.start * 1e6)).strftime("%Y-%m-%d")


def _clock(trace: Trace, seconds: float) -> str:
    return moment(trace.grid.t0_utc_us + round(seconds * 1e6)).strftime("%H:%M:%S")


# -- figure -------------------------------------------------------------------------------------------------------------------

LEFT, RIGHT, TOP, BOTTOM = 36.0, 49.0, 12.0, 19.0  # margins in points
NAMED_LEFT, NAMED_RIGHT = 56.0, 16.0  # of a figure that has lanes only
BETWEEN, ABOVE_LANES, UPPER = 15.0, 7.0, 0.7  # rooms between the fields; the temperature's share of the height
STATE_LANE_PT = 19.0  # where there is nothing but lanes
SHORT_S = 1.0
WIDE_JOINT = 3.0  # times what can just be seen: from there on a joint is shaded over the full height
RARE = 0.02  # samples that may lie in the coarse part of a scale


def figure_svg(trace: Trace, form: Format) -> str:
    """The figure as an SVG document: the same trace gives the same bytes."""
    return svg_text(draw(trace, form))


def draw(trace: Trace, form: Format) -> Drawing:
    """The figure."""
    lanes = lanes_of(trace, form)
    drawing = Drawing(form.width_pt, height_pt(trace, lanes, form))
    if trace.states:
        _states(drawing, trace, lanes, form)
        return drawing
    temperature, power, lane = panels(drawing, trace, lanes, form)
    marks = [*time_marks(trace.grid.t0_utc_us, trace.start, trace.end, form.time_marks)]
    moments = [place for place, _ in marks]
    _temperature(temperature, trace, moments)
    _power(power, trace, moments)
    lane.ruled(moments)
    draw_lanes(lane, lanes, trace)
    lane.timed(marks)
    return drawing


def height_pt(trace: Trace, lanes: list[Lane], form: Format) -> float:
    """How high a figure of this trace is."""
    return STATE_LANE_PT * len(lanes) + 30 if trace.states else form.height_pt + LANE_PT * len(lanes)


def panels(drawing: Drawing, trace: Trace, lanes: list[Lane], form: Format) -> tuple[Panel, Panel, Panel]:
    """The fields of temperature, power and lanes, from top to bottom."""
    width, low = form.width_pt - LEFT - RIGHT, LANE_PT * len(lanes)
    room = drawing.height - TOP - BOTTOM - low - BETWEEN - ABOVE_LANES
    x = Scale(trace.start, trace.end, LEFT, LEFT + width)
    heights = [UPPER * room, (1 - UPPER) * room, low]
    tops = [TOP, TOP + heights[0] + BETWEEN, TOP + room + BETWEEN + ABOVE_LANES]
    temperature, power, lane = (
        Panel(drawing, form, LEFT, top, width, height, x, Scale(0.0, 1.0, top + height, top))
        for top, height in zip(tops, heights, strict=True)
    )
    values = _values(trace)
    low_c, high_c = _range(values, least=20)
    knee = _knee(np.concatenate(values[:2]), values[2:], low_c, high_c)
    known = _known(trace.power)
    most = max(100.0, 1.08 * float(known.max())) if len(known) else 1000.0
    return temperature.scaled(low_c, high_c, knee), power.scaled(0.0, most), lane


def _states(drawing: Drawing, trace: Trace, lanes: list[Lane], form: Format) -> None:
    """The figure of a station that tells no temperature."""
    width, high = form.width_pt - NAMED_LEFT - NAMED_RIGHT, STATE_LANE_PT * len(lanes)
    x, y = Scale(trace.start, trace.end, NAMED_LEFT, NAMED_LEFT + width), Scale(0.0, 1.0, 7.0 + high, 7.0)
    panel = Panel(drawing, form, NAMED_LEFT, 7.0, width, high, x, y)
    marks = [*time_marks(trace.grid.t0_utc_us, trace.start, trace.end, form.time_marks)]
    panel.ruled([place for place, _ in marks])
    draw_lanes(panel, lanes, trace)
    panel.timed(marks)


def _values(trace: Trace) -> list[Floats]:
    """What the temperature's scale must hold: readings, those on the work, settings, limits."""
    external = np.empty(0) if trace.air is None else _known(trace.air.external)
    return [trace.temperature, external, _known(trace.setting), *(np.array(limit.celsius) for limit in trace.limits)]


def _known(values: Floats) -> Floats:
    return values[~np.isnan(values)]


def _temperature(panel: Panel, trace: Trace, moments: list[float]) -> None:
    low, high, knee = panel.y.low, panel.y.high, panel.y.knee
    values = round_marks(low, high, 5) if knee is None else _bent_marks(low, knee, high)
    _ground(panel, trace, moments, values)
    _joints(panel, trace)
    _curve(panel, _thinned(trace, trace.temperature, panel.form), style.TEMPERATURE, style.TEMPERATURE_BAND, "temperature")
    labels: list[Label] = []
    known = _known(trace.setting)
    if len(known):
        _setting(panel, trace)
        labels.append((float(known[-1]), f"set {known[-1]:g}", style.SETTING))
    labels += _limits(panel, trace)
    labels += _external(panel, trace)
    of_work = any(text == "work" for _, text, _ in labels)
    panel.headed(f"{'Tip' if trace.air is None else 'Air'} temperature in °C{', and that of the work' * of_work}")
    panel.labelled(labels)


def _joints(panel: Panel, trace: Trace) -> None:
    """A bar at the foot for each joint, wide enough to be seen; a higher one where the tip was not back before the next."""
    least = least_seen_s(trace, panel.form)
    for word, colour in style.JOINT_COLOURS.items():
        spans = merged((span for span in trace.joints if span.word == word), least)
        ends = [panel.x.at([one.start, one.end]).tolist() for one in (widened(span, least) for span in spans)]
        high = style.JOINT_HEIGHTS[word]
        panel.drawing.fields([(a, panel.bottom - high, b - a, high) for a, b in ends], colour, f"joint {word}")


def _bent_marks(low: float, knee: float, high: float) -> list[float]:
    """Marks above the knee, and below it a few that are not too near to it."""
    return [*(one for one in round_marks(low, knee, 2) if one <= knee - 0.3 * (knee - low)), *round_marks(knee, high, 5)]


def _limits(panel: Panel, trace: Trace) -> list[Label]:
    """The limits as steps; each label is that of what was in force at the end."""
    for limit in trace.limits:
        seconds, celsius = [*limit.seconds, max(trace.end, limit.seconds[-1])], [*limit.celsius, limit.celsius[-1]]
        panel.drawing.line(*_steps(panel.x.at(seconds), panel.y.at(celsius)), style.LINES[limit.side], limit.side)
    return [
        (limit.celsius[-1], f"{limit.side} {limit.celsius[-1]:g}", style.ALARM)
        for limit in trace.limits
        if not np.isnan(limit.celsius[-1])
    ]


def _steps(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Each value holds until the next."""
    return np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]


def _external(panel: Panel, trace: Trace) -> list[Label]:
    """The thermocouple on the work of hot air, where there is one."""
    if trace.air is None or np.isnan(trace.air.external).all():
        return []
    curve = _thinned(trace, trace.air.external, panel.form)
    _curve(panel, curve, style.EXTERNAL, style.EXTERNAL_BAND, "external")
    return [(float(_known(trace.air.external)[-1]), "work", style.EXTERNAL)]


def _setting(panel: Panel, trace: Trace) -> None:
    """A dot at each reading, and a thin line between two that are equal; nothing beyond the last, nor across an outage."""
    curve = envelope(trace.seconds, trace.setting, panel.form.stretches, SETTING_JOINED_S)
    if not curve.whole:
        panel.drawing.line(*_steps(panel.x.at(curve.seconds), panel.y.at(curve.high)), style.LINES["set"], "set")
        return
    outages = np.array([gap.start for gap in trace.gaps if gap.seconds >= SHORT_S])
    over = np.diff(np.searchsorted(outages, curve.seconds)) > 0  # nothing was read in between
    changes = np.flatnonzero((np.diff(curve.mean) != 0) | over) + 1  # NaN differs from everything
    seconds, celsius = np.insert(curve.seconds, changes, np.nan), np.insert(curve.mean, changes, np.nan)
    panel.drawing.line(panel.x.at(seconds), panel.y.at(celsius), style.LINES["set"], "set")
    if np.count_nonzero(~np.isnan(curve.mean)) <= panel.form.most_dots:
        panel.drawing.dots(panel.x.at(curve.seconds), panel.y.at(curve.mean), 1.8, style.SETTING, "set")


def _power(panel: Panel, trace: Trace, moments: list[float]) -> None:
    values = round_marks(panel.y.low, panel.y.high, 3)
    _ground(panel, trace, moments, values)
    curve = _thinned(trace, trace.power, panel.form)
    if curve.whole:
        ground = np.full(len(curve.seconds), panel.bottom)
        panel.drawing.area(panel.x.at(curve.seconds), ground, panel.y.at(curve.high), style.POWER_BAND, of="power")
    _curve(panel, curve, style.POWER, style.POWER_BAND, "power")
    panel.headed("Power in ‰")
    known = _known(trace.power)
    if len(known):
        panel.labelled([(float(known.max()), f"max {known.max():g}", style.POWER)])


def _thinned(trace: Trace, values: Floats, form: Format) -> Envelope:
    return envelope(trace.seconds, values, form.stretches, JOINED_PERIODS * trace.period_s)


def _curve(panel: Panel, curve: Envelope, colour: str, band: str, of: str) -> None:
    """The mean as a line within the band from least to greatest; what stands alone as a dot or a bar."""
    x, y, alone = panel.x.at(curve.seconds), panel.y.at(curve.mean), lone(curve)
    at = panel.x.at(alone.seconds)
    if not curve.whole:
        panel.drawing.area(x, panel.y.at(curve.low), panel.y.at(curve.high), band, Stroke(colour, 0.25), of)
        panel.drawing.bars(at, panel.y.at(alone.low), panel.y.at(alone.high), Stroke(band, 0.8), of)
    panel.drawing.line(x, y, Stroke(colour, 0.9), of)
    panel.drawing.dots(at, panel.y.at(alone.mean), 1.1, colour, of)


def _range(parts: Sequence[Floats], least: float) -> tuple[float, float]:
    """Bottom and top that hold every value, with a little air."""
    values = np.concatenate([_known(part) for part in parts])
    if not len(values):
        return 0.0, 400.0
    low, high = float(values.min()), float(values.max())
    air = max(0.06 * (high - low), (least - (high - low)) / 2, 2.0)
    return low - air, high + air


def _knee(temperature: Floats, lines: Sequence[Floats], low: float, high: float) -> float | None:
    """The temperature under which a coarser scale does no harm: few samples, no line, and most of the height."""
    known = _known(temperature)
    if not len(known):
        return None
    floor = min(float(_known(part).min()) for part in (np.quantile(known, [RARE]), *lines) if len(_known(part)))
    knee = 10 * np.floor((floor - 5) / 10)
    return float(knee) if high - knee < 0.5 * (high - low) else None


def _ground(panel: Panel, trace: Trace, moments: list[float], values: list[float]) -> None:
    """What lies beneath the curves: the coarser part, joints, alarms and errors, hair lines, then gaps over the full height.

    A gap that is shorter than both `SHORT_S` and what can be seen is left to the lane below: a hundred single lost
    readings would hide the curve that they leave nearly whole.
    """
    coarser = 0.0 if panel.y.knee is None else panel.bottom - panel.y.place(panel.y.knee)
    if coarser:
        panel.drawing.field(panel.left, panel.bottom - coarser, panel.width, coarser, style.COARSER_TINT)
    least = least_seen_s(trace, panel.form)
    for joint in trace.joints:
        if joint.seconds > WIDE_JOINT * least:
            panel.shaded(joint, style.JOINT_TINT, of="joint")
    for mark in trace.marks:
        panel.shaded(widened(mark.span, least), style.MARK_TINTS[mark.kind], of="mark")
    panel.ruled(moments, values)
    for gap in merged((gap for gap in trace.gaps if gap.seconds >= min(SHORT_S, least)), least):
        hatch = style.hatch(gap.word, gap.seconds > 4 * least)
        panel.shaded(widened(gap, least), style.NO_DATA_TINT if hatch else style.NO_DATA, hatch, of="gap")
    panel.numbered(values)
    panel.framed()
    if coarser:
        base = panel.bottom - coarser / 2 + 0.36 * panel.form.font_pt
        panel.drawing.words(panel.right - 3, base, "coarser scale", panel.form.font_pt, style.QUIET, align="right")
