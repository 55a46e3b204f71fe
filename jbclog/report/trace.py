"""One port of a run as curves and spans on one time axis: seconds since the run's zero on the monotonic grid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis.verdict.stepped_clock import Step, Unstepped
from jbclog.report.air import Air, air_of, status_words
from jbclog.report.spans import Span, missing_ticks, runs, within
from jbclog.report.states import is_any_told, state_lanes

Floats = NDArray[np.float64]
JOINED_PERIODS = 1.5  # samples further apart than this are not joined by a line
BACK, LATE, CUT_OFF = "back", "late", "cut off"  # whether the tip was back before the next joint
SETTING_JOINED_S = 15.0  # the setting is due each 5 s; two losses are bridged in the drawing, and only there


@dataclass(frozen=True, slots=True)
class Grid:
    """The run's time axis. `period_s` is None with ``--rate max``: then the rows' UTC stands for it, less its steps."""

    t0_utc_us: int
    period_s: float | None
    steps: tuple[Step, ...] = ()

    def seconds(self, ticks: Floats, utc_us: Floats) -> Floats:
        """Seconds since the run's zero of rows with these ticks and times."""
        if self.period_s:
            return ticks * self.period_s
        if self.steps:
            return Unstepped(self.steps).of(utc_us / 1e6) - self.t0_utc_us / 1e6
        return (utc_us - self.t0_utc_us) / 1e6


@dataclass(frozen=True, slots=True)
class Limit:
    """An alarm limit as it was read back: the moments (seconds) from which it held, and °C; NaN while it was off."""

    side: str  # "high" or "low"
    seconds: tuple[float, ...]
    celsius: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Mark:
    """Something that went wrong: alarm, unconfirmed alarm or error, from its earliest possible moment on."""

    span: Span
    kind: str


@dataclass(frozen=True, slots=True)
class Trace:
    """What a figure shows of one port. Values are NaN where nothing was read."""

    grid: Grid
    period_s: float
    seconds: Floats
    temperature: Floats
    power: Floats
    setting: Floats
    status: list[Span]
    gaps: list[Span]
    limits: Sequence[Limit] = ()
    marks: Sequence[Mark] = field(default_factory=tuple)
    states: Mapping[str, list[Span]] = field(default_factory=dict)  # lanes of a station that tells no temperature
    air: Air | None = None  # of hot air
    joints: Sequence[Span] = ()  # their words are `BACK`, `LATE`, `CUT_OFF`
    reasons: NDArray[np.object_] = field(default_factory=lambda: np.empty(0, dtype=object))  # of each row, or None

    @property
    def start(self) -> float:
        return float(self.seconds[0]) if len(self.seconds) else 0.0

    @property
    def end(self) -> float:
        return float(self.seconds[-1]) + self.period_s if len(self.seconds) else self.period_s

    def between(self, start: float, end: float) -> Trace:
        """The part from `start` to `end`, for a closer look."""
        rows = (self.seconds >= start) & (self.seconds <= end)
        return replace(
            self,
            seconds=self.seconds[rows],
            temperature=self.temperature[rows],
            power=self.power[rows],
            setting=self.setting[rows],
            status=within(self.status, start, end),
            gaps=within(self.gaps, start, end),
            marks=[mark for mark in self.marks if mark.span.end >= start and mark.span.start <= end],
            states={name: within(spans, start, end) for name, spans in self.states.items()},
            air=None if self.air is None else self.air.between(rows, start, end),
            joints=within(self.joints, start, end),
            reasons=self.reasons[rows] if len(self.reasons) else self.reasons,
        )


def trace(samples: pd.DataFrame, grid: Grid, *, of_states: bool = False, of_air: bool = False) -> Trace:
    """The trace of one port from its rows of `samples`, in the order of their ticks.

    `of_states` where it tells no temperature, `of_air` where it is hot air.
    """
    utc = samples["time"].to_numpy(dtype="datetime64[us]").astype(np.int64).astype(np.float64)
    seconds = grid.seconds(_floats(samples["tick"]), utc)
    temperature = _floats(samples["temperature_c"])
    period_s = grid.period_s or _typical(seconds)
    words = samples["quality"].astype(object)
    told = is_any_told(samples) if of_states else ~np.isnan(temperature)
    why = [None if there else _why(word) for there, word in zip(told, words, strict=True)]
    skipped = missing_ticks(seconds, period_s) if grid.period_s else []
    return Trace(
        grid,
        period_s,
        seconds,
        temperature,
        _floats(samples["power_permille"]),
        _floats(samples["set_c"]),
        runs(seconds, status_words(samples) if of_air else _texts(samples["status"]), period_s),
        sorted([*runs(seconds, why, period_s), *skipped], key=lambda span: span.start),
        states=state_lanes(samples, seconds, period_s) if of_states else {},
        air=air_of(samples, seconds, period_s) if of_air else None,
        reasons=_texts(samples["reasons"]) if "reasons" in samples else np.empty(0, dtype=object),
    )


def _texts(column: pd.Series[str]) -> NDArray[np.object_]:
    """The column's texts, None where there is none."""
    texts = column.astype(object)
    return np.asarray(texts.where(texts.notna(), None).to_numpy(), dtype=object)


def _why(quality: str) -> str:
    """The word for a row without a temperature; in a row that is ok it was not due."""
    return "not due" if quality == "ok" else quality


def _typical(seconds: Floats) -> float:
    """The usual step; a run of one row has none and is drawn as a second."""
    return float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0


def _floats(column: pd.Series[int]) -> Floats:
    return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)
