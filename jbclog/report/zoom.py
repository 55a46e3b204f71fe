"""The data of the interactive view: the readings of a port, or minimum and maximum of equal
intervals if they are too many.

A page holds at most `MOST_READINGS` of all ports. A port with more rows than its share has the band
of the whole run and single readings around alarms, errors, gaps and joints. The data are a JSON
header and a stream of zigzag varints (as in Protocol Buffers, signed), in base64, for
`templates/interactive.js`. They are not compressed: builds of zlib give different bytes, and the
same record must give the same page.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis.figures.curves import (
    Floats,
    Readings,
    Span,
    Stretches,
    blocks,
    coded,
    rows_before,
)
from jbclog.analysis.figures.lanes import MARKS, NO_DATA, marked
from jbclog.analysis.figures.trace import JOINED_PERIODS, SETTING_JOINED_S, JointEnd, Limit, Trace
from jbclog.core.text import clean
from jbclog.report.captions import closer

Ints = NDArray[np.int64]

# rows of all ports together, some 3 bytes each: four ports for eight hours at 10 Hz
MOST_READINGS: Final = 1_200_000
MOST_SPANS: Final = 120_000  # spans of each lane, of all ports together
LEAST_SPANS: Final = 8_000  # spans of each lane of one port
BAND_SHARE: Final = 8  # an interval costs more than a row: this part of a port's share
AROUND_MARK_S, AROUND_GAP_S, AROUND_JOINT_S = 30.0, 10.0, 15.0
LONG_GAP_S: Final = 1.0
# above every number of a sound record; a browser's numbers are exact to 2^53
BOUND: Final = 2**40
LONGEST_WORD: Final = 140  # three reasons with their columns fit
LONGEST_REASON: Final = 20
VARINTS_AT_ONCE: Final = 1 << 14


def share(ports: int) -> int:
    """Return how many rows each of `ports` ports may have in the page."""
    return MOST_READINGS // max(ports, 1)


def zoom_of(trace: Trace, most: int) -> str | None:
    """Return the data of a port with at most `most` rows; None without a temperature."""
    if trace.states or np.isnan(trace.temperature).all():
        return None
    words, page = _Words(), _in_page(trace, most)
    stream = b"".join(map(varints, _stream(trace, page, words)))
    header = _header(trace, page, words)
    head = json.dumps(header, separators=(",", ":"), allow_nan=False).encode("ascii")
    return base64.b64encode(len(head).to_bytes(4, "little") + head + stream).decode()


@dataclass(frozen=True, slots=True)
class _InPage:
    """The part of a port that is in the page: its rows, the number of intervals of its bands, its
    lanes, and the length of the lanes left out.
    """

    columns: Mapping[str, Readings]
    rows: NDArray[np.bool_]
    stretches: int
    step: float
    lanes: Mapping[str, Sequence[Span]]
    left: Mapping[str, int]
    settings: Sequence[tuple[Span, float]]


def _in_page(trace: Trace, most: int) -> _InPage:
    columns = {"temperature_c": trace.temperature, "power_permille": trace.power}
    if trace.air is not None and not np.isnan(trace.air.external).all():
        columns["external_c"] = trace.air.external
    rows, lanes = _kept(trace, most), _lanes(trace)
    most_spans = max(LEAST_SPANS, most * MOST_SPANS // MOST_READINGS)
    return _InPage(
        columns,
        rows,
        0 if rows.all() else most // BAND_SHARE,
        trace.grid.period_s or 0.001,
        {name: spans for name, spans in lanes.items() if len(spans) <= most_spans},
        {name: len(spans) for name, spans in lanes.items() if len(spans) > most_spans},
        held_settings(trace),
    )


def _stream(trace: Trace, page: _InPage, words: _Words) -> list[Ints]:
    """Return the numbers: rows, their reasons, bands, lanes, settings. Their texts are added to
    `words` in this order.
    """
    columns, kept = page.columns, page.rows
    reasons = (
        trace.reasons[kept]
        if len(trace.reasons)
        else coded(np.full(np.count_nonzero(kept), -1), [])
    )
    stream = _rows(
        np.round((trace.seconds[kept] - trace.start) / page.step),
        [values[kept] for values in columns.values()],
    )
    stream += [_runs(words.reasons(reasons, columns))]
    for values in columns.values() if page.stretches else ():
        stream += _band(trace, values, page.stretches)
    for spans in page.lanes.values():
        stream += [_spans(trace, spans, [words.code(span.word) for span in spans])]
    held = page.settings
    stream += [_spans(trace, [span for span, _ in held], [_whole(celsius) for _, celsius in held])]
    return stream


def _header(trace: Trace, page: _InPage, words: _Words) -> dict[str, object]:
    return {
        "start": round(trace.grid.t0_utc_us / 1e6 + trace.start, 6),
        "seconds": round(trace.end - trace.start, 6),
        "step": page.step,
        "period": round(trace.period_s, 6),
        "joined": round(JOINED_PERIODS * trace.period_s, 6),
        "columns": list(page.columns),
        "rows": int(np.count_nonzero(page.rows)),
        "stretches": page.stretches,
        "parts": [] if not page.stretches else _parts(trace, page.rows),
        "lanes": [[name, len(spans)] for name, spans in page.lanes.items()],
        "left": [[name, length] for name, length in page.left.items()],
        "settings": len(page.settings),
        "limits": _limits(trace),
        "words": words.all,
    }


class _Words:
    """Texts by number, each once, cleaned and cut; 0 is none."""

    def __init__(self) -> None:
        self.all: list[str] = [""]
        self._numbers: dict[str | None, int] = {None: 0}

    def code(self, text: str | None) -> int:
        if text not in self._numbers:
            self._numbers[text] = len(self.all)
            self.all.append(clean(str(text))[:LONGEST_WORD])
        return self._numbers[text]

    def reasons(self, texts: pd.Categorical, columns: Iterable[str]) -> Ints:
        """Return a number for the reasons of each row: ``;power_permille=timeout``, for each of
        these columns that has one.
        """
        names = [*texts.categories, None]
        known = np.zeros(len(texts.categories) + 1, dtype=np.int64)
        for code in pd.unique(texts.codes):  # in order of occurrence
            known[code] = self.code(_reasons(names[code], columns))
        return np.asarray(np.take(known, texts.codes), dtype=np.int64)


def _reasons(text: str | None, columns: Iterable[str]) -> str | None:
    found = dict(part.partition("=")[::2] for part in (text or "").split(";"))
    return (
        "".join(f";{name}={found[name][:LONGEST_REASON]}" for name in columns if name in found)
        or None
    )


def varints(values: Ints) -> bytes:
    """Return each number as a zigzag varint: seven bits per byte, the lowest first, the highest bit
    set if more follow.
    """
    # each number takes some 300 bytes meanwhile
    return b"".join(_varints(values[rows]) for rows in blocks(len(values), VARINTS_AT_ONCE))


def _varints(values: Ints) -> bytes:
    folded = (values << 1) ^ (values >> 63)
    groups = np.stack([folded >> shift for shift in range(0, 49, 7)], axis=1)
    more = np.concatenate([groups[:, 1:] > 0, np.zeros((len(values), 1), dtype=np.bool_)], axis=1)
    there = np.concatenate([np.ones((len(values), 1), dtype=np.bool_), groups[:, 1:] > 0], axis=1)
    return bytes(((groups & 0x7F) | (more << 7)).astype(np.uint8)[there])


def _whole(value: float) -> int:
    return int(np.clip(round(value), -BOUND, BOUND))


def _integers(values: Readings) -> Ints:
    return np.asarray(np.clip(np.round(values.astype(np.float64)), -BOUND, BOUND), dtype=np.int64)


def _steps(values: Ints) -> Ints:
    """Return the difference of each value to the one before it."""
    return np.diff(values, prepend=0)


def _runs(values: Ints) -> Ints:
    """Return the number of runs of equal values, then value and length of each."""
    if not len(values):
        return np.array([0], dtype=np.int64)
    first = np.append(0, np.flatnonzero(np.diff(values)) + 1)
    lengths = np.diff(np.append(first, len(values)))
    return np.concatenate([[len(first)], np.stack([values[first], lengths], axis=1).ravel()])


def _known(values: Readings) -> list[Ints]:
    """Return which values are known, and those as steps."""
    there = ~np.isnan(values)
    return [_runs(there.astype(np.int64)), _steps(_integers(values[there]))]


def _rows(places: Floats, columns: Iterable[Readings]) -> list[Ints]:
    """Return the places of the rows in units of time as runs of equal steps, then each column."""
    return [
        _runs(_steps(_integers(places))),
        *(part for values in columns for part in _known(values)),
    ]


def _band(trace: Trace, values: Readings, count: int) -> list[Ints]:
    """Return the minimum in each of `count` equal intervals of the run, and how far above it the
    maximum is.
    """
    found = Stretches(count)
    for rows in blocks(len(values)):
        there = ~np.isnan(values[rows])
        seconds = trace.seconds[rows][there]
        share_of_run = (seconds - trace.start) / (trace.end - trace.start)
        found.add((share_of_run * count + 1e-6).astype(np.int64), seconds, values[rows][there])
    read = found.counts > 0
    return [
        *_known(np.where(read, found.low, np.nan)),
        _integers(found.high[read]) - _integers(found.low[read]),
    ]


def _kept(trace: Trace, most: int) -> NDArray[np.bool_]:
    """Return the rows that are in the page: all, or those around alarms, errors, gaps and
    joints.
    """
    if len(trace.seconds) <= most:
        return np.ones(len(trace.seconds), dtype=np.bool_)
    kept, budget = np.zeros(len(trace.seconds), dtype=np.bool_), most // 2
    for start, end in _moments(trace):
        rows = rows_before(trace.seconds, start, end)
        wanted = (rows.stop - rows.start) - int(np.count_nonzero(kept[rows]))
        if wanted > budget:
            break
        budget -= wanted
        kept[rows] = True
    return kept


def _moments(trace: Trace) -> Iterator[tuple[float, float]]:
    """Yield the times for which single readings are kept, the most severe first."""
    for kind in MARKS.values():
        for mark in trace.marks:
            if mark.kind is kind:
                yield (
                    mark.span.start - AROUND_MARK_S,
                    min(mark.span.end, mark.span.start + AROUND_MARK_S) + AROUND_MARK_S,
                )
    near = closer(trace)
    if near is not None:
        yield near[0].start, near[0].end
    for gap in trace.longest_gaps:
        if gap.seconds >= LONG_GAP_S:
            yield gap.start - AROUND_GAP_S, gap.start + AROUND_GAP_S
            yield gap.end - AROUND_GAP_S, gap.end + AROUND_GAP_S
    for joint in trace.joints:
        if joint.word == JointEnd.LATE:
            yield joint.start - AROUND_JOINT_S, joint.end + AROUND_JOINT_S


def _parts(trace: Trace, kept: NDArray[np.bool_]) -> list[list[float]]:
    """Return from when to when, in seconds since the start, the rows are in the page."""
    inside = np.concatenate([[False], kept, [False]])
    edges = np.flatnonzero(inside[1:] != inside[:-1]).reshape(-1, 2)
    starts, ends = (
        trace.seconds[places] - trace.start for places in (edges[:, 0], edges[:, 1] - 1)
    )
    return [
        [round(start, 6), round(end + trace.period_s, 6)]
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True)
    ]


def _lanes(trace: Trace) -> dict[str, Sequence[Span]]:
    states = {"status": trace.status} | ({} if trace.air is None else trace.air.lanes)
    return {
        **states,
        NO_DATA: trace.gaps,
        **{name: spans for name, spans in marked(trace).items() if spans},
        "joints": trace.joints,
    }


def _spans(trace: Trace, spans: Sequence[Span], thirds: Sequence[int]) -> Ints:
    """Return the start of each as a step from the one before it, its length, both in ms, and a
    third number.
    """
    starts = _integers(
        1000 * (np.array([span.start for span in spans], dtype=np.float64) - trace.start)
    )
    lengths = _integers(1000 * np.array([span.seconds for span in spans], dtype=np.float64))
    return np.stack([_steps(starts), lengths, np.array(thirds, dtype=np.int64)], axis=1).ravel()


def held_settings(trace: Trace) -> list[tuple[Span, float]]:
    """Return runs of equal readings of the setting without an outage between them, each with its
    °C.
    """
    known = np.flatnonzero(~np.isnan(trace.setting))
    at, celsius = trace.seconds[known], trace.setting[known]
    if not len(at):
        return []
    outages = np.array([gap.start for gap in trace.gaps if gap.seconds >= LONG_GAP_S])
    parted = (
        (np.diff(celsius) != 0)
        | (np.diff(at) > SETTING_JOINED_S)
        | (np.diff(np.searchsorted(outages, at)) > 0)
    )
    first = np.append(0, np.flatnonzero(parted) + 1)
    last = np.append(first[1:], len(at)) - 1
    return [
        (Span(float(at[a]), float(at[b]), "set"), float(celsius[a]))
        for a, b in zip(first, last, strict=True)
    ]


def _limits(trace: Trace) -> list[list[object]]:
    """Return ``["high", [[seconds, 380], …]]``: each value with the time of its reading; None while
    the alarm was off.
    """
    return [
        [
            one.side,
            [
                [round(second - trace.start, 3), None if np.isnan(value) else value]
                for second, value in _limit(one)
            ],
        ]
        for one in trace.limits
    ]


def _limit(one: Limit) -> Iterator[tuple[float, float]]:
    return zip(one.seconds, one.celsius, strict=True)
