"""Joints and metrics of a run: those that its report stored, or computed from its samples.

The tables have a row for each joint (`JOINTS_SCHEMA`) and for each metric of each port (`METRICS`).
Also works for a run that is being recorded or was cut off. Ports without a feeder are measured
together, window by window, so that a long run fits into memory; a port with a feeder is measured as
a whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, astuple, replace
from itertools import groupby
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.joints.packed import column_of, floats_of, kinds_of
from jbclog.analysis.joints.parameters import JointOptions, options_of
from jbclog.analysis.joints.port_reader import MOST_PORTS, MOST_ROWS, PortReader, at_once
from jbclog.analysis.joints.port_rows import CYCLES, Clock, cycles_of, kind_of
from jbclog.analysis.joints.recovery import Joint
from jbclog.analysis.joints.series import Cycles, Series
from jbclog.analysis.joints.solder_wire import Wire
from jbclog.analysis.metrics.definitions import DEFINITIONS
from jbclog.analysis.metrics.measures import Measured, PortMeasuring, measure_port
from jbclog.analysis.run_tables import MOST_WHOLE, RunTables, frame
from jbclog.analysis.stored_tables import (
    JOINTS_SCHEMA,
    MetricRow,
    metric_table,
    stored_joints,
    stored_metrics,
)
from jbclog.analysis.verdict.clock_steps import Step
from jbclog.analysis.verdict.idle import Floats
from jbclog.analysis.verdict.rules import has_feeder
from jbclog.analysis.verdict.samples import Counts
from jbclog.core.errors import RecordError
from jbclog.core.rows import PortKey, StationFacts
from jbclog.record.folder import joints_asked
from jbclog.record.manifest import manifest_sha256
from jbclog.record.schema import FLOAT, SCHEMAS

T = TypeVar("T")

AS_THEY_ARE: Final = ("fed", "recovered")
FIELDS: Final = {"peak_permille": "peak", "heat_permille_s": "heat", "energy_permille_s": "energy"}
"""Column of the table -> field of a joint or its draw, where the names differ; floats are
rounded.
"""
DECIMALS: Final = 3
LENGTH: Final = "dispensed_mm"
OF_FEEDER: Final = (LENGTH, CYCLES)
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

    def joint_table(self) -> pa.Table:
        """Return a row for each joint."""
        return pa.table(
            [
                column if isinstance(column, pa.Array) else pa.array(column, field.type)
                for field, column in zip(JOINTS_SCHEMA, _columns(self), strict=True)
            ],
            schema=JOINTS_SCHEMA,
        )

    def metric_rows(self) -> list[MetricRow]:
        """Return a row for each metric."""
        return [
            MetricRow(self.facts.name, self.port, *astuple(one)) for one in self.measured.figures
        ]


def metrics_of(run: RunTables, station: str | None = None) -> pd.DataFrame:
    """Return a row for each metric of each port: value, or the reason in `why`; unit, n, coverage
    in per cent, resolution.

    Reads the stored metrics if they are this run's, else computes them. Raises `RecordError`.
    """
    return metric_table(metric_rows_of(run, station))


def metric_rows_of(run: RunTables, station: str | None = None) -> list[MetricRow]:
    """Return the rows of `metrics_of` as objects."""
    stored = _stored(run, stored_metrics)
    if stored is not None:
        return [row for row in stored if station in (None, row.station)]
    return computed_metrics(run, station)


def computed_metrics(run: RunTables, station: str | None = None) -> list[MetricRow]:
    """Return the rows of `metrics_of`, always computed from the samples."""
    return [row for port in _measured(run, station) for row in port.metric_rows()]


def joints_of(run: RunTables, station: str | None = None) -> pa.Table:
    """Return the joints, ordered by station, port and time: the stored ones if they are this run's,
    else those found in the samples.

    Raises `RecordError`.
    """
    stored = _stored(run, stored_joints)
    if stored is None:
        return _concatenated([one.joint_table() for one in _measured(run, station)])
    return stored if station is None else stored.filter(pc.equal(stored["station"], station))


def _stored(run: RunTables, read: Callable[[Path, str], T | None]) -> T | None:
    """Return what `read` finds stored with a sealed run; None if there is none or it cannot be
    read.
    """
    try:
        if not run.manifest.is_sealed:
            return None
        return read(run.folder, manifest_sha256(run.folder))
    except RecordError:
        return None


def joints_frame(joints: pa.Table) -> pd.DataFrame:
    """Return a table of joints as a DataFrame."""
    return frame(joints).astype({"fed": "boolean"})


def joints_and_metrics(
    run: RunTables,
) -> tuple[pa.Table, list[dict[str, object]], list[dict[str, object]]]:
    """Return joints, rows of `metrics_of` and joint parameters of each port, from one pass over the
    samples.

    The parameters are those of the recipe's `[joints]`, completed by those learnt from the run.
    """
    joints: list[pa.Table] = []
    metrics: list[dict[str, object]] = []
    parameters: list[dict[str, object]] = []
    for one in _measured(run, None):
        joints.append(one.joint_table())
        metrics += map(asdict, one.metric_rows())
        if one.measured.found is not None:
            parameters.append(
                {"station": one.facts.name, "port": one.port, **asdict(one.measured.found.settings)}
            )
    pa.default_memory_pool().release_unused()
    return _concatenated(joints), metrics, parameters


def definitions() -> pd.DataFrame:
    """Return the definition of each metric: `metric`, `unit`, `definition`, `applies_to`."""
    rows = [(one.name, one.unit, one.text, ", ".join(one.of)) for one in DEFINITIONS]
    return pd.DataFrame(rows, columns=["metric", "unit", "definition", "applies_to"])


def _parameters(run: RunTables, facts: StationFacts) -> JointOptions:
    return options_of(joints_asked(run.folder, facts))


def _measured(run: RunTables, station: str | None) -> Iterator[MeasuredPort]:
    """Measure each port of each station, or of one station, in order."""
    selected = [facts for facts in run.stations if station in (None, facts.name)]
    for with_feeder, stations in groupby(selected, has_feeder):
        if with_feeder:
            every = run.settings(), _feeders_counters(run)
            for facts in stations:
                yield from _as_a_whole(
                    run, facts, *(table[table["station"] == facts.name] for table in every)
                )
        else:
            for some in at_once(list(stations), lambda facts: len(facts.ports), MOST_PORTS):
                yield from _in_windows(run, some)


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
    run: RunTables, facts: StationFacts, settings: pd.DataFrame, counters: pd.DataFrame
) -> Iterator[MeasuredPort]:
    """Measure the ports of a station with a feeder."""
    for port, series, wire, utc_us in _whole_ports(run, facts, settings, counters):
        measured = measure_port(series, kind_of(facts), wire, _parameters(run, facts))
        edges = np.searchsorted(series.moments, _edges(measured.joints) - 1e-6)
        places = np.clip(edges, 0, len(series.seconds) - 1)
        yield MeasuredPort(facts, port, measured, utc_us[places])


def _in_windows(run: RunTables, stations: Sequence[StationFacts]) -> Iterator[MeasuredPort]:
    """Measure the ports of stations without a feeder, holding at most one window of each in
    memory.
    """
    reader = port_reader(run, stations)
    measuring: dict[PortKey, PortMeasuring] = {}
    every_setting = run.settings()
    for facts in stations:
        settings = every_setting[every_setting["station"] == facts.name]
        parameters = _parameters(run, facts)
        for port in facts.ports:
            ordered_s = _ordered_s(facts, settings, port, reader.clock((facts.name, port)))
            like = replace(reader.like((facts.name, port)), ordered_s=ordered_s)
            measuring[facts.name, port] = PortMeasuring(kind_of(facts), like, parameters)
    reader.sweep(measuring)
    measured = {key: measuring.pop(key).measured for key in [*measuring]}
    pa.default_memory_pool().release_unused()
    edges_us = reader.utc_us({key: _edges(one.joints) for key, one in measured.items()})
    for facts in stations:
        for port in facts.ports:
            yield MeasuredPort(
                facts, port, measured.pop((facts.name, port)), edges_us.pop((facts.name, port))
            )


def port_reader(run: RunTables, stations: Sequence[StationFacts]) -> PortReader:
    """Return a reader of the rows of all ports of these stations. Raises `RecordError`."""
    steps = clock_steps(run) if any(not facts.period_s for facts in stations) else []
    is_sealed = run.manifest.is_sealed  # else rows move from the live store to a part
    return PortReader(
        stations,
        lambda columns: run.groups("samples", columns, coded=True),
        steps,
        run.manifest.t0_utc_us,
        MOST_ROWS,
        (lambda columns, wanted: run.groups("samples", columns, coded=True, wanted=wanted))
        if is_sealed
        else None,
    )


def clock_steps(run: RunTables) -> list[Step]:
    """Return the steps of the wall clock; unlike `steps_of`, also for a run that is not sealed."""
    events = run.events()
    steps = events[(events["kind"] == "clock.step") & events["value"].notna()]
    return [
        Step(time / 1e6, value)
        for time, value in zip(steps["time"].astype("int64"), steps["value"], strict=True)
    ]


def _edges(joints: Sequence[Joint]) -> Floats:
    """Return start and end of each joint in s, alternating."""
    edges = [floats_of(joints, name) for name in ("start_s", "end_s")]
    return np.array(edges, dtype=np.float64).ravel(order="F")


def _whole_ports(
    run: RunTables, facts: StationFacts, settings: pd.DataFrame, counters: pd.DataFrame
) -> Iterator[tuple[int, Series, Wire, Counts]]:
    """Yield, for a station with a feeder, each port's number, all its rows, the feeder's counter,
    and the UTC of the rows.
    """
    reader = port_reader(run, [facts])
    for key, (series, utc_us) in reader.whole().items():
        port, clock, counted = key[1], reader.clock(key), counters[counters["port"] == key[1]]
        cycles = _cycles(counted, utc_us, series.moments)
        ordered_s = _ordered_s(facts, settings, port, clock)
        yield (
            port,
            replace(series, ordered_s=ordered_s, cycles=cycles),
            _wire(counted, settings, clock),
            utc_us,
        )


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


def _columns(one: MeasuredPort) -> Iterator[Sequence[object] | Counts | pa.Array]:
    """Yield the columns of a port's joints in the order of the table."""
    joints, rated_w, found = one.measured.joints, one.facts.rated_power_w, one.measured.found
    number_why = None if found is None else found.why

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
        "station": lambda: [one.facts.name] * len(joints),
        "port": lambda: [one.port] * len(joints),
        "joint": lambda: range(1, len(joints) + 1),
        "start": lambda: one.edges_us[::2],
        "end": lambda: one.edges_us[1::2],
        "start_s": lambda: floats("start_s", 6),
        "end_s": lambda: floats("end_s", 6),
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
