"""One port of a run as a figure shows it: curves, spans, limits and marks on its time axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from jbclog.analysis.clock_steps import Step, Unstepped
from jbclog.analysis.figures.curves import (
    Floats,
    Moments,
    Readings,
    Span,
    dates,
    rows_within,
    within,
)

JOINED_PERIODS = 1.5  # no line joins samples further apart than this
# the setting is due every 5 s; two losses are bridged in the drawing only
SETTING_JOINED_S = 15.0


class JointEnd(StrEnum):
    """Whether the tip recovered before the next joint."""

    BACK = "back"
    CUT_OFF = "cut off"
    LATE = "late"


class MarkKind(StrEnum):
    ALARM = "alarm"
    UNCONFIRMED = "unconfirmed"
    ERROR = "error"


@dataclass(frozen=True, slots=True)
class Grid:
    """The time axis of a run. `period_s` is None with ``--rate max``: the axis is then the UTC of
    the rows, corrected for its steps.
    """

    t0_utc_us: int
    period_s: float | None
    steps: tuple[Step, ...] = ()

    def seconds(self, ticks: Floats, utc_us: Floats) -> Floats:
        """Return the seconds of the run for rows with these ticks and times."""
        if self.period_s:
            return ticks * self.period_s
        if self.steps:
            return Unstepped(self.steps).of(utc_us / 1e6) - self.t0_utc_us / 1e6
        return (utc_us - self.t0_utc_us) / 1e6


@dataclass(frozen=True, slots=True)
class Limit:
    """An alarm limit as confirmed: each value (°C) and when it began (s); NaN while off."""

    side: str  # "high" or "low"
    seconds: tuple[float, ...]
    celsius: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Mark:
    """An alarm, an unconfirmed alarm or an error, from its earliest possible time."""

    span: Span
    kind: MarkKind


@dataclass(frozen=True, slots=True)
class Air:
    """Hot air on the rows of a trace: °C of the external thermocouple (NaN: not read), and lanes by
    name.
    """

    external: Readings
    lanes: dict[str, list[Span]]

    def between(self, rows: slice | NDArray[np.bool_], start: float, end: float) -> Air:
        """Return the part of these `rows`, from `start` to `end`."""
        lanes = {name: within(spans, start, end) for name, spans in self.lanes.items()}
        return Air(self.external[rows], {name: spans for name, spans in lanes.items() if spans})


@dataclass(frozen=True, slots=True)
class Trace:
    """One port. Values are NaN where not read."""

    grid: Grid
    period_s: float
    seconds: Moments
    temperature: Readings
    power: Readings
    setting: Readings
    status: list[Span]
    gaps: list[Span]
    limits: Sequence[Limit] = ()
    marks: Sequence[Mark] = field(default_factory=tuple)
    # lanes of a station without a temperature
    states: Mapping[str, list[Span]] = field(default_factory=dict)
    air: Air | None = None  # only for hot air
    joints: Sequence[Span] = ()  # their words are those of `JointEnd`
    # per row; empty: not read
    reasons: pd.Categorical = field(default_factory=lambda: pd.Categorical([]))

    @property
    def start(self) -> float:
        return float(self.seconds[0]) if len(self.seconds) else 0.0

    @property
    def end(self) -> float:
        return float(self.seconds[-1]) + self.period_s if len(self.seconds) else self.period_s

    @property
    def longest_gaps(self) -> list[Span]:
        """The gaps, longest first; gaps of one length in order."""
        return sorted(self.gaps, key=lambda gap: (-round(gap.seconds, 6), gap.start))

    def dates(self, seconds: ArrayLike) -> Floats:
        """Return seconds of the run as matplotlib dates."""
        return dates(self.grid.t0_utc_us, seconds)

    def between(self, start: float, end: float) -> Trace:
        """Return the part from `start` to `end`."""
        rows = rows_within(self.seconds, start, end)
        return replace(
            self,
            seconds=self.seconds[rows],
            temperature=self.temperature[rows],
            power=self.power[rows],
            setting=self.setting[rows],
            status=within(self.status, start, end),
            gaps=within(self.gaps, start, end),
            marks=[
                mark for mark in self.marks if mark.span.end >= start and mark.span.start <= end
            ],
            states={name: within(spans, start, end) for name, spans in self.states.items()},
            air=None if self.air is None else self.air.between(rows, start, end),
            joints=within(self.joints, start, end),
            reasons=self.reasons[rows] if len(self.reasons) else self.reasons,
        )
