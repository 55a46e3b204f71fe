"""The readings of one column, for questions about many windows at once.

`Series.window` answers everything about one window and costs a hundred microseconds; a joint needs
several windows, and a shift has thousands of joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jbclog.analysis.joints.segments import Places
from jbclog.analysis.joints.series import Series
from jbclog.analysis.port_data import Flags, Floats

EPSILON_S = 1e-6


@dataclass(frozen=True, slots=True)
class Track:
    """Seconds and values of the readings, when they were read; `gaps` is the number of gaps before
    each, `area` the integral up to it (trapezoids).
    """

    seconds: Floats
    values: Floats
    gaps: Places
    area: Floats
    gap_s: float

    def first(self, moments: Floats) -> Places:
        """Return the index of the first reading at or after each moment."""
        return np.searchsorted(self.seconds, moments - EPSILON_S)

    def last(self, moments: Floats) -> Places:
        """Return the index after the last reading at or before each moment."""
        return np.searchsorted(self.seconds, moments + EPSILON_S)

    def has_gap(self, starts: Floats, ends: Floats) -> Flags:
        """Return whether there is a gap longer than `gap_s`, or no reading, between each start and
        end.
        """
        if not len(self.seconds):
            return np.ones(len(starts), dtype=np.bool_)
        first, last = self.first(starts), self.last(ends) - 1
        none = last < first
        inner = (
            self.gaps[np.clip(last, 0, None)] - self.gaps[np.clip(first, 0, len(self.gaps) - 1)] > 0
        )
        late = self.seconds[np.clip(first, 0, len(self.seconds) - 1)] - starts > self.gap_s
        early = ends - self.seconds[np.clip(last, 0, None)] > self.gap_s
        return np.asarray(none | inner | late | early, dtype=np.bool_)

    def area_between(self, starts: Floats, ends: Floats) -> Floats:
        """Return the integral from the first reading after each start to the last before its end;
        NaN with fewer than two.
        """
        first, last = self.first(starts), self.last(ends) - 1
        few = last <= first
        top = max(len(self.area) - 1, 0)
        area = (
            self.area[np.clip(last, 0, top)] - self.area[np.clip(first, 0, top)]
            if len(self.area)
            else np.zeros(len(starts))
        )
        return np.asarray(np.where(few, np.nan, area), dtype=np.float64)


def track_of(series: Series, values: Floats) -> Track:
    """Return the readings of one column of a port."""
    is_read = ~np.isnan(values)
    seconds, read = series.moments[is_read], values[is_read]
    steps = np.diff(series.seconds[is_read])
    gaps = np.concatenate(([0], np.cumsum(steps > series.gap_s + EPSILON_S)))
    area = np.concatenate(([0.0], np.cumsum((read[1:] + read[:-1]) / 2 * np.diff(seconds))))
    return Track(seconds, read, gaps[: len(seconds)], area[: len(seconds)], series.gap_s)
