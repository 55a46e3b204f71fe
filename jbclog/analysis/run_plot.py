"""The figure of a run for notebooks: each port as in the report, one below the other."""

from __future__ import annotations

from dataclasses import replace

from matplotlib.figure import Figure

from jbclog.analysis.clock_steps import steps_in
from jbclog.analysis.figures.from_samples import (
    gap_spans,
    own_columns,
)
from jbclog.analysis.figures.marks import happenings, limits_of, marks_of
from jbclog.analysis.figures.trace import Trace
from jbclog.analysis.port_figure import figure_of_traces, trace_of
from jbclog.analysis.run_joints import OF_SPANS, joints_of_port, spans_of
from jbclog.analysis.run_metrics import joints_of
from jbclog.analysis.run_ports import RunPorts
from jbclog.analysis.run_tables import RunTables
from jbclog.analysis.verdict.samples import columns_for, measures_of
from jbclog.core.errors import UsageError
from jbclog.record.clock_steps import COLUMNS as STEP_COLUMNS


def plot(run: RunTables, station: str | None = None, port: int | None = None) -> Figure:
    """Draw each port: temperature, power, status, joints, missing data, alarms and errors, over
    days (UTC).

    Each panel has one linear scale over its whole range. Raises `UsageError` without samples.
    """
    ports = _traces(run, station, port)
    if not ports:
        raise UsageError(
            f"{run.name} has no samples of station {station or 'any'}, port {port or 'any'}"
        )
    return figure_of_traces(ports)


def _traces(run: RunTables, station: str | None, port: int | None) -> list[tuple[str, Trace]]:
    """Return the ports that have samples, in the order of the line file."""
    t0_utc_us = run.manifest.t0_utc_us
    stations = [one for one in run.manifest.stations if station in (None, one.name)]
    by_name = {facts.name: facts for facts in stations}
    steps = steps_in(run.groups("events", STEP_COLUMNS))
    measures = measures_of(run.samples_by_port(columns_for(by_name)), by_name, steps)
    events = happenings(run.events(), t0_utc_us)
    limits = limits_of(run.settings(), t0_utc_us)
    joints = joints_of(run, station)
    ports = RunPorts(run, sorted({name for facts in stations for name in own_columns(facts)}))
    traces = []
    for facts in stations:
        for key in ports.keys:
            name, number = key
            if name != facts.name or port not in (None, number):
                continue
            data = ports.read(key, own_columns(facts))
            if not len(data):
                continue
            drawn = replace(
                trace_of(data),
                gaps=gap_spans(measures[key].gaps, t0_utc_us),
                limits=limits.get(key, []),
                marks=marks_of(events, name, number),
                joints=spans_of(joints_of_port(joints, name, number, OF_SPANS)),
            )
            traces.append((f"{name} port {number}", drawn))
    return traces
