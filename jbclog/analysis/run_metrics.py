"""Joints and metrics of a run: the derived tables in its folder, or computed from its samples.

The tables have a row for each joint (`JOINTS_SCHEMA`) and for each metric of each port
(`METRICS_SCHEMA`).
Also works for a run that is being recorded or was cut off. A port without a feeder is measured
window by window, so that a long run fits into memory; one with a feeder as a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.derived_files import (
    MetricRow,
    derived_table,
    metric_rows_in,
    metrics_table,
)
from jbclog.analysis.derived_schemas import JOINTS_SCHEMA
from jbclog.analysis.joints.packed import column_of, floats_of, kinds_of
from jbclog.analysis.joints.parameters import JointOptions, options_of
from jbclog.analysis.joints.port_reader import PortReader
from jbclog.analysis.joints.port_rows import COLUMNS, CYCLES, Clock, cycles_of, kind_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Cycles
from jbclog.analysis.joints.solder_wire import Wire
from jbclog.analysis.metrics.measures import METRICS, Measured, PortMeasuring, measure_port
from jbclog.analysis.port_data import Counts, Floats
from jbclog.analysis.run_tables import MOST_WHOLE, RunTables, frame
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.core.errors import RecordError
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS
from jbclog.record.folder import joints_asked
from jbclog.record.manifest import Manifest, manifest_sha256
from jbclog.record.schema import FLOAT, SCHEMAS, TEXT

AS_THEY_ARE: Final = ("fed", "recovered")
FIELDS: Final = {
    "peak_permille": "peak",
    "heat_permille_s": "heat",
    "energy_permille_s": "energy",
    "stop_c": "end_c",
}
"""Column of the table -> field of a joint or its draw, where the names differ; floats are
rounded.
"""
DECIMALS: Final = 3
LENGTH: Final = "dispensed_mm"
OF_FEEDER: Final = (LENGTH, CYCLES)
POWER_AT_WORK: Final = "power_mean_permille"
COUNTED: Final = ["time", "station", "port", "counter", "value"]
UNSURE: Final = 1e-3
# status texts of W-PS (manuals 000, 001, 002)
ORDER_TO_WORK: Final = {"tip": "00000", "air": "00001"}


class MeasuredPort(NamedTuple):
    """Joints and metrics of one port; `edges_us` has start and end of each joint, alternating
    (UTC).
    """

    facts: StationFacts
    port: int
    measured: Measured
    edges_us: Counts

    def joint_table(self, run: Manifest) -> pa.Table:
        """Return a row for each joint, still without its unit."""
        return pa.table(
            [
                column if isinstance(column, pa.Array) else pa.array(column, field.type)
                for field, column in zip(JOINTS_SCHEMA, _columns(self, run), strict=True)
            ],
            schema=JOINTS_SCHEMA,
        )

    def metric_rows(self) -> list[MetricRow]:
        """Return a row for each metric."""
        return [
            MetricRow(
                self.facts.name,
                self.port,
                figure.name,
                figure.value,
                figure.low,
                figure.high,
                figure.unit,
                figure.n,
                figure.coverage,
                figure.resolution,
                figure.why,
            )
            for figure in self.measured.figures
        ]


def metrics_of(run: RunTables, station: str | None = None) -> pd.DataFrame:
    """Return a row for each metric of each port: value, or the reason in `why`; range, unit of
    measure, n, coverage in per cent, resolution.

    Reads the derived table if it is this run's, else computes it. Raises `RecordError`.
    """
    return frame(metrics_table(metric_rows_of(run, station), run.manifest.run))


def metric_rows_of(run: RunTables, station: str | None = None) -> list[MetricRow]:
    """Return the rows of `metrics_of` as objects."""
    stored = stored_table(run, "metrics")
    if stored is None:
        return computed_metrics(run, station)
    return [row for row in metric_rows_in(stored) if station in (None, row.station)]


def computed_metrics(run: RunTables, station: str | None = None) -> list[MetricRow]:
    """Return the rows of `metrics_of`, always computed from the samples."""
    return [row for port in _measured(run, station) for row in port.metric_rows()]


def joints_of(run: RunTables, station: str | None = None) -> pa.Table:
    """Return the joints, ordered by station, port and time: the derived table if it is this run's,
    else those found in the samples.

    Raises `RecordError`.
    """
    stored = stored_table(run, "joints")
    if stored is None:
        manifest = run.manifest
        joints = [one.joint_table(manifest) for one in _measured(run, station)]
        return _with_units(run, _concatenated(joints))
    return stored if station is None else stored.filter(pc.equal(stored["station"], station))


def stored_table(run: RunTables, name: str) -> pa.Table | None:
    """Return a derived table of a sealed run from its folder; None if there is none, or it is of
    another run or other methods.
    """
    try:
        if not run.manifest.is_sealed:
            return None
        return derived_table(run.folder, name, manifest_sha256(run.folder))
    except RecordError:
        return None


class Measures(NamedTuple):
    """Joints, metrics and joint parameters of each port of a run.

    The parameters are those of the recipe's `[joints]`, completed by those learnt from the run.
    `doubtful`: ports with tips that worked and whose number of joints is not known even where all
    was read;
    `with_joints`: ports with tips.
    """

    joints: pa.Table
    metrics: list[MetricRow]
    parameters: list[dict[str, object]]
    doubtful: frozenset[PortKey]
    with_joints: frozenset[PortKey]


def joints_and_metrics(run: RunTables) -> Measures:
    """Return joints, metrics and parameters from one pass over the samples. Raises
    `RecordError`.
    """
    joints: list[pa.Table] = []
    metrics: list[MetricRow] = []
    parameters: list[dict[str, object]] = []
    doubtful: set[PortKey] = set()
    with_joints: set[PortKey] = set()
    manifest = run.manifest
    for one in _measured(run, None):
        joints.append(one.joint_table(manifest))
        metrics += one.metric_rows()
        found = one.measured.found
        if found is None:
            continue
        place = one.facts.name, one.port
        parameters.append({"station": place[0], "port": place[1], **asdict(found.settings)})
        with_joints.add(place)
        working = {figure.name: figure.n for figure in one.measured.figures}[POWER_AT_WORK]
        if found.why is not None and working:
            doubtful.add(place)
    pa.default_memory_pool().release_unused()
    table = _with_units(run, _concatenated(joints))
    return Measures(table, metrics, parameters, frozenset(doubtful), frozenset(with_joints))


def _with_units(run: RunTables, joints: pa.Table) -> pa.Table:
    """Return the joints with the serial of the unit in which each begins, null if not known."""
    if not joints.num_rows:
        return joints
    serials = run.unit_at(pd.Series(joints["start"].to_pandas()))
    place = joints.schema.get_field_index("unit")
    return joints.set_column(place, joints.schema.field(place), pa.array(serials, TEXT))


def definitions() -> pd.DataFrame:
    """Return the definition of each metric: `metric`, `uom`, `definition`, `applies_to`."""
    rows = [(one.name, one.unit, one.text, ", ".join(one.of)) for one in METRICS.values()]
    return pd.DataFrame(rows, columns=["metric", "uom", "definition", "applies_to"])


def _parameters(run: RunTables, facts: StationFacts) -> JointOptions:
    return options_of(joints_asked(run.folder, facts))


def _measured(run: RunTables, station: str | None) -> Iterator[MeasuredPort]:
    """Measure each port of each station, or of one station, in order."""
    settings = run.settings()
    counters: pd.DataFrame | None = None
    samples = run.samples_by_port(COLUMNS)
    steps = steps_in(run.groups("events", STEP_COLUMNS))
    for facts in run.stations:
        if station not in (None, facts.name):
            continue
        own_settings = settings[settings["station"] == facts.name]
        for port in facts.ports:
            reader = PortReader(facts, port, samples, steps, run.manifest.t0_utc_us)
            if not has_feeder(facts):
                yield _in_windows(run, facts, port, reader, own_settings)
                continue
            if counters is None:
                counters = _feeders_counters(run)
            is_own = (counters["station"] == facts.name) & (counters["port"] == port)
            yield _as_a_whole(run, facts, port, reader, own_settings, counters[is_own])


def _feeders_counters(run: RunTables) -> pd.DataFrame:
    """Return the readings of the feeders' counters. Raises `RecordError` if they take too much.

    All counters of a week of 32 ports have more than two million.
    """
    names, pieces, size = pa.array(OF_FEEDER), list[pa.Table](), 0
    for group in run.groups("counters", [*COUNTED]):
        pieces.append(group.filter(pc.is_in(group["counter"], names)))
        size += pieces[-1].nbytes
        if size > MOST_WHOLE["counters"]:
            raise RecordError(f"{run.place}: too many readings of its feeders' counters")
    return frame(pa.concat_tables([SCHEMAS["counters"].empty_table().select(COUNTED), *pieces]))


def _as_a_whole(
    run: RunTables,
    facts: StationFacts,
    port: int,
    reader: PortReader,
    settings: pd.DataFrame,
    counters: pd.DataFrame,
) -> MeasuredPort:
    """Measure a port with a feeder."""
    series, utc_us = reader.whole()
    clock = reader.clock()
    cycles = _cycles(counters, utc_us, series.moments)
    series = replace(series, ordered_s=_ordered_s(facts, settings, port, clock), cycles=cycles)
    wire = _wire(counters, settings, clock)
    measured = measure_port(series, kind_of(facts), wire, _parameters(run, facts))
    edges = np.searchsorted(series.moments, _edges(measured.joints) - 1e-6)
    places = np.clip(edges, 0, len(series.seconds) - 1)
    return MeasuredPort(facts, port, measured, utc_us[places])


def _in_windows(
    run: RunTables, facts: StationFacts, port: int, reader: PortReader, settings: pd.DataFrame
) -> MeasuredPort:
    """Measure a port without a feeder."""
    ordered_s = _ordered_s(facts, settings, port, reader.clock())
    like = replace(reader.like(), ordered_s=ordered_s)
    measuring = PortMeasuring(kind_of(facts), like, _parameters(run, facts))
    reader.sweep(measuring)
    measured = measuring.measured
    return MeasuredPort(facts, port, measured, reader.utc_us(_edges(measured.joints)))


def _edges(joints: Sequence[Joint]) -> Floats:
    """Return start and end of each joint in s, alternating."""
    edges = [floats_of(joints, name) for name in ("start_s", "end_s")]
    return np.array(edges, dtype=np.float64).ravel(order="F")


def _ordered_s(
    facts: StationFacts, settings: pd.DataFrame, port: int, clock: Clock
) -> float | None:
    """Return when the run ordered the tool to work, s; None if it did not."""
    orders = settings[
        (settings["port"] == port)
        & (settings["setting"] == "status")
        & (settings["outcome"] == "confirmed")
    ]
    orders = orders[orders["requested"] == ORDER_TO_WORK.get(kind_of(facts))]
    return float(clock.of(_micros(orders))[-1]) if len(orders) else None


def _wire(counters: pd.DataFrame, settings: pd.DataFrame, clock: Clock) -> Wire:
    """Return the feeder's length counter, and the set length if it was read."""
    length = _counter(counters, LENGTH)
    readbacks = settings[(settings["setting"] == "feeder_length") & settings["readback"].notna()][
        "readback"
    ]
    try:
        set_mm = float(readbacks.iloc[-1]) if len(readbacks) else None
    except ValueError:
        set_mm = None
    return Wire(clock.of(_micros(length)), length["value"].to_numpy(dtype=np.float64), set_mm)


