"""The lanes below the curves (status, missing data, alarms, errors): bars, with words that fit."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Final

from matplotlib.axes import Axes

from jbclog.analysis.figures import style
from jbclog.analysis.figures.axes import LETTER, rectangles, size_pt
from jbclog.analysis.figures.curves import Span, merged, widened, within
from jbclog.analysis.figures.style import Format, Look
from jbclog.analysis.figures.ticks import duration_text
from jbclog.analysis.figures.trace import MarkKind, Trace
from jbclog.core.text import clean

LANE_PT: Final = 11.2
NO_DATA: Final = "no data"
MARKS: Final = {"alarm": MarkKind.ALARM, "doubtful": MarkKind.UNCONFIRMED, "error": MarkKind.ERROR}
"""Lane -> kind of its marks."""


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane: its name and its spans."""

    name: str
    spans: list[Span]


def least_seen_s(trace: Trace, form: Format) -> float:
    """Return the shortest time in s that is visible in a figure of this size."""
    return (trace.end - trace.start) / form.stretches * 1.5


def lanes_of(trace: Trace, form: Format) -> list[Lane]:
    """Return the lane of the status, or those of the states, and the other lanes that have spans.
    Spans too close to each other are merged.
    """
    least = least_seen_s(trace, form)
    states = trace.states or {"status": trace.status} | (
        {} if trace.air is None else trace.air.lanes
    )
    lanes = [Lane(name, _visible(spans, least)) for name, spans in states.items()]
    for name, spans in {NO_DATA: trace.gaps, **marked(trace)}.items():
        seen = within(
            (widened(span, least) for span in merged(spans, least)), trace.start, trace.end
        )
        if seen:
            lanes.append(Lane(name, seen))
    return lanes


def marked(trace: Trace) -> dict[str, list[Span]]:
    """Return the spans of the marks in each lane of `MARKS`."""
    return {
        name: [mark.span for mark in trace.marks if mark.kind is kind]
        for name, kind in MARKS.items()
    }


def _visible(spans: list[Span], least: float) -> list[Span]:
    """Return the spans of a state, then short important ones, widened to be visible."""
    graver = [widened(span, least) for span in spans if span.word in style.ALWAYS_SEEN]
    return [*merged(spans, least), *graver]


def draw_lanes(axes: Axes, lanes: list[Lane], trace: Trace, form: Format) -> None:
    """Draw the lanes from top to bottom, each with its name at the left."""
    axes.spines[:].set_visible(False)
    axes.grid(visible=False, axis="y")
    axes.set_ylim(max(len(lanes), 1), 0)
    axes.set_yticks([row + 0.5 for row in range(len(lanes))], [lane.name for lane in lanes])
    for row, lane in enumerate(lanes):
        _bars(axes, row, lane, trace, form)
        for span in lane.spans:
            _word(axes, row, lane.name, span, trace, form)


def _bars(axes: Axes, row: int, lane: Lane, trace: Trace, form: Format) -> None:
    """Draw the spans of a lane, all of one look as one patch."""
    looks: dict[tuple[str, str | None], list[tuple[float, float, float, float]]] = defaultdict(list)
    for span in lane.spans:
        is_wide = span.seconds > 4 * least_seen_s(trace, form)
        hatch = style.hatch(span.word, is_wide) if lane.name == NO_DATA else None
        left, right = trace.dates([span.start, span.end]).tolist()
        looks[_face(lane.name, span.word, hatch), hatch].append(
            (left, right, row + 0.14, row + 0.86)
        )
    for (face, hatch), places in looks.items():
        rectangles(axes, places, lane.name, facecolor=face, edgecolor=style.NO_DATA, hatch=hatch)


def _face(name: str, word: str, hatch: str | None) -> str:
    if word in style.GRAVE_STATES:
        return style.ERROR
    if name == NO_DATA:
        return style.NO_DATA_TINT if hatch else style.NO_DATA
    return (
        style.MARK_COLOURS[MARKS[name]]
        if name in MARKS
        else style.STATUS_SHADES.get(word, style.OTHER_SHADE)
    )


def _word(axes: Axes, row: int, name: str, span: Span, trace: Trace, form: Format) -> None:
    """Write the word of a span in its middle, with the duration of a gap, if it fits."""
    points, is_gap = form.font_pt - 1, name == NO_DATA
    width = span.seconds / (trace.end - trace.start) * size_pt(axes)[0]
    word = clean(span.word)  # a foreign record can have any word
    texts = [f"{word} {duration_text(span.seconds)}", word] if is_gap else [word]
    text = next((text for text in texts if (len(text) + 1) * LETTER * points <= width), None)
    if text is None:
        return
    is_light = name in MARKS or span.word in style.DARK_STATUS
    middle = float(trace.dates((span.start + span.end) / 2))
    box = {"facecolor": "white", "edgecolor": "none", "pad": 1.0} if is_gap else None
    look: Look = {"fontsize": points, "color": "white" if is_light else style.INK, "bbox": box}
    axes.text(middle, row + 0.5, text, ha="center", va="center_baseline", gid=name, **look)
