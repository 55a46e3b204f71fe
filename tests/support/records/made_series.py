"""A series of one port made by hand: every value is what the test says, so that the right answer is
known exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jbclog.analysis.joints.series import Series
from jbclog.analysis.verdict.idle import Block

Floats = NDArray[np.float64]
Course = float | Callable[[Floats], Floats]


def made(
    seconds: float,
    temperature: Course = 350.0,
    power: Course = 100.0,
    setting: Course = 350.0,
    hz: float = 10.0,
    **more: object,
) -> Series:
    """`seconds` of a working tool; a course is a number or a function of the seconds. The setting
    is read each five seconds.
    """
    at = np.arange(round(seconds * hz)) / hz
    read = _values(setting, at)
    read[np.arange(len(at)) % max(round(5 * hz), 1) != 0] = np.nan
    rows = Block(
        at, _values(temperature, at), _values(power, at), read, np.ones(len(at), dtype=np.bool_)
    )
    return replace(Series(rows, np.ones(len(at), dtype=np.bool_), 1 / hz), **more)


def _values(course: Course, at: Floats) -> Floats:
    return (
        np.array(course(at), dtype=np.float64)
        if callable(course)
        else np.full(len(at), float(course))
    )


def lose(series: Series, *spans: tuple[float, float]) -> Series:
    """The same with nothing read from the first to before the second moment of each span."""
    lost = np.zeros(len(series.seconds), dtype=np.bool_)
    for start, end in spans:
        lost |= (series.seconds >= start - 1e-9) & (series.seconds < end - 1e-9)
    columns = [
        np.where(lost, np.nan, column)
        for column in (series.rows.temperature, series.rows.power, series.rows.setting)
    ]
    feeding = None if series.feeding is None else np.where(lost, np.nan, series.feeding)
    return replace(
        series,
        rows=Block(series.seconds, *columns, series.rows.working & ~lost),
        known=series.known & ~lost,
        feeding=feeding,
    )


def rest(series: Series, *spans: tuple[float, float]) -> Series:
    """The same with the tool seen resting in these spans."""
    resting = np.zeros(len(series.seconds), dtype=np.bool_)
    for start, end in spans:
        resting |= (series.seconds >= start - 1e-9) & (series.seconds < end - 1e-9)
    return replace(series, rows=replace(series.rows, working=series.rows.working & ~resting))


def steps(*points: tuple[float, float]) -> Callable[[Floats], Floats]:
    """A course that keeps each value from its second on."""
    begins, values = (
        np.array([point[0] for point in points]),
        np.array([point[1] for point in points]),
    )
    return lambda at: values[np.searchsorted(begins, at + 1e-9, side="right") - 1]


def line(*points: tuple[float, float]) -> Callable[[Floats], Floats]:
    """A course through these points."""
    return lambda at: np.interp(at, [point[0] for point in points], [point[1] for point in points])


def joints_at(
    starts: Sequence[float], dwell: float = 1.5
) -> tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]:
    """Temperature and power of a tip of 10 ‰·s/K that gives 500 ‰ for `dwell` and is back 1 s
    later: 100 ‰ hold it at 350 °C.

    It falls by 20 °C in `dwell` while power is 500 ‰ - 200 / dwell above holding, and rises again
    in 1 s at 200 ‰ above it.
    """
    fall = 200.0 / dwell
    temperature = [(0.0, 350.0)]
    power = [(0.0, 100.0)]
    for start in starts:
        temperature += [(start, 350.0), (start + dwell, 330.0), (start + dwell + 1.0, 350.0)]
        power += [
            (start, 100.0 + 500.0 - fall),
            (start + dwell, 300.0),
            (start + dwell + 1.0, 100.0),
        ]
    return line(*temperature, (1e6, 350.0)), steps(*power)
