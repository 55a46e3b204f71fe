"""The stations of a report and their ports: rows, facts and figures.

A week at 10 Hz takes 13 bytes per row: a port's trace is made of some 33 000 rows at a time and
joined. A port without a grid, of hot air, or that reports only states is read as a whole.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa

from jbclog.analysis.clock_steps import steps_of
from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.curves import EXACT_IN_16, quantile
from jbclog.analysis.figures.from_samples import (
    GrowingColumn,
    JoinedTrace,
    columns_of,
    gap_spans,
    has_air,
    has_only_states,
    trace,
)
from jbclog.analysis.figures.marks import Happening, Place, marks_of
from jbclog.analysis.figures.port import Scale, draw, scale_of
from jbclog.analysis.figures.style import NARROW, WIDE, Format
from jbclog.analysis.figures.trace import Grid, Limit, MarkKind, Trace
from jbclog.analysis.run import Run
from jbclog.analysis.run_joints import OF_SPANS, spans_of
from jbclog.analysis.verdict import PortMeasure
from jbclog.core.rows import StationFacts, TipCheck
from jbclog.core.text import clean
from jbclog.record.manifest import Ledger
from jbclog.record.parts import ROWS_A_GROUP
from jbclog.record.samples_by_port import SamplesByPort
from jbclog.record.schema import SCHEMAS
from jbclog.report.captions import caption, closer, closer_caption, description
from jbclog.report.facts import FigureFacts, PortFacts, StationReport
from jbclog.report.joints import Joints, joint_facts
from jbclog.report.overview import Overview
from jbclog.report.port_facts import (
    air_facts,
    coldness,
    last_known,
    power_facts,
    recorded_facts,
    states_facts,
    tip_facts,
)
from jbclog.report.record_facts import (
    PortRows,
    due_readings,
    of_port,
    of_station,
    ports_of,
    verification,
)
from jbclog.report.zoom import zoom_of

NAME: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")  # docs/reference/configuration.md
LONG: Final = 1 << 18  # rows of a port from which on its memory is returned once it is free
TEXTS: Final = ("quality", "reasons", "status")
COUNTED: Final = {kind: pd.ArrowDtype(kind) for kind in (pa.int32(), pa.int64())}
READINGS: Final = ("temperature_c", "power_permille", "setpoint_c")


@dataclass(slots=True)
class Context:
    """The data that all ports of a run share."""

    happenings: list[Happening]
    limits: Mapping[Place, Sequence[Limit]]
    measures: Mapping[tuple[str, int], PortMeasure]
    ledger: Ledger
    cut_off: bool
    overview: Overview
    has_overview: bool  # with a single port there is none
    joints: Joints
    checks: Mapping[tuple[str, int], TipCheck]
    rules: Sequence[Mapping[str, object]]
    crowded: bool
    zoom: int  # rows of each port in the interactive view


def station_reports(run: Run, context: Context) -> Iterator[StationReport]:
    """Yield one station of the run after the other."""
    stations = run.manifest.stations
    steps = tuple(steps_of(run.folder))
    columns = [name for facts in stations for name in columns_of(facts)]
    samples = run.samples_by_port(["late_us", *columns])
    for number, facts in enumerate(stations, 1):
        grid = Grid(run.manifest.t0_utc_us, facts.period_s, steps)
        recorded = sorted(port for name, port in samples.ports if name == facts.name)
        context.has_overview = len(stations) > 1 or len(recorded) > 1
        # the name in a manifest can be any text
        stem = facts.name if NAME.fullmatch(facts.name) else f"station-{number}"
        ports = [
            port_facts(facts, port, f"{stem}-{port}", samples, grid, context)
            for port in ports_of(facts, recorded)
        ]
        yield StationReport(ports=ports, **of_station(facts, cut_off=context.cut_off))


def port_facts(
    facts: StationFacts,
    port: int,
    file: str,
    samples: SamplesByPort,
    grid: Grid,
    context: Context,
) -> PortFacts:
    """Return one port from its rows; the files of its figures begin with `file`."""
    rows = samples_of(samples, facts, port, grid)
    late_us = rows.late_us(0.99)  # before the trace, which takes as much memory
    measure = context.measures.get((facts.name, port))
    drawn = replace(
        rows.trace(),
        gaps=[] if measure is None else gap_spans(measure.gaps, rows.grid.t0_utc_us),
        limits=context.limits.get((facts.name, port), []),
        marks=marks_of(context.happenings, facts.name, port),
        joints=spans_of(context.joints.of_port(facts.name, port, OF_SPANS)),
    )
    recorded = recorded_facts(
        rows.rows, late_us, measure, due_readings(context.ledger, facts, port)
    )
    seen = PortRows(rows.rows, last_known(drawn.temperature), rows.last_status)
    del rows  # it holds the input of the trace
    _give_back(seen.number)
    if seen.number and context.has_overview:
        context.overview.add(
            clean(f"{facts.name} · {port}"),
            drawn,
            recorded.coverage_percent,
            coldness(drawn, measure),
        )
    has_tip = not drawn.states and drawn.air is None
    found = PortFacts(
        recorded=recorded,
        tip=tip_facts(drawn, measure),
        power=power_facts(drawn, context.joints.metrics_of(facts.name, port)),
        states=states_facts(drawn.states) if drawn.states else None,
        air=None if drawn.air is None else air_facts(drawn.air),
        alarms=sum(mark.kind is MarkKind.ALARM for mark in drawn.marks),
        doubtful_alarms=sum(mark.kind is MarkKind.UNCONFIRMED for mark in drawn.marks),
        figures=(
            _figures(file, f"{facts.name}, port {port}", drawn, context) if seen.number else []
        ),
        verification=verification(
            facts, port, context.checks.get((facts.name, port)), context.rules
        ),
        **of_port(facts, port, seen, cut_off=context.cut_off),
    )
    del drawn  # before the chart of the joints: both are large
    _give_back(seen.number)
    if has_tip:
        found.joints = joint_facts(context.joints, facts.name, port, file, crowded=context.crowded)
    return found


def _give_back(rows: int) -> None:
    """Return what is free to the system, in a port of so many rows that it matters: it takes some
    milliseconds, four times a port.
    """
    if rows >= LONG:
        pa.default_memory_pool().release_unused()


def _figures(file: str, place: str, drawn: Trace, context: Context) -> list[FigureFacts]:
    """Return the figure of the whole run and, if that is long, one of a minute of it."""
    figures = [
        _figure(
            f"figures/{file}.svg", caption(drawn), description(place, drawn), drawn, context.crowded
        )
    ]
    _give_back(len(drawn.seconds))
    figures[0].zoom = zoom_of(drawn, context.zoom)
    _give_back(len(drawn.seconds))
    near = closer(drawn) if drawn.marks or not context.crowded else None
    if near is not None:
        part, why = near
        text = closer_caption(part, why)
        figures.append(
            _figure(f"figures/{file}-closer.svg", text, f"{place}: {text}", part, context.crowded)
        )
    return figures


def _figure(file: str, text: str, alt: str, drawn: Trace, crowded: bool) -> FigureFacts:
    """Return a figure in both sizes, or in the wide one alone, which a phone scrolls."""
    scale = scale_of(drawn)
    wide = _svg(drawn, WIDE, scale)
    return FigureFacts(file, text, alt, wide, wide if crowded else _svg(drawn, NARROW, scale))


def _svg(drawn: Trace, form: Format, scale: Scale) -> str:
    return svg_text(draw(drawn, form, scale))


# -- rows ------------------------------------------------------------------------------------------


def samples_of(samples: SamplesByPort, facts: StationFacts, port: int, grid: Grid) -> PortSamples:
    """Return the rows of a port."""
    port_samples = PortSamples(facts, grid)
    for rows in samples.rows((facts.name, port), ["late_us", *columns_of(facts)]):
        port_samples.add(rows)
    return port_samples


class PortSamples:
    """The rows of a port: how many, how late, the last status, and their trace."""

    def __init__(self, facts: StationFacts, grid: Grid) -> None:
        self.grid = grid
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
        late_us = rows["late_us"].drop_null()
        self._late_us.add(_short(late_us, pa.uint16(), pa.int32()).to_numpy())
        self._held.append(_narrow(rows.select(self._columns)))
        self._held_rows += len(rows)
        self.rows += len(rows)
        if self._at_once is not None and self._held_rows >= self._at_once:
            self._joined.add(self._trace_held())

    def trace(self) -> Trace:
        """Return the trace of all rows, and free them."""
        if self._at_once is None or not self.rows:
            return self._trace_held()
        if self._held:
            self._joined.add(self._trace_held())
        return self._joined.trace()

    def late_us(self, share: float) -> float | None:
        """Return a quantile of how late the rows were, and free these times."""
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
        return trace(frame, self.grid, of_states=self._of_states, of_air=self._of_air)


def _narrow(rows: pa.Table) -> pa.Table:
    """Return rows with dictionaries for texts, 32 bits for counts, and readings (integers of at
    most six digits) as floats.
    """
    narrow = {name: rows[name].dictionary_encode() for name in TEXTS if name in rows.column_names}
    narrow |= {
        name: rows[name].cast(pa.float32(), safe=False)
        for name in READINGS
        if name in rows.column_names
    }
    narrow["tick"] = _short(rows["tick"], pa.int32())
    return pa.table({name: narrow.get(name, rows[name]) for name in rows.column_names})


def _short(counts: pa.ChunkedArray, *kinds: pa.DataType) -> pa.ChunkedArray:
    """Return counts as the first of these types that holds them all; else unchanged."""
    for kind in kinds:
        with suppress(pa.ArrowInvalid):
            return counts.cast(kind)
    return counts


def _exact_in_16(readings: pd.Series[float]) -> pd.Series[float]:
    """Return readings in 16 bits if these hold them exactly."""
    values = readings.to_numpy()
    return readings if (np.abs(values) > EXACT_IN_16).any() else readings.astype(np.float16)
