"""Solder wire of a soldering feeder (ALE): wire per joint, delivery of the set length, speed, and
suspected clogging.

Figures come from the counters dispensed_mm and dispensed_cycles (R-DLx, R-DCx), the feeder's
settings and the motor's state (R-PSx). *Wire* and *feeds* are the last reading of the counter minus
the first. *Wire per joint* is wire divided by the joints found between these two readings, *wire
per feed* is wire divided by feeds, and *delivered* is wire per feed as a share of the set length.
*Speed* is wire divided by the time in which the motor was seen pushing between the two readings; it
needs `LEAST_READINGS` of them. *Clogging suspected* is how many times the motor was seen pushing
for `PUSHED_S` or more between two readings of the length that show no progress; it is a suspicion,
because the station reports only whether its own detection is on.

A counter that decreased was reset and gives no figure. No manual states whether wire that is drawn
back counts; it may affect the lengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jbclog.analysis.joints.figure import Figure, no_figure
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Series
from jbclog.analysis.port_data import Floats

LEAST_READINGS = 10
PUSHED_S = 1.0
LENGTH_RESOLUTION_MM = 0.1
BESIDE_S = 2.0
NAMES = (
    ("wire_mm", "mm"),
    ("wire_feeds", "count"),
    ("wire_per_joint_mm", "mm"),
    ("wire_per_feed_mm", "mm"),
    ("wire_delivered_percent", "%"),
    ("wire_speed_mm_s", "mm/s"),
    ("wire_clog_suspicions", "count"),
)


@dataclass(frozen=True, slots=True)
class Wire:
    """The feeder's counter of lengths in mm, by seconds of the run's grid, and the set length in mm
    (None: not known).
    """

    length_s: Floats
    length_mm: Floats
    set_length_mm: float | None = None


def wire_figures(series: Series, wire: Wire | None, joints: Sequence[Joint]) -> list[Figure]:
    """Return all figures of the wire, without values if there is no feeder."""
    if wire is None or series.feeding is None:
        return [no_figure(name, unit, "The tool has no feeder.") for name, unit in NAMES]
    length = counter_growth("wire_mm", "mm", wire.length_mm, LENGTH_RESOLUTION_MM)
    feeds = feeds_counted(series)
    each = _ratio("wire_per_feed_mm", "mm", length, feeds)
    return [
        length,
        feeds,
        _per_joint(series, wire, joints, length),
        each,
        _delivered(each, wire.set_length_mm),
        _speed(series, wire, length),
        _clogs(series, wire),
    ]


def feeds_counted(series: Series) -> Figure:
    """Return the growth of the counter of feeds."""
    return counter_growth(
        "wire_feeds", "count", np.empty(0) if series.cycles is None else series.cycles.counted, 1.0
    )


def counter_growth(name: str, unit: str, counter: Floats, resolution: float) -> Figure:
    """Return the growth of a counter, without a value if it was reset."""
    if len(counter) < 2:
        return no_figure(name, unit, "The counter was read less than twice.", len(counter))
    if (np.diff(counter) < 0).any():
        return no_figure(name, unit, "The counter went down: it was reset.", len(counter))
    return Figure(name, float(counter[-1] - counter[0]), unit, len(counter), 100.0, resolution)


def _ratio(name: str, unit: str, over: Figure, under: Figure) -> Figure:
    if over.value is None or under.value is None:
        return no_figure(name, unit, over.why or under.why or "")
    if not under.value:
        return no_figure(name, unit, "Nothing was fed.")
    return Figure(
        name,
        over.value / under.value,
        unit,
        round(under.value),
        100.0,
        (over.resolution or 0.0) / under.value,
    )


def _per_joint(series: Series, wire: Wire, joints: Sequence[Joint], length: Figure) -> Figure:
    name, unit = "wire_per_joint_mm", "mm"
    if length.value is None:
        return no_figure(name, unit, length.why or "")
    start, end = counter_span(series, wire.length_s)
    window = series.window(series.rows.temperature, start, end)
    if window.gap:
        return no_figure(
            name, unit, f"{window.gap} Joints in it are not known.", 0, window.coverage
        )
    count = sum(start <= draw.start_s < end for draw in joints)
    if not count:
        return no_figure(
            name,
            unit,
            "No joints were found between the readings of the counter.",
            0,
            window.coverage,
        )
    return Figure(
        name, length.value / count, unit, count, window.coverage, LENGTH_RESOLUTION_MM / count
    )


def counter_span(series: Series, counter_s: Floats) -> tuple[float, float]:
    """Return the first and last moment of a counter, moved to the first and last row if it was read
    just outside them.
    """
    first, last = float(counter_s[0]), float(counter_s[-1])
    if not len(series.seconds):
        return first, last
    row, final = float(series.moments[0]), float(series.moments[-1])
    return (row if row - BESIDE_S <= first < row else first), (
        final if final < last <= final + BESIDE_S else last
    )


def _delivered(each: Figure, set_length_mm: float | None) -> Figure:
    name = "wire_delivered_percent"
    if each.value is None or not set_length_mm:
        return no_figure(name, "%", each.why or "The length of a feed is not known.", each.n)
    return Figure(
        name,
        100 * each.value / set_length_mm,
        "%",
        each.n,
        each.coverage,
        100 * (each.resolution or 0.0) / set_length_mm,
    )


def _speed(series: Series, wire: Wire, length: Figure) -> Figure:
    name, unit = "wire_speed_mm_s", "mm/s"
    if length.value is None or series.feeding is None:
        return no_figure(name, unit, length.why or "")
    motor = series.window(series.feeding, *counter_span(series, wire.length_s))
    pushing = int(motor.values.sum())
    if motor.gap or pushing < LEAST_READINGS:
        why = (
            motor.gap
            or f"The motor was seen pushing in {pushing} readings; it takes {LEAST_READINGS}."
        )
        return no_figure(name, unit, why, pushing, motor.coverage)
    speed = length.value / (pushing * series.period_s)
    return Figure(name, speed, unit, pushing, motor.coverage, speed / pushing)


def _clogs(series: Series, wire: Wire) -> Figure:
    name, feeding = "wire_clog_suspicions", series.feeding
    if feeding is None or len(wire.length_mm) < 2:
        return no_figure(
            name, "count", "The counter was read less than twice.", len(wire.length_mm)
        )
    stuck = 0
    for place in np.flatnonzero(np.diff(wire.length_mm) == 0):
        motor = series.window(feeding, float(wire.length_s[place]), float(wire.length_s[place + 1]))
        stuck += bool(motor.values.sum() * series.period_s >= PUSHED_S)
    coverage = series.window(feeding, *counter_span(series, wire.length_s)).coverage
    return Figure(name, float(stuck), "count", len(wire.length_mm) - 1, coverage, 1.0)
