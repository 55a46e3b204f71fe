"""Stretches of time: where there is no data and why, what the tool's status was, where something was wrong."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


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
