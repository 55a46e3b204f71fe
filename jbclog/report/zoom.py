"""What the page's script draws when a reader looks closer: a port's curves, finer than the figure, as bytes in the page.

The run is cut into equal stretches of time, of each the least and greatest temperature and power as 16-bit numbers, so that no
excursion is lost however far one looks. How many stretches there are is limited so that the page stays small.
"""

from __future__ import annotations

import base64
from typing import Final

import numpy as np

from jbclog.report.facts import Zoom
from jbclog.report.trace import LATE, Floats, Trace

ALL_STRETCHES: Final = 120_000  # of all ports together: 1.3 MB of page
MOST_STRETCHES: Final = 48_000  # of one port: eight hours in steps of 0.6 s
JOINTS_PER_STRETCH: Final = 0.5  # some 10 bytes each: beside the curves' data they stay small
NOTHING: Final = -32768
SERIES: Final = 4  # temperature low and high, power low and high


def most_stretches(ports: int) -> int:
    """How many stretches each of so many ports may have."""
    return min(MOST_STRETCHES, ALL_STRETCHES // max(ports, 1))


def zoom_of(trace: Trace, most: int) -> Zoom | None:
    """The trace in at most so many stretches; None where there is no temperature to look at."""
    if trace.states or np.isnan(trace.temperature).all():
        return None
    count = min(most, len(trace.seconds))
    place = np.minimum(((trace.seconds - trace.start) / (trace.end - trace.start) * count + 1e-6).astype(np.int64), count - 1)
    series = [*_ends(trace.temperature, place, count), *_ends(trace.power, place, count)]
    zero_s = trace.grid.t0_utc_us / 1e6
    data = base64.b64encode(np.concatenate(series).astype("<i2").tobytes()).decode()
    joints = _joints(trace) if len(trace.joints) <= most * JOINTS_PER_STRETCH else ""
    return Zoom(round(zero_s + trace.start, 3), round(zero_s + trace.end, 3), _lines(trace), data, joints)


def _joints(trace: Trace) -> str:
    """``12c.8,1a4.9!``"""
    tenths = [(round(10 * (one.start - trace.start)), round(10 * one.seconds), one.word == LATE) for one in trace.joints]
    return ",".join(f"{max(start, 0):x}.{length:x}{'!' * late}" for start, length, late in tenths)


def _ends(values: Floats, place: np.ndarray[tuple[int], np.dtype[np.int64]], count: int) -> tuple[Floats, Floats]:
    """Least and greatest of each stretch, `NOTHING` where nothing was read."""
    there = ~np.isnan(values)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, place[there], values[there])
    np.maximum.at(high, place[there], values[there])
    read = np.isfinite(low)
    return np.where(read, np.clip(np.floor(low), -1000, 9999), NOTHING), np.where(
        read, np.clip(np.ceil(high), -1000, 9999), NOTHING
    )


def _lines(trace: Trace) -> str:
    """``set 350,high 380``: what was in force at the end."""
    known = trace.setting[~np.isnan(trace.setting)]
    lines = [f"set {known[-1]:g}"] if len(known) else []
    return ",".join([*lines, *(f"{one.side} {one.celsius[-1]:g}" for one in trace.limits if not np.isnan(one.celsius[-1]))])
