"""One port of a run as curves and spans on one time axis; hot air and states among them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis.verdict.samples import Step, Unstepped
from jbclog.core.rows import StationFacts
from jbclog.report.facts import AirFacts, StatesFacts

# -- envelope -----------------------------------------------------------------------------------------------------------------
# Fewer points than samples, and still every excursion: the least and the greatest of each stretch are kept.
#
# A run of eight hours has 288 000 samples a port and a page some 900 columns. The samples are cut into as many stretches of
# equal time, and of each are kept its least, its greatest and its mean value. Nothing is joined across a gap.

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Envelope:
    """A curve to draw. NaN breaks the line. `low`, `high` and `mean` are the same array where nothing was left out."""

    seconds: Floats
    low: Floats
    high: Floats
    mean: Floats

    @property
    def whole(self) -> bool:
        """Whether every sample is in the drawing."""
        return self.low is self.high


def envelope(seconds: Floats, values: Floats, stretches: int, joined_s: float) -> Envelope:
    """The curve of `values` (NaN: none) over `seconds`, at most `stretches` × 2 points wide.

    Samples further apart than `joined_s` are not joined by a line.
    """
    there = ~np.isnan(values)
    at, value = seconds[there], values[there]
    if len(at) <= 2 * stretches:
        return _every_sample(at, value, joined_s)
    width = (at[-1] - at[0]) / stretches
    number = np.minimum(((at - at[0]) / width).astype(np.int64), stretches - 1)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(np.append(first, len(number)))
    middle = (at[first] + at[np.append(first[1:], len(at)) - 1]) / 2
    low, high = np.minimum.reduceat(value, first), np.maximum.reduceat(value, first)
    mean = np.add.reduceat(value, first) / counts
    gaps = np.flatnonzero(np.diff(number[first]) > max(1.0, np.ceil(joined_s / width)))
    return _broken(middle, low, high, mean, gaps)


def _every_sample(at: Floats, value: Floats, joined_s: float) -> Envelope:
    gaps = np.flatnonzero(np.diff(at) > joined_s)
    seconds, drawn = _insert(at, gaps, at), _insert(value, gaps, None)
    return Envelope(seconds, drawn, drawn, drawn)


def _broken(middle: Floats, low: Floats, high: Floats, mean: Floats, gaps: NDArray[np.int64]) -> Envelope:
    return Envelope(_insert(middle, gaps, middle), _insert(low, gaps, None), _insert(high, gaps, None), _insert(mean, gaps, None))


def _insert(values: Floats, gaps: NDArray[np.int64], times: Floats | None) -> Floats:
    """A point behind each gap's first edge: NaN, or for times the edge itself."""
    return np.insert(values, gaps + 1, np.nan if times is None else times[gaps])


def lone(curve: Envelope) -> Envelope:
    """Only the points that no line reaches, because there is nothing on either side of them: to be drawn as dots."""
    absent = np.isnan(curve.mean)
    before, after = np.append(True, absent[:-1]), np.append(absent[1:], True)
    alone = ~absent & before & after
    return Envelope(curve.seconds[alone], curve.low[alone], curve.high[alone], curve.mean[alone])


# -- spans --------------------------------------------------------------------------------------------------------------------
# Stretches of time: where there is no data and why, what the tool's status was, where something was wrong.


@dataclass(frozen=True, slots=True)
class Span:
    """From `start` to `end`, seconds of the run, and the word for what held."""

    start: float
    end: float
    word: str

    @property
    def seconds(self) -> float:
        return self.end - self.start


def runs(seconds: Floats, words: Sequence[str | None] | NDArray[np.object_], period_s: float) -> list[Span]:
    """Consecutive samples with the same word; None and a missing tick end a span. Each lasts to the tick after its last."""
    codes, names = _coded(words)
    if not len(codes):
        return []
    breaks = (np.diff(codes) != 0) | (np.diff(seconds) > 1.5 * period_s)
    first = np.append(0, np.flatnonzero(breaks) + 1)
    last = np.append(first[1:], len(codes)) - 1
    return [
        Span(float(seconds[a]), float(seconds[b]) + period_s, names[codes[a]])
        for a, b in zip(first, last, strict=True)
        if codes[a] >= 0
    ]


