"""Collect the facts of a report from a sealed run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import inf
from typing import cast

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.from_samples import AIR_COLUMNS as AIR
from jbclog.analysis.figures.from_samples import STATE_COLUMNS as STATES
from jbclog.analysis.figures.from_samples import has_air
from jbclog.analysis.figures.marks import happenings
from jbclog.analysis.figures.style import NARROW, WIDE
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

MOST_ROWS = 200_000  # of several stations at once in memory
TEXTS = ("quality", "reasons", "status")
READINGS = ("temperature_c", "power_permille", "set_c")
COLUMNS = ("tick", "port", "late_us", "quality", "reasons", "temperature_c", "power_permille", "status", "set_c")


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


def _stations(run: Run, joints: Joints, overview: Overview, verdict: VerdictFacts, measuring: Measuring) -> Iterator[StationReport]:
    """Yield one station after the other."""
    manifest, folder = run.manifest, run.folder
    t0_utc_us = round((manifest.t0_utc or 0.0) * 1e6)
    ports = sum(len(facts.ports) for facts in manifest.stations)
    context = Context(
        t0_utc_us,
        happenings(run.events(), t0_utc_us),
        run.settings(),
        measuring(folder, {facts.name: facts for facts in manifest.stations}, {}, own_version(manifest)),
        manifest.ledger,
        is_cut_off(manifest),
        tuple(steps_of(folder)),
        overview,
        joints,
        {(one.station, one.port): one for one in manifest.verifications},
        verdict.rules,
        ports > CROWD,
        share(ports),
    )
    for number, (facts, samples) in enumerate(_samples(run), 1):
        yield station_report(facts, number, samples, context)


def _samples(run: Run) -> Iterator[tuple[StationFacts, pd.DataFrame]]:
    """Yield the samples of each station, from one pass over a short run, from a pass for each station of a long one."""
    stations = run.manifest.stations
    columns = {facts.name: _columns(facts) for facts in stations}
    if sum(map(_rows, stations)) > MOST_ROWS:
        for facts in stations:
            yield facts, _compact(run, facts.name, columns[facts.name])
        return
    every = run.samples(columns=["station", *dict.fromkeys(name for some in columns.values() for name in some)])
    for facts in stations:
        yield facts, every.loc[every["station"] == facts.name, list(columns[facts.name])].reset_index(drop=True)


def _compact(run: Run, station: str, columns: Sequence[str]) -> pd.DataFrame:
    """Return the samples of one station in a fifth of the memory of `Run.samples`: equal texts once, readings in 32 bits."""
    groups = run.groups("samples", ["station", *columns])
    own = (group.filter(pc.equal(group["station"], station)).select(columns) for group in groups)
    none = SCHEMAS["samples"].empty_table().select(columns)
    table = pa.concat_tables([_narrow(none), *map(_narrow, own)]).unify_dictionaries()
    return cast(pd.DataFrame, table.to_pandas(split_blocks=True, self_destruct=True))


def _narrow(rows: pa.Table) -> pa.Table:
    """Return rows with dictionaries for texts, and readings (whole numbers of at most six digits) as floats, NaN for null."""
    narrow = {name: rows[name].dictionary_encode() for name in TEXTS if name in rows.column_names}
    narrow |= {name: rows[name].cast(pa.float32(), safe=False) for name in READINGS if name in rows.column_names}
    return pa.table({name: narrow.get(name, rows[name]) for name in rows.column_names})


def _rows(facts: StationFacts) -> float:
    """Return the number of rows, infinite where it is not known."""
    if facts.first_tick is None or facts.last_tick is None:
        return inf
    return (facts.last_tick - facts.first_tick + 1) * len(facts.ports)


def _columns(facts: StationFacts) -> tuple[str, ...]:
    """Return the columns that the report reads; on a grid of ticks the time of a row is not needed."""
    states = () if "temperature_c" in judged_signals(facts) else STATES
    return (*(() if facts.period_s else ("time",)), *COLUMNS, *states, *(AIR if has_air(facts) else ()))


def _overview(overview: Overview) -> FigureFacts | None:
    if not overview.is_worth_it:
        return None
    text, (wide, narrow) = overview.caption, (svg_text(overview.draw(form)) for form in (WIDE, NARROW))
    return FigureFacts("figures/overview.svg", text, f"Overview of the run. {text}", wide, narrow)
