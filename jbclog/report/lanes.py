"""The lanes under the curves: one row each for status, missing data, alarms and errors, with words where there is room."""

from __future__ import annotations

from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from jbclog.report import style
from jbclog.report.spans import Span, merged, widened, within
from jbclog.report.style import Format
from jbclog.report.timescale import duration_text
from jbclog.report.trace import Trace

CHARACTER = 0.62  # width of a character, in font sizes
LANES = (("no data", None), ("alarm", "alarm"), ("doubtful", "unconfirmed"), ("error", "error"))
MARKED = frozenset(name for name, _ in LANES)


@dataclass(frozen=True, slots=True)
class Lane:
    """A row: its name and its spans."""

    name: str
    spans: list[Span]


def least_seen_s(trace: Trace, form: Format) -> float:
    """The shortest time that is wide enough to be seen in a figure of this size."""
    return (trace.end - trace.start) / form.stretches * 1.5


def lanes_of(trace: Trace, form: Format) -> list[Lane]:
    """Status or states always; the others where there is something to show. Spans that cannot be told apart are one."""
    least = least_seen_s(trace, form)
    states = trace.states or {"status": trace.status} | ({} if trace.air is None else trace.air.lanes)
    lanes = [Lane(name, _seen(spans, least)) for name, spans in states.items()]
    for name, kind in LANES:
        spans = trace.gaps if kind is None else [mark.span for mark in trace.marks if mark.kind == kind]
        seen = within((widened(span, least) for span in merged(spans, least)), trace.start, trace.end)
        if seen:
            lanes.append(Lane(name, seen))
    return lanes


def _seen(spans: list[Span], least: float) -> list[Span]:
    """A state's spans, and over them, wide enough to be seen, those that are short and count."""
    graver = [widened(span, least) for span in spans if span.word in style.ALWAYS_SEEN]
    return [*merged(spans, least), *graver]


def draw_lanes(axes: Axes, lanes: list[Lane], trace: Trace, form: Format) -> None:
    """Draw the lanes from top to bottom."""
    axes.set_ylim(len(lanes), 0)
    axes.set_yticks([row + 0.5 for row in range(len(lanes))], [lane.name for lane in lanes])
    for row, lane in enumerate(lanes):
        for span in lane.spans:
            _bar(axes, row, lane.name, span, hatched=span.seconds > 4 * least_seen_s(trace, form))
            _word(axes, row, lane.name, span, trace, form)


def _bar(axes: Axes, row: int, name: str, span: Span, hatched: bool) -> None:
    place = Rectangle((span.start, row + 0.14), span.seconds, 0.72, lw=0, zorder=2)
    if span.word in style.GRAVE_STATES:
        place.set_facecolor(style.ERROR)
    elif name not in MARKED:
        place.set_facecolor(style.STATUS_SHADES.get(span.word, style.OTHER_SHADE))
    elif name == "no data":
        hatch = style.hatch(span.word, hatched)
        place.set(facecolor=style.NO_DATA_TINT if hatch else style.NO_DATA, edgecolor=style.NO_DATA, hatch=hatch)
    else:
        place.set_facecolor(style.MARK_COLOURS["unconfirmed" if name == "doubtful" else name])
    axes.add_patch(place)


def _word(axes: Axes, row: int, name: str, span: Span, trace: Trace, form: Format) -> None:
    """The span's word in the middle of it, with its duration where data are missing, if there is room for it."""
    room = (form.width_in - 1.18) * 72 * span.seconds / (trace.end - trace.start)
    size = form.font_pt - 1
    longest = [f"{span.word} {duration_text(span.seconds)}"] if name == "no data" else []
    text = next((text for text in (*longest, span.word) if (len(text) + 1) * CHARACTER * size <= room), None)
    if text is None:
        return
    light = (name in MARKED and name != "no data") or span.word in style.DARK_STATUS
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6} if name == "no data" else None
    colour = "white" if light else style.INK
    middle = span.start + span.seconds / 2
    axes.text(middle, row + 0.53, text, ha="center", va="center", fontsize=size, color=colour, zorder=3, bbox=box, clip_on=True)
