"""Joints found and feeds counted between two readings of the feeder's counter, for the judge (`analysis/verdict/joint_rules.py`).

The counter is read with its time in UTC and the joints stand on the run's grid, so the two fit to `EDGE_S`, and to no better
than the wall clock was stepped: a joint nearer to the first or the last reading is one of which the side is not known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from jbclog.analysis.joints.draw import Draw
from jbclog.analysis.joints.series import Series
from jbclog.analysis.joints.solder_wire import between, feeds_counted
from jbclog.analysis.verdict.evidence import Feeds

EDGE_S: Final = 1.0


def feeds_of(series: Series, draws: Sequence[Draw], stepped_s: float = 0.0) -> Feeds:
    """What was found and counted between the first and the last reading; `stepped_s` is by how much the wall clock was stepped.

    `draws` are the joints by heat alone: those that the feeder helped to find would be held against itself.
    """
    counted = feeds_counted(series)
    if counted.value is None or series.cycles is None:
        return Feeds(0, 0, 0, None, why=counted.why or "")
    start, end = between(series, series.cycles.seconds)
    sides = [start <= draw.start_s < end for draw in draws if _is_near(draw, (start, end), EDGE_S + stepped_s)]
    found = sum(start <= draw.start_s < end for draw in draws)
    return Feeds(found, sum(sides), len(sides) - sum(sides), round(counted.value), _lost_s(series, start, end))


def _is_near(draw: Draw, edges: Sequence[float], slack_s: float) -> bool:
    return any(draw.start_s - slack_s <= edge <= draw.end_s + slack_s for edge in edges)


def _lost_s(series: Series, start: float, end: float) -> float:
    """For how long temperature or power was not read, where there is a gap; single rows that were lost hide no joint."""
    windows = [series.window(column, start, end) for column in (series.rows.temperature, series.rows.power)]
    return max((window.due - window.n) * series.period_s if window.gap else 0.0 for window in windows)
