"""Collect the facts of a report from a sealed run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import inf

import pandas as pd
import pyarrow as pa

from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.from_samples import AIR_COLUMNS as AIR
from jbclog.analysis.figures.from_samples import STATE_COLUMNS as STATES
from jbclog.analysis.figures.from_samples import has_air
from jbclog.analysis.figures.marks import happenings
from jbclog.analysis.figures.style import NARROW, WIDE
from jbclog.analysis.joints.port_reader import at_once
from jbclog.analysis.joints.port_rows import by_port
from jbclog.analysis.rejudge import is_cut_off, own_version
from jbclog.analysis.run import Run
from jbclog.analysis.verdict import judged_signals
from jbclog.analysis.verdict.clock_steps import steps_of
from jbclog.analysis.verdict.samples import KeptMeasures, Measuring
from jbclog.core.rows import StationFacts
from jbclog.record.schema import SCHEMAS
from jbclog.report.alarms import alarm_facts
from jbclog.report.facts import (
    CROWD,
    Facts,
    FigureFacts,
    StationReport,
    VerdictFacts,
)
from jbclog.report.joints import Joints, unit_rows
from jbclog.report.overview import Overview
from jbclog.report.ports import Context
from jbclog.report.repeated import of_run
from jbclog.report.stations import station_report
from jbclog.report.verdict import add_reasons, verdict_facts
from jbclog.report.zoom import share

MOST_ROWS = 4_000_000  # of several stations at once in memory, some 30 bytes each
TEXTS = ("quality", "reasons", "status")
COUNTS = ("tick", "late_us")
COUNTED = {kind: pd.ArrowDtype(kind) for kind in (pa.int32(), pa.int64())}
READINGS = ("temperature_c", "power_permille", "set_c")
COLUMNS = (
    "tick",
    "late_us",
    "quality",
    "reasons",
    "temperature_c",
    "power_permille",
    "status",
    "set_c",
)


def gather(run: Run, joints: Joints) -> Facts:
    """Return the facts of the report of `run`. Raises `RecordError`."""
    manifest = run.manifest
    overview = Overview(round((manifest.t0_utc or 0.0) * 1e6))
    measuring = KeptMeasures()
    verdict = verdict_facts(run.folder, manifest, measuring)
    stations = list(_stations(run, joints, overview, verdict, measuring))
    add_reasons(verdict, [asdict(station) for station in stations], cut_off=is_cut_off(manifest))
    return Facts(
        verdict=verdict,
        overview=_overview(overview),
        stations=stations,
        alarms=alarm_facts(run),
        units=unit_rows(joints),
        metrics=joints.metrics,
        **of_run(run),
    )


def _stations(
    run: Run, joints: Joints, overview: Overview, verdict: VerdictFacts, measuring: Measuring
) -> Iterator[StationReport]:
    """Yield one station after the other."""
    manifest, folder = run.manifest, run.folder
    t0_utc_us = round((manifest.t0_utc or 0.0) * 1e6)
    ports = sum(len(facts.ports) for facts in manifest.stations)
    context = Context(
        t0_utc_us,
        happenings(run.events(), t0_utc_us),
        run.settings(),
        measuring(
            folder, {facts.name: facts for facts in manifest.stations}, {}, own_version(manifest)
        ),
        manifest.ledger,
        is_cut_off(manifest),
        tuple(steps_of(folder)),
        overview,
        True,
        joints,
        {(one.station, one.port): one for one in manifest.verifications},
        verdict.rules,
        ports > CROWD,
        share(ports),
    )
    for number, (facts, samples) in enumerate(_samples(run), 1):
        context.has_overview = len(manifest.stations) > 1 or len(samples) > 1
        yield station_report(facts, number, samples, context)


def _samples(run: Run) -> Iterator[tuple[StationFacts, dict[int, pd.DataFrame]]]:
    """Yield the rows of each port of each station, from one pass over the samples for as many
    stations as fit into memory.
    """
    for stations in at_once(run.manifest.stations, _rows, MOST_ROWS):
        found = _by_port(run, stations)
        for facts in stations:
            yield facts, found.pop(facts.name)


def _by_port(run: Run, stations: Sequence[StationFacts]) -> dict[str, dict[int, pd.DataFrame]]:
    """Return the rows of each port in a fifth of the memory of `Run.samples`: equal texts once,
    readings in 32 bits.
    """
    columns = {facts.name: _columns(facts) for facts in stations}
    every = [*dict.fromkeys(name for some in columns.values() for name in some)]
    none = _narrow(SCHEMAS["samples"].empty_table())
    pieces = {
        (facts.name, port): [none.select(columns[facts.name])]
        for facts in stations
        for port in facts.ports
    }
    for group in run.coded("samples", ["station", "port", *every]):
        for key, rows in by_port(group):
            if key[0] in columns:
                pieces.setdefault(key, []).append(_narrow(rows.select(columns[key[0]])))
    found: dict[str, dict[int, pd.DataFrame]] = {name: {} for name in columns}
    for name, port in sorted(pieces):
        found[name][port] = _frame(pieces.pop((name, port)))
    return found


def _frame(pieces: list[pa.Table]) -> pd.DataFrame:
    """Return the rows of a port; takes the pieces out of their list, and frees each column as soon
    as it is converted.
    """
    rows, columns = (
        pa.concat_tables(pieces, promote_options="permissive").unify_dictionaries(),
        dict[str, pd.Series](),
    )
    pieces.clear()
    for name in rows.column_names:
        columns[name] = rows[name].to_pandas(types_mapper=COUNTED.get)
        rows = rows.drop_columns([name])
        pa.default_memory_pool().release_unused()  # the pool keeps what was freed
    return pd.DataFrame(columns, copy=False)


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
    narrow |= {name: _short(rows[name]) for name in COUNTS if name in rows.column_names}
    return pa.table({name: narrow.get(name, rows[name]) for name in rows.column_names})


def _short(counts: pa.ChunkedArray) -> pa.ChunkedArray:
    """Return counts in 32 bits if they fit."""
    try:
        return counts.cast(pa.int32())
    except pa.ArrowInvalid:
        return counts


def _rows(facts: StationFacts) -> float:
    """Return the number of rows, infinite where it is not known."""
    if facts.first_tick is None or facts.last_tick is None:
        return inf
    return (facts.last_tick - facts.first_tick + 1) * len(facts.ports)


def _columns(facts: StationFacts) -> tuple[str, ...]:
    """Return the columns that the report reads; on a grid of ticks the time of a row is not
    needed.
    """
    states = () if "temperature_c" in judged_signals(facts) else STATES
    return (
        *(() if facts.period_s else ("time",)),
        *COLUMNS,
        *states,
        *(AIR if has_air(facts) else ()),
    )


def _overview(overview: Overview) -> FigureFacts | None:
    if not overview.is_worth_it:
        return None
    text, (wide, narrow) = (
        overview.caption,
        (svg_text(overview.draw(form)) for form in (WIDE, NARROW)),
    )
    return FigureFacts("figures/overview.svg", text, f"Overview of the run. {text}", wide, narrow)
