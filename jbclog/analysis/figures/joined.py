"""The trace of a port from the traces of its rows, piece by piece: the same as from all rows at
once, in a third of the memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jbclog.analysis.figures.curves import Span, coded, missing_ticks
from jbclog.analysis.figures.trace import JOINED_PERIODS, Trace


class GrowingColumn:
    """An array that grows in place; it takes the type that its values need."""

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
    """Joins the traces of the rows of a port on a grid, with neither states nor hot air, oldest
    first. No piece is empty, unless it is the only one.
    """

    def __init__(self) -> None:
        self._first: Trace | None = None
        self._columns = {
            name: GrowingColumn() for name in ("seconds", "temperature", "power", "setting")
        }
        self._codes = GrowingColumn()
        self._places: dict[str, int] = {}
        self._status: list[Span] = []
        self._gaps: list[Span] = []
        self._missing: list[Span] = []
        self._last_s = -inf

    def add(self, piece: Trace) -> None:
        """Add the trace of the next rows."""
        before_s, period_s = self._last_s, piece.period_s
        if self._first is None:
            self._first = piece.between(inf, inf)
        else:
            self._missing += missing_ticks(np.array([before_s, piece.seconds[0]]), period_s)
        for name, column in self._columns.items():
            column.add(getattr(piece, name))
        self._codes.add(self._coded(piece.reasons))
        if len(piece.seconds):
            _add_spans(self._status, piece.status, piece, before_s)
            _add_spans(self._gaps, piece.gaps, piece, before_s)
            self._last_s = float(piece.seconds[-1])

    def trace(self) -> Trace:
        """Return the trace of all rows."""
        assert self._first is not None
        return replace(
            self._first,
            status=self._status,
            gaps=sorted([*self._gaps, *self._missing], key=lambda span: span.start),
            reasons=coded(self._codes.array(), [*self._places]),
            seconds=self._columns["seconds"].array(),
            temperature=self._columns["temperature"].array(),
            power=self._columns["power"].array(),
            setting=self._columns["setting"].array(),
        )

    def _coded(self, reasons: pd.Categorical) -> NDArray[np.integer[Any]]:
        """Return the codes of some reasons among those of all pieces."""
        words = [str(word) for word in reasons.categories]
        numbers = [self._places.setdefault(word, len(self._places)) for word in words]
        kind = np.min_scalar_type(-max(len(self._places), 1))
        codes: NDArray[np.integer[Any]] = np.array([*numbers, -1], dtype=kind)
        return codes[np.asarray(reasons.codes)]


def _add_spans(found: list[Span], spans: Sequence[Span], piece: Trace, before_s: float) -> None:
    """Add the spans of a piece; one that continues from the piece before `before_s` is one."""
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
