"""Colours, hatches and sizes of the figures; `figures.mplstyle` has the rest.

Colours follow Okabe and Ito, which colour-blind readers and grey printers can distinguish. Nothing
depends on colour alone: lines differ in their dashes, spans in their hatching, and each has a label
beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from jbclog.analysis.figures.trace import JointEnd, MarkKind

Look = dict[str, Any]
"""Properties of an artist, as matplotlib takes them."""

INK: Final = "#1c2733"
QUIET: Final = "#5d6b7a"
GRID: Final = "#e3e8ee"
TEMPERATURE: Final = "#0b4f8a"
TEMPERATURE_BAND: Final = "#9cc3e6"
EXTERNAL: Final = "#00785a"
EXTERNAL_BAND: Final = "#9fd6c6"
SETTING: Final = "#1c2733"
ALARM: Final = "#c8400a"
ERROR: Final = "#8a3a77"
UNCONFIRMED: Final = "#b37700"
POWER: Final = "#7a4d00"
POWER_BAND: Final = "#efc98a"
NO_DATA: Final = "#8d99a6"
NO_DATA_TINT: Final = "#f4f6f8"

LINES: Final[dict[str, Look]] = {
    "set": {"color": SETTING, "linewidth": 0.7, "dashes": (3.0, 1.4)},
    "high": {"color": ALARM, "linewidth": 1.1, "dashes": (1.2, 1.4)},
    "low": {"color": ALARM, "linewidth": 1.1, "dashes": (4.4, 1.7, 1.1, 1.7)},
}
"""Properties of the lines of setting and limits, for `Axes.plot`."""

STATUS_SHADES: Final = {
    "working": "#3d5166",
    "on": "#3d5166",
    "stand": "#94a5b5",
    "sleep": "#c3ced8",
    "hibernation": "#e1e7ec",
    "off": "#f1f4f6",
    "cooling": "#c3ced8",
    "suction": "#3d5166",
    "ready": "#c3ced8",
    "preparing": "#3d5166",
    "in range": "#c3ced8",
    "out of range": "#3d5166",
    "ok": "#c3ced8",
}
OTHER_SHADE: Final = "#e1e7ec"  # for words not in this table, such as a flow
GRAVE_STATES: Final = frozenset({"shortage", "clogged", "both"})
ALWAYS_SEEN: Final = frozenset({"suction", *GRAVE_STATES})
DARK_STATUS: Final = frozenset(
    {"working", "on", "suction", "preparing", "out of range", *GRAVE_STATES}
)

# dots would be 40 kB
HATCHES: Final = {
    "disconnected": "xxxx",
    "robot_off": "++++",
    "no_tool": "||||",
    "skipped": "----",
    "no_rows": "----",
}
"""Reason -> hatch, the most severe first."""
HATCH_ELSE: Final = "////"
BETWEEN_REASONS: Final = ", "  # of a gap


def hatch(word: str, wide: bool) -> str | None:
    """Return the hatch of a gap by the most severe of its reasons; None for a sliver."""
    if not wide:
        return None
    reasons = word.split(BETWEEN_REASONS)
    return next((HATCHES[reason] for reason in HATCHES if reason in reasons), HATCH_ELSE)


MARK_COLOURS: Final = {
    MarkKind.ALARM: ALARM,
    MarkKind.UNCONFIRMED: UNCONFIRMED,
    MarkKind.ERROR: ERROR,
}
# behind the curves
MARK_TINTS: Final = {
    MarkKind.ALARM: "#f6ded3",
    MarkKind.UNCONFIRMED: "#f3e8d3",
    MarkKind.ERROR: "#ece0e9",
}
JOINT_COLOURS: Final = {
    JointEnd.BACK: TEMPERATURE,
    JointEnd.CUT_OFF: NO_DATA,
    JointEnd.LATE: ALARM,
}  # drawing order
JOINT_HEIGHTS: Final = {JointEnd.BACK: 4.0, JointEnd.CUT_OFF: 4.0, JointEnd.LATE: 7.0}
JOINT_TINT: Final = "#eaf1f8"
COARSER_TINT: Final = "#f1f3f5"


@dataclass(frozen=True, slots=True)
class Format:
    """A size of a figure: inches, font size in points, and how much fits."""

    name: str
    width_in: float
    height_in: float
    font_pt: float
    stretches: int
    time_marks: int
    most_dots: int  # readings of a setting that are still apart

    @property
    def width_pt(self) -> float:
        return 72 * self.width_in

    @property
    def height_pt(self) -> float:
        return 72 * self.height_in


WIDE: Final = Format("wide", 7.4, 3.5, 7.5, 800, 9, 80)
NARROW: Final = Format("narrow", 3.9, 3.6, 7.5, 400, 5, 40)