def _coded(words: Sequence[str | None] | NDArray[np.object_]) -> tuple[NDArray[np.int64], list[str]]:
    """Numbers for words, so that a comparison costs nothing; -1 for None."""
    names: dict[str, int] = {}
    codes = [-1 if word is None else names.setdefault(word, len(names)) for word in words]
    return np.array(codes, dtype=np.int64), list(names)


def missing_ticks(seconds: Floats, period_s: float, word: str = "skipped") -> list[Span]:
    """Where ticks have no rows at all: the host stood still."""
    edges = np.flatnonzero(np.diff(seconds) > 1.5 * period_s)
    return [Span(float(seconds[i]) + period_s, float(seconds[i + 1]), word) for i in edges]


def merged(spans: Iterable[Span], nearer_than_s: float) -> list[Span]:
    """Spans of the same word that are too close to be told apart on paper, as one."""
    out: list[Span] = []
    for span in sorted(spans, key=lambda span: (span.start, span.end, span.word)):
        if out and out[-1].word == span.word and span.start - out[-1].end < nearer_than_s:
            out[-1] = replace(out[-1], end=max(out[-1].end, span.end))
        else:
            out.append(span)
    return out


def widened(span: Span, least_s: float) -> Span:
    """The span, wide enough to be seen."""
    lacking = max(0.0, least_s - span.seconds) / 2
    return replace(span, start=span.start - lacking, end=span.end + lacking)


def within(spans: Iterable[Span], start: float, end: float) -> list[Span]:
    """What of the spans lies between `start` and `end`."""
    cut = [replace(span, start=max(span.start, start), end=min(span.end, end)) for span in spans]
    return [span for span in cut if span.seconds > 0]


# -- states -------------------------------------------------------------------------------------------------------------------
# What a station without a temperature tells: states, as lanes on the time axis and as figures of how long each held.

STATE_COLUMNS = ("solder_shortage", "clogged", "preparing", "in_range")
SOLDER, CONTROL, TEMPERATURE = "solder", "control", "temperature"
SHORTAGE, CLOGGED, BOTH = "shortage", "clogged", "both"
OK, PREPARING, READY, IN_RANGE, OUT_OF_RANGE = "ok", "preparing", "ready", "in range", "out of range"


def is_any_told(samples: pd.DataFrame) -> list[bool]:
    """For each row, whether any state was read."""
    return [bool(there) for there in samples[list(STATE_COLUMNS)].notna().any(axis=1)]


def state_lanes(samples: pd.DataFrame, seconds: Floats, period_s: float) -> dict[str, list[Span]]:
    """The lanes by name, each with a word for what held; nothing where it was not read."""
    short, clogged = (_flags(samples, name) for name in ("solder_shortage", "clogged"))
    solder = [_solder(one, other) for one, other in zip(short, clogged, strict=True)]
    control = [_flag_word(one, PREPARING, READY) for one in _flags(samples, "preparing")]
    warm = [_flag_word(one, IN_RANGE, OUT_OF_RANGE) for one in _flags(samples, "in_range")]
    words = {SOLDER: solder, CONTROL: control, TEMPERATURE: warm}
    return {name: runs(seconds, these, period_s) for name, these in words.items()}


def states_facts(lanes: Mapping[str, list[Span]]) -> StatesFacts:
    """How long each state held that is not as it should be, in seconds; None where it was never read."""
    return StatesFacts(
        shortage_s=_seconds(lanes[SOLDER], SHORTAGE, BOTH),
        clogged_s=_seconds(lanes[SOLDER], CLOGGED, BOTH),
        preparing_s=_seconds(lanes[CONTROL], PREPARING),
        out_of_range_s=_seconds(lanes[TEMPERATURE], OUT_OF_RANGE),
    )


def _seconds(spans: list[Span], *words: str) -> float | None:
    return float(np.sum([span.seconds for span in spans if span.word in words])) if spans else None


def _flags(samples: pd.DataFrame, name: str) -> list[bool | None]:
    return [None if pd.isna(flag) else bool(flag) for flag in samples[name].astype(object)]


