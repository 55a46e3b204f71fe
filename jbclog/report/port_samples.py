"""The rows of a port as its report needs them, collected row group by row group, for several ports
from one pass over the samples.

A week at 10 Hz takes 19 bytes a row: its trace is made of some 33 000 rows at a time and joined,
which takes a third of the memory of all rows at once. A port without a grid, of hot air, or that
reports states alone is taken as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from jbclog.analysis.figures.curves import EXACT_IN_16, Span, coded, missing_ticks, quantile
from jbclog.analysis.figures.from_samples import columns_of, has_air, has_only_states, trace
from jbclog.analysis.figures.trace import JOINED_PERIODS, Grid, Trace
from jbclog.analysis.joints.port_reader import at_once
from jbclog.analysis.port_split import by_port, gathered
from jbclog.analysis.run import Run
from jbclog.analysis.verdict.clock_steps import Step
from jbclog.core.rows import StationFacts
from jbclog.record.parts import ROWS_A_GROUP
from jbclog.record.schema import SCHEMAS

GROUPS_KEPT: Final = 32  # of row groups, until what they took is given back
MOST_ROWS: Final = 8_000_000  # of several stations at once in memory, some 19 bytes each
TEXTS: Final = ("quality", "reasons", "status")
COUNTED: Final = {kind: pd.ArrowDtype(kind) for kind in (pa.int32(), pa.int64())}
READINGS: Final = ("temperature_c", "power_permille", "set_c")


def samples_of_stations(
    run: Run, steps: tuple[Step, ...]
) -> Iterator[tuple[StationFacts, dict[int, PortSamples]]]:
    """Yield the rows of each port of each station, from one pass over the samples for as many
    stations as fit into memory.
    """
    for stations in at_once(run.manifest.stations, _rows, MOST_ROWS):
        found = _by_port(run, stations, steps)
        for facts in stations:
            yield facts, found.pop(facts.name)


def _by_port(
    run: Run, stations: Sequence[StationFacts], steps: tuple[Step, ...]
) -> dict[str, dict[int, PortSamples]]:
    """Return the rows of each port."""
    t0_utc_us = run.manifest.t0_utc_us
    grids = {facts.name: Grid(t0_utc_us, facts.period_s, steps) for facts in stations}
    found = {
        facts.name: {port: PortSamples(facts, grids[facts.name]) for port in facts.ports}
        for facts in stations
    }
    by_name = {facts.name: facts for facts in stations}
    ports = sum(len(facts.ports) for facts in run.manifest.stations)
    every = [*dict.fromkeys(name for facts in stations for name in columns_of(facts))]
    read = run.groups("samples", ["station", "port", "late_us", *every], coded=True)
    for number, group in enumerate(gathered(read, ports), 1):
        if not number % GROUPS_KEPT:
            pa.default_memory_pool().release_unused()
        for (name, port), rows in by_port(group):
            if name not in found:
                continue
            if port not in found[name]:
                found[name][port] = PortSamples(by_name[name], grids[name])
            found[name][port].add(rows)
    return found


def _rows(facts: StationFacts) -> float:
    """Return the number of rows, infinite where it is not known."""
    if facts.first_tick is None or facts.last_tick is None:
        return inf
    return (facts.last_tick - facts.first_tick + 1) * len(facts.ports)


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


class PortSamples:
    """The rows of a port: how many, how late, the last status, and their trace."""

    def __init__(self, facts: StationFacts, grid: Grid) -> None:
        self._grid = grid
        self._of_states = has_only_states(facts)
        self._of_air = has_air(facts)
        self._columns = columns_of(facts)
        is_plain = bool(grid.period_s) and not self._of_states and not self._of_air
        self._at_once = ROWS_A_GROUP if is_plain else None
        self._held: list[pa.Table] = []
        self._held_rows = 0
        self._joined = JoinedTrace()
        self._late_us = GrowingColumn()
        self.rows = 0
        self.last_status: str | None = None

    def add(self, rows: pa.Table) -> None:
        """Add the next rows, oldest first."""
        self._late_us.add(_short(rows["late_us"].drop_null()).to_numpy())
        self._held.append(_narrow(rows.select(self._columns)))
        self._held_rows += len(rows)
        self.rows += len(rows)
        if self._at_once is not None and self._held_rows >= self._at_once:
            self._joined.add(self._trace_held())

    def trace(self) -> Trace:
        """Return the trace of all rows; they are given up."""
        if self._at_once is None or not self.rows:
            return self._trace_held()
        if self._held:
            self._joined.add(self._trace_held())
        return self._joined.trace()

    def late_us(self, share: float) -> float | None:
        """Return a quantile of how late the rows were; that is given up."""
        late_us, self._late_us = self._late_us.array(), GrowingColumn()
        return quantile(late_us, share) if len(late_us) else None

    def _trace_held(self) -> Trace:
        none = _narrow(SCHEMAS["samples"].empty_table().select(self._columns))
        pieces = [none, *self._held]
        rows = pa.concat_tables(pieces, promote_options="permissive").unify_dictionaries()
        self._held.clear()
        self._held_rows = 0
        columns = {
            name: rows[name].to_pandas(types_mapper=COUNTED.get) for name in rows.column_names
        }
        columns |= {name: _exact_in_16(columns[name]) for name in READINGS if name in columns}
        frame = pd.DataFrame(columns, copy=False)
        last = frame["status"].last_valid_index()
        self.last_status = self.last_status if last is None else str(frame["status"][last])
        return trace(frame, self._grid, of_states=self._of_states, of_air=self._of_air)


def _narrow(rows: pa.Table) -> pa.Table:
    """Return rows with dictionaries for texts, 32 bits for counts, and readings (whole numbers of
    at most six digits) as floats.
    """
    narrow = {name: rows[name].dictionary_encode() for name in TEXTS if name in rows.column_names}
    narrow |= {
        name: rows[name].cast(pa.float32(), safe=False)
        for name in READINGS
        if name in rows.column_names
    }
    narrow["tick"] = _short(rows["tick"])
    return pa.table({name: narrow.get(name, rows[name]) for name in rows.column_names})


def _short(counts: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return counts in 32 bits if they fit."""
    try:
        return counts.cast(pa.int32())
    except pa.ArrowInvalid:
        return counts


def _exact_in_16(readings: pd.Series[float]) -> pd.Series[float]:
    """Return readings in 16 bits if these hold them exactly."""
    values = readings.to_numpy()
    return readings if (np.abs(values) > EXACT_IN_16).any() else readings.astype(np.float16)