def _cycles(counters: pd.DataFrame, rows_us: Counts, moments: Floats) -> Cycles:
    read = _counter(counters, CYCLES)
    return cycles_of(_micros(read), read["value"].to_numpy(dtype=np.float64), rows_us, moments)


def _counter(counters: pd.DataFrame, name: str) -> pd.DataFrame:
    return counters[(counters["counter"] == name) & counters["value"].notna()]


def _micros(rows: pd.DataFrame) -> Counts:
    """Return the times of these rows, UTC microseconds since 1970."""
    return np.asarray(rows["time"].astype("int64"), dtype=np.int64)


def _concatenated(joints: list[pa.Table]) -> pa.Table:
    """Return the rows of all tables, and empty the list: only one column is in memory twice."""
    columns = [
        [chunk for table in joints for chunk in table.column(name).chunks]
        for name in JOINTS_SCHEMA.names
    ]
    joints.clear()
    whole: list[pa.Array] = []
    for field in JOINTS_SCHEMA:
        chunks = columns.pop(0)
        whole.append(pa.concat_arrays(chunks) if chunks else pa.array([], field.type))
    return pa.table(whole, schema=JOINTS_SCHEMA)


def _columns(one: MeasuredPort, run: Manifest) -> Iterator[Sequence[object] | Counts | pa.Array]:
    """Yield the columns of a port's joints in the order of the table."""
    joints, rated_w = one.measured.joints, one.facts.rated_power_w
    number_why = one.measured.number_why

    def floats(name: str, decimals: int = DECIMALS) -> pa.Array:
        return _rounded(floats_of(joints, name), decimals)

    def dwells() -> pa.Array:
        if number_why is not None:
            return pa.nulls(len(joints), FLOAT)
        seconds = floats_of(joints, "dwell_s")
        return _rounded(np.where(np.isnan(floats_of(joints, "heat")), np.nan, seconds))

    def joules() -> pa.Array:
        watts = np.nan if rated_w is None else rated_w
        return _rounded(floats_of(joints, "energy") * watts / 1000)

    others: dict[str, Callable[[], Sequence[object] | Counts | pa.Array]] = {
        "run": lambda: [run.run] * len(joints),
        "station": lambda: [one.facts.name] * len(joints),
        "port": lambda: [one.port] * len(joints),
        "joint": lambda: range(1, len(joints) + 1),
        "start": lambda: one.edges_us[::2],
        "stop": lambda: one.edges_us[1::2],
        "start_s": lambda: floats("start_s", 6),
        "stop_s": lambda: floats("end_s", 6),
        "unit": lambda: pa.nulls(len(joints), TEXT),
        "tip": lambda: [run.metadata.tip(one.facts.name, one.port)] * len(joints),
        "touches": lambda: column_of(joints, "contacts"),
        "dwell_s": dwells,
        "why": lambda: [why or number_why for why in column_of(joints, "why")],
        "energy_j": joules,
        "confidence": lambda: _known(floats_of(joints, "confidence")),
        "kind": lambda: kinds_of(joints),
    }
    for name in JOINTS_SCHEMA.names:
        if name in others:
            yield others[name]()
        elif name in AS_THEY_ARE:
            yield column_of(joints, name)
        else:
            yield floats(FIELDS.get(name, name))


def _rounded(values: Floats, decimals: int = DECIMALS) -> pa.Array:
    """Return the values to three decimals, finer than any resolution of a station; null if not
    known.
    """
    return _known(rounded(np.where(np.isinf(values), np.nan, values), decimals))


def _known(values: Floats) -> pa.Array:
    return pa.array(values, FLOAT, mask=np.isnan(values))


def rounded(values: Floats, decimals: int) -> Floats:
    """Round as the built-in `round` does: to the decimal number nearest to the exact value."""
    with np.errstate(over="ignore", invalid="ignore"):  # beyond 10^12, `round` itself does it
        scaled = values * 10**decimals
        found: Floats = np.rint(scaled) / 10**decimals
        # the product may be on the wrong side of a half, by less than this below 10^12
        is_half = np.abs(np.abs(scaled - np.rint(scaled)) - 0.5) < UNSURE
    unsure = is_half | (np.abs(scaled) > 1e12)
    found[unsure] = [round(value, decimals) for value in values[unsure].tolist()]
    return found
