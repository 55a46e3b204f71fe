"""The trace of a port from its rows of `samples`: readings, states and hot air; its gaps are those
of the analysis. `JoinedTrace` builds it piece by piece, in a third of the memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis.clock_steps import nominal_period
from jbclog.analysis.figures.curves import (
    Floats,
    GridSeconds,
    Readings,
    Span,
    coded,
    merged,
    runs,
)
from jbclog.analysis.figures.style import BETWEEN_REASONS
from jbclog.analysis.figures.trace import JOINED_PERIODS, Air, Grid, Trace
from jbclog.analysis.gaps import Gap
from jbclog.analysis.verdict import judged_signals
from jbclog.core.rows import StationFacts

COLUMNS = (
    "tick",
    "reasons",
    "temperature_c",
    "power_permille",
    "status",
    "setpoint_c",
)
STATE_COLUMNS = ("solder_shortage", "clogged", "preparing", "in_range")
SOLDER, CONTROL, TEMPERATURE = "solder", "control", "temperature"
SHORTAGE, CLOGGED, BOTH = "shortage", "clogged", "both"
OK = "ok"
PREPARING = "preparing"
READY = "ready"
IN_RANGE = "in range"
OUT_OF_RANGE = "out of range"
SIGNAL = "external_c"
AIR_COLUMNS = ("quality", "cooling", "desoldering", SIGNAL, "set_flow_permille")
FLOW, SUCTION, COOLING, OFF = "flow", "suction", "cooling", "off"
AWAY = ("disconnected", "robot_off")
FLOW_JOINED_S = 15.0  # due every 5 s; two losses are bridged in the drawing only


def columns_of(facts: StationFacts) -> list[str]:
    """Return the columns that a trace needs; on a grid the time of a row is not needed."""
    return [*(() if facts.period_s else ("time",)), *COLUMNS, *own_columns(facts)]


def own_columns(facts: StationFacts) -> list[str]:
    """Return the columns that a trace of this kind of station needs besides `COLUMNS`."""
    columns: list[str] = []
    if has_only_states(facts):
        columns += STATE_COLUMNS
    if has_air(facts):
        columns += AIR_COLUMNS
    return columns


def has_only_states(facts: StationFacts) -> bool:
    """Return whether this station reports states and no temperature."""
    return "temperature_c" not in judged_signals(facts)


def has_air(facts: StationFacts) -> bool:
    """Return whether this is a hot air station, by its signals."""
    return SIGNAL in facts.signals


def trace(
    samples: pd.DataFrame, grid: Grid, *, of_states: bool = False, of_air: bool = False
) -> Trace:
    """Return the trace of one port, without its gaps, from its rows of `samples` in order of their
    ticks.

    `of_states`: the station reports states and no temperature. `of_air`: it is a hot air station.
    """
    seconds = grid.seconds(
        _floats(samples["tick"]), np.empty(0) if grid.period_s else _utc_us(samples["time"])
    )
    temperature = _readings(samples["temperature_c"])
    # a single row is drawn as one second
    period_s = grid.period_s or nominal_period(seconds) or 1.0
    return Trace(
        grid,
        period_s,
        seconds,
        temperature,
        _readings(samples["power_permille"]),
        _readings(samples["setpoint_c"]),
        runs(
            seconds,
            status_words(samples) if of_air else pd.Categorical(samples["status"]),
            period_s,
        ),
        [],
        states=state_lanes(samples, seconds, period_s) if of_states else {},
        air=air_of(samples, seconds, period_s) if of_air else None,
        reasons=_coded(samples["reasons"]) if "reasons" in samples else pd.Categorical([]),
    )


def _utc_us(times: pd.Series[pd.Timestamp]) -> Floats:
    return np.asarray(times.to_numpy(dtype="datetime64[us]").astype(np.int64).astype(np.float64))


def gap_spans(gaps: Iterable[Gap], t0_utc_us: int) -> list[Span]:
    """Return gaps in seconds of the run, each with its reasons."""
    return [
        Span(
            (gap.start_us - t0_utc_us) / 1e6,
            (gap.stop_us - t0_utc_us) / 1e6,
            BETWEEN_REASONS.join(gap.reasons),
        )
        for gap in gaps
    ]


def _coded(column: pd.Series[str]) -> pd.Categorical:
    """Return the texts of a column as categories; none where missing."""
    given = pd.Categorical(column)
    return coded(np.asarray(given.codes, dtype=np.int32), [str(text) for text in given.categories])


def state_lanes(samples: pd.DataFrame, seconds: Floats, period_s: float) -> dict[str, list[Span]]:
    """Return the lanes of states by name; nothing where not read."""
    short, clogged = (_flags(samples, name) for name in ("solder_shortage", "clogged"))
    solder = [_solder(one, other) for one, other in zip(short, clogged, strict=True)]
    control = [_flag_word(one, PREPARING, READY) for one in _flags(samples, "preparing")]
    warm = [_flag_word(one, IN_RANGE, OUT_OF_RANGE) for one in _flags(samples, "in_range")]
    words = {SOLDER: solder, CONTROL: control, TEMPERATURE: warm}
    return {name: runs(seconds, these, period_s) for name, these in words.items()}


def _flags(samples: pd.DataFrame, name: str) -> list[bool | None]:
    return [None if pd.isna(flag) else bool(flag) for flag in samples[name].astype(object)]


def _flag_word(flag: bool | None, yes: str, no: str) -> str | None:
    return None if flag is None else yes if flag else no


def _solder(short: bool | None, clogged: bool | None) -> str | None:
    if short is None or clogged is None:
        return None
    return {
        (False, False): OK,
        (True, False): SHORTAGE,
        (False, True): CLOGGED,
        (True, True): BOTH,
    }[short, clogged]


def air_of(samples: pd.DataFrame, seconds: Floats, period_s: float) -> Air:
    sucking = [SUCTION if flag is True else None for flag in _flags(samples, "desoldering")]
    lanes = {FLOW: _flow(samples, seconds, period_s), SUCTION: runs(seconds, sucking, period_s)}
    return Air(_floats(samples[SIGNAL]), {name: spans for name, spans in lanes.items() if spans})


def status_words(samples: pd.DataFrame) -> list[str | None]:
    """Return the status as read; an off tool that cools is ``cooling``."""
    words = samples["status"].astype(object)
    return [
        _word(word, cools) for word, cools in zip(words, _flags(samples, "cooling"), strict=True)
    ]


def _word(word: object, cools: bool | None) -> str | None:
    if pd.isna(word):  # type: ignore[call-overload]  # one cell
        return None
    return COOLING if word == OFF and cools else str(word)


def _flow(samples: pd.DataFrame, seconds: Floats, period_s: float) -> list[Span]:
    """Return where the flow was read; equal readings close to each other join, not across an
    outage.
    """
    flow = _floats(samples["set_flow_permille"])
    read = ~np.isnan(flow)
    outages = np.cumsum(samples["quality"].astype(object).isin(AWAY).to_numpy(dtype=bool))[read]
    readings = zip(seconds[read], flow[read], strict=True)
    spans = [Span(float(at), float(at) + period_s, f"{value:.0f} ‰") for at, value in readings]
    edges = [0, *(np.flatnonzero(np.diff(outages)) + 1), len(spans)]
    return [span for a, b in pairwise(edges) for span in merged(spans[a:b], FLOW_JOINED_S)]


def _readings(column: pd.Series[int]) -> Readings:
    """Return readings as floats, NaN for a missing one; 16 and 32 bit ones unchanged."""
    if column.dtype == np.float16:
        return np.asarray(column, dtype=np.float16)
    return np.asarray(column, dtype=np.float32) if column.dtype == np.float32 else _floats(column)


def _floats(column: pd.Series[int]) -> Floats:
    return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)


class GrowingColumn:
    """An array that grows in place, in the type that its values need."""

    def __init__(self) -> None:
        self._held = bytearray()
        self._kind: np.dtype[Any] | None = None

    def add(self, values: NDArray[Any]) -> None:
        kind = values.dtype if self._kind is None else np.result_type(self._kind, values.dtype)
        if kind != self._kind and self._held:
            self._held = bytearray(self.array().astype(kind).tobytes())
        self._kind = kind
        self._held += values.astype(kind, copy=False).tobytes()

    def array(self) -> NDArray[Any]:
        """Return all values; nothing may be added while the array is in use."""
        return np.frombuffer(self._held, self._kind or np.float64)


class JoinedTrace:
    """Joins the traces of a port's rows on a grid, oldest first, without states and hot air. No
    piece is empty, unless it is the only one.
    """

    def __init__(self) -> None:
        self._first: Trace | None = None
        self._columns = {name: GrowingColumn() for name in ("temperature", "power", "setting")}
        self._ticks, self._codes = GrowingColumn(), GrowingColumn()
        self._places: dict[str, int] = {}
        self._status: list[Span] = []
        self._last_s = -inf

    def add(self, piece: Trace) -> None:
        """Add the trace of the next rows."""
        if self._first is None:
            self._first = piece.between(inf, inf)
        for name, column in self._columns.items():
            column.add(getattr(piece, name))
        ticks = np.rint(piece.seconds[:] / piece.period_s).astype(np.int64)
        self._ticks.add(_narrow(ticks))
        self._codes.add(self._coded(piece.reasons))
        if len(piece.seconds):
            _add_spans(self._status, piece.status, piece, self._last_s)
            self._last_s = float(piece.seconds[-1])

    def trace(self) -> Trace:
        """Return the trace of all rows."""
        assert self._first is not None
        return replace(
            self._first,
            status=self._status,
            reasons=coded(self._codes.array(), [*self._places]),
            seconds=GridSeconds(self._ticks.array(), self._first.period_s),
            temperature=self._columns["temperature"].array(),
            power=self._columns["power"].array(),
            setting=self._columns["setting"].array(),
        )

    def _coded(self, reasons: pd.Categorical) -> NDArray[np.integer[Any]]:
        """Return the codes of these reasons among those of all pieces."""
        words = [str(word) for word in reasons.categories]
        numbers = [self._places.setdefault(word, len(self._places)) for word in words]
        kind = np.min_scalar_type(-max(len(self._places), 1))
        codes: NDArray[np.integer[Any]] = np.array([*numbers, -1], dtype=kind)
        return codes[np.asarray(reasons.codes)]


def _narrow(ticks: NDArray[np.int64]) -> NDArray[np.signedinteger[Any]]:
    """Return ticks in 32 bits if these hold them."""
    narrow = ticks.astype(np.int32)
    return narrow if np.array_equal(narrow, ticks) else ticks


def _add_spans(found: list[Span], spans: Sequence[Span], piece: Trace, before_s: float) -> None:
    """Add the spans of a piece; one that continues from before `before_s` is merged."""
    first_s, period_s = float(piece.seconds[0]), piece.period_s
    continues = (
        found
        and spans
        and found[-1].end == before_s + period_s
        and spans[0].start == first_s
        and spans[0].word == found[-1].word
        and first_s - before_s <= JOINED_PERIODS * period_s
    )
    if continues:
        found[-1] = found[-1]._replace(end=spans[0].end)
    found += spans[1:] if continues else spans