def _flag_word(flag: bool | None, yes: str, no: str) -> str | None:
    return None if flag is None else yes if flag else no


def _solder(short: bool | None, clogged: bool | None) -> str | None:
    if short is None or clogged is None:
        return None
    return {(False, False): OK, (True, False): SHORTAGE, (False, True): CLOGGED, (True, True): BOTH}[short, clogged]


# -- air ----------------------------------------------------------------------------------------------------------------------
# What hot air tells beside its temperature: the thermocouple on the work, the flow, cooling and suction.

SIGNAL = "external_c"
AIR_COLUMNS = ("cooling", "desoldering", SIGNAL, "set_flow_permille")
FLOW, SUCTION, COOLING, OFF = "flow", "suction", "cooling", "off"
AWAY = ("disconnected", "robot_off")
FLOW_JOINED_S = 15.0  # it is due each 5 s; two losses are bridged in the drawing, and only there


def tells_air(facts: StationFacts) -> bool:
    """Whether it is a hot air station, by the signals that it has."""
    return SIGNAL in facts.signals


@dataclass(frozen=True, slots=True)
class Air:
    """On the rows and the time axis of a trace: °C on the work (NaN where nothing was read), and the lanes by name."""

    external: Floats
    lanes: dict[str, list[Span]]

    def between(self, rows: np.ndarray[tuple[int], np.dtype[np.bool_]], start: float, end: float) -> Air:
        """The part of these `rows`, from `start` to `end`."""
        lanes = {name: within(spans, start, end) for name, spans in self.lanes.items()}
        return Air(self.external[rows], {name: spans for name, spans in lanes.items() if spans})


def air_of(samples: pd.DataFrame, seconds: Floats, period_s: float) -> Air:
    """What the rows of one port tell of its air."""
    sucking = [SUCTION if flag is True else None for flag in _flags(samples, "desoldering")]
    lanes = {FLOW: _flow(samples, seconds, period_s), SUCTION: runs(seconds, sucking, period_s)}
    return Air(_floats(samples[SIGNAL]), {name: spans for name, spans in lanes.items() if spans})


def status_words(samples: pd.DataFrame) -> list[str | None]:
    """The status as read, and cooling where that is what an off tool does."""
    words = samples["status"].astype(object)
    return [_word(word, cools) for word, cools in zip(words, _flags(samples, "cooling"), strict=True)]


def air_facts(air: Air) -> AirFacts:
    """The figures of one port's air."""
    known, flow = air.external[~np.isnan(air.external)], air.lanes.get(FLOW, [])
    return AirFacts(
        flow_permille=float(flow[-1].word.removesuffix(" ‰")) if flow else None,
        external_least_c=float(known.min()) if len(known) else None,
        external_greatest_c=float(known.max()) if len(known) else None,
        suctions=len(air.lanes.get(SUCTION, [])),
    )


def _word(word: object, cools: bool | None) -> str | None:
    if pd.isna(word):  # type: ignore[call-overload]  # one cell
        return None
    return COOLING if word == OFF and cools else str(word)


def _flow(samples: pd.DataFrame, seconds: Floats, period_s: float) -> list[Span]:
    """Where the flow was read, joined between two equal readings that are near enough; not across an outage."""
    flow = _floats(samples["set_flow_permille"])
    read = ~np.isnan(flow)
    outages = np.cumsum(samples["quality"].astype(object).isin(AWAY).to_numpy(dtype=bool))[read]
    told = zip(seconds[read], flow[read], strict=True)
    spans = [Span(float(at), float(at) + period_s, f"{value:.0f} ‰") for at, value in told]
    edges = [0, *(np.flatnonzero(np.diff(outages)) + 1), len(spans)]
    return [span for a, b in pairwise(edges) for span in merged(spans[a:b], FLOW_JOINED_S)]


def _floats(column: pd.Series[int]) -> Floats:
    return np.asarray(column.to_numpy(dtype=np.float64, na_value=np.nan), dtype=np.float64)


# -- trace --------------------------------------------------------------------------------------------------------------------

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
