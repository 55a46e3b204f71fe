"""The stations of a report and their ports: rows, facts and figures.

The rows of several ports come from one pass over the samples. A week at 10 Hz takes 13 bytes per
row: its trace is made of some 33 000 rows at a time and joined. A port without a grid, of hot air,
or that reports only states is read as a whole.
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

from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.curves import EXACT_IN_16, quantile
from jbclog.analysis.figures.from_samples import (
    GrowingColumn,
    JoinedTrace,
    columns_of,
    has_air,
    has_only_states,
    trace,
)
from jbclog.analysis.figures.marks import Happening, Place, marks_of
from jbclog.analysis.figures.port import Scale, draw, scale_of
from jbclog.analysis.figures.style import NARROW, WIDE, Format
from jbclog.analysis.figures.trace import Grid, Limit, MarkKind, Trace
from jbclog.analysis.joints.port_reader import at_once, rows_due
from jbclog.analysis.port_split import by_port, gathered
from jbclog.analysis.run import Run
from jbclog.analysis.run_joints import OF_SPANS, spans_of
from jbclog.analysis.verdict import PortMeasure
from jbclog.analysis.verdict.clock_steps import Step, steps_of
from jbclog.core.rows import StationFacts, TipCheck
from jbclog.core.text import clean
from jbclog.record.manifest import Ledger
from jbclog.record.parts import ROWS_A_GROUP
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
GROUPS_KEPT: Final = 32  # row groups after which their memory is returned
LONG: Final = 1 << 18  # rows of a port from which on its memory is returned once it is free
MOST_ROWS: Final = 8_000_000  # rows of several stations in memory at once, some 13 bytes each
TEXTS: Final = ("quality", "reasons", "status")
COUNTED: Final = {kind: pd.ArrowDtype(kind) for kind in (pa.int32(), pa.int64())}
READINGS: Final = ("temperature_c", "power_permille", "set_c")


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
    for number, (facts, samples) in enumerate(samples_of_stations(run, steps), 1):
        context.has_overview = len(stations) > 1 or len(samples) > 1
        # the name in a manifest can be any text
        stem = facts.name if NAME.fullmatch(facts.name) else f"station-{number}"
        ports = [
            port_facts(facts, port, f"{stem}-{port}", samples, context)
            for port in ports_of(facts, sorted(samples))
        ]
        yield StationReport(ports=ports, **of_station(facts, cut_off=context.cut_off))


def port_facts(
    facts: StationFacts, port: int, file: str, samples: dict[int, PortSamples], context: Context
) -> PortFacts:
    """Return one port from its rows, which are removed from `samples` and freed; the files of its
    figures begin with `file`.
    """
    rows = samples.pop(port)
    late_us = rows.late_us(0.99)  # before the trace, which takes as much memory
    drawn = replace(
        rows.trace(),
        limits=context.limits.get((facts.name, port), []),
        marks=marks_of(context.happenings, facts.name, port),
        joints=spans_of(context.joints.of_port(facts.name, port, OF_SPANS)),
    )
    measure = context.measures.get((facts.name, port))
    recorded = recorded_facts(
        rows.rows, late_us, drawn, measure, due_readings(context.ledger, facts, port)
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


def samples_of_stations(
    run: Run, steps: tuple[Step, ...]
) -> Iterator[tuple[StationFacts, dict[int, PortSamples]]]:
    """Yield the rows of each port of each station, from one pass over the samples for as many
    stations as fit into memory.
    """
    for stations in at_once(run.manifest.stations, rows_due, MOST_ROWS):
        found = _by_port(run, stations, steps)
        for facts in stations:
            yield facts, found.pop(facts.name)


def _by_port(
    run: Run, stations: Sequence[StationFacts], steps: tuple[Step, ...]
) -> dict[str, dict[int, PortSamples]]:
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
        return trace(frame, self._grid, of_states=self._of_states, of_air=self._of_air)


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
