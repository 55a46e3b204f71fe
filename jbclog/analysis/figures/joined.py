"""The trace of a port from the traces of its rows, piece by piece: the same as from all rows at
once, in a third of the memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
import pandas as pd

from jbclog.analysis.figures.curves import Readings, Span, coded, missing_ticks
from jbclog.analysis.figures.trace import JOINED_PERIODS, Trace


def joined(pieces: list[Trace]) -> Trace:
    """Return the trace of all rows, of a port on a grid with neither states nor hot air; takes the
    pieces out of their list. No piece is empty, unless it is the only one.
    """
    if len(pieces) == 1:
        return pieces.pop()
    first, period_s = pieces[0], pieces[0].period_s
    ends = [(float(one.seconds[0]), float(one.seconds[-1])) for one in pieces]
    between = [
        span
        for (_, before), (after, _) in pairwise(ends)
        for span in missing_ticks(np.array([before, after]), period_s)
    ]
    status = _spans([one.status for one in pieces], ends, period_s)
    gaps = [*_spans([one.gaps for one in pieces], ends, period_s), *between]
    reasons = _categorical([one.reasons for one in pieces])
    readings = [[one.seconds, one.temperature, one.power, one.setting] for one in pieces]
    pieces.clear()
    seconds, temperature, power, setting = (_column(readings) for _ in range(4))
    return replace(
        first,
        seconds=seconds,
        temperature=temperature,
        power=power,
        setting=setting,
        status=status,
        gaps=sorted(gaps, key=lambda span: span.start),
        reasons=reasons,
    )


def _column(readings: list[list[Readings]]) -> Any:
    """Return the first column of all pieces; takes it out of them."""
    return np.concatenate([columns.pop(0) for columns in readings])


def _spans(
    lists: Sequence[Sequence[Span]], ends: Sequence[tuple[float, float]], period_s: float
) -> list[Span]:
    """Return the spans of all pieces, whose first and last moments are `ends`; one that continues
    in the next piece is one.
    """
    found: list[Span] = []
    before_s = -inf  # the last row of the piece before
    for spans, (first_s, last_s) in zip(lists, ends, strict=True):
        continues = (
            found
            and spans
            and found[-1].end == before_s + period_s
            and spans[0].start == first_s
            and spans[0].word == found[-1].word
            and first_s - before_s <= JOINED_PERIODS * period_s
        )
        if continues:
            found[-1] = replace(found[-1], end=spans[0].end)
        found += spans[1:] if continues else spans
        before_s = last_s
    return found


def _categorical(pieces: Sequence[pd.Categorical]) -> pd.Categorical:
    words = [*dict.fromkeys(str(word) for piece in pieces for word in piece.categories)]
    place = {word: number for number, word in enumerate(words)}
    kind = np.min_scalar_type(-max(len(words), 1))
    codes = [
        np.array([*(place[str(word)] for word in piece.categories), -1], dtype=kind)[piece.codes]
        for piece in pieces
    ]
    return coded(np.concatenate(codes), words)
