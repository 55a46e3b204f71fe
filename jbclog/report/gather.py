"""Collect the facts of a report from a sealed run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from hashlib import sha256
from math import inf
from typing import cast

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from jbclog import __version__
from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.from_samples import AIR_COLUMNS as AIR
from jbclog.analysis.figures.from_samples import STATE_COLUMNS as STATES
from jbclog.analysis.figures.from_samples import has_air
from jbclog.analysis.figures.marks import happenings
from jbclog.analysis.figures.style import NARROW, WIDE
from jbclog.analysis.rejudge import is_cut_off, own_version
from jbclog.analysis.run import Run
from jbclog.analysis.verdict import RULES, judged_signals
from jbclog.analysis.verdict.clock_steps import steps_of
from jbclog.analysis.verdict.samples import KeptMeasures, Measuring
from jbclog.core.rows import StationFacts
from jbclog.record.annotations import read as read_annotations
from jbclog.record.chains import short_head
from jbclog.record.manifest import Manifest, manifest_sha256
from jbclog.record.schema import SCHEMAS
from jbclog.report.alarms import alarm_facts
from jbclog.report.facts import (
    CROWD,
    NOT_CLAIMED,
    NOT_CLAIMED_SHORT,
    REPRODUCE,
    SCHEMA,
    TO_SIGN,
    Facts,
    FigureFacts,
    Reason,
    StationReport,
    VerdictFacts,
)
from jbclog.report.joint_words import jointed, never_back_at
from jbclog.report.joints import Joints, unit_rows
from jbclog.report.overview import Overview
from jbclog.report.ports import Context
from jbclog.report.stations import station_report
from jbclog.report.tables import by_station, counter_rows, event_rows, ledger_rows, setting_rows
from jbclog.report.verdict import verdict_facts
from jbclog.report.zoom import share

MOST_ROWS = 200_000  # of several stations at once in memory
TEXTS = ("quality", "reasons", "status")
READINGS = ("temperature_c", "power_permille", "set_c")
COLUMNS = ("tick", "port", "late_us", "quality", "reasons", "temperature_c", "power_permille", "status", "set_c")


def gather(run: Run, joints: Joints) -> Facts:
    """Return the facts of the report of `run`. Raises `RecordError`."""
    manifest, folder = run.manifest, run.folder
    events, settings_left = event_rows(run.events()), setting_rows(run.settings())
    ledger, reasons = ledger_rows(manifest.ledger)
    head = manifest_sha256(folder)
    overview = Overview(round((manifest.t0_utc or 0.0) * 1e6))
    measuring, annotations = KeptMeasures(), read_annotations(folder)
    verdict = verdict_facts(folder, manifest, measuring)
    stations = list(_stations(run, joints, overview, verdict, measuring))
    names = [facts.name for facts in manifest.stations]
    rows = jointed({"stations": [asdict(station) for station in stations]})
    first = 1 if is_cut_off(manifest) else 0
    verdict.reasons[first:first] = [Reason("none", text) for text in never_back_at(rows)]
    if is_cut_off(manifest):
        verdict.reasons[1:1] = list(_not_made_safe(stations))
    return Facts(
        schema=SCHEMA,
        rules=RULES,
        run=manifest.run,
        manifest_sha256=head,
        head=short_head(head),
        previous=_previous(manifest),
        jbclog=__version__,
        verdict=verdict,
        state=manifest.state,
        exit_status=manifest.exit_status,
        exit_code=manifest.exit_code,
        lost=None if manifest.lost is None else manifest.lost.text,
        started=manifest.started,
        ended=manifest.ended,
        duration_s=_duration_s(manifest),
        rate=_rate(manifest),
        guard=manifest.guard,
        line={} if manifest.line is None else asdict(manifest.line),
        recipes=[asdict(recipe) for recipe in manifest.recipes],
        metadata=_metadata(manifest),
        host=dict(manifest.host),
        overview=_overview(overview),
        stations=stations,
        alarms=alarm_facts(run),
        units=unit_rows(joints),
        metrics=joints.metrics,
        events=events[0],
        events_left=events[1],
        settings=by_station(settings_left[0], names),
        settings_left=settings_left[1],
        counters=by_station(counter_rows(run.counters()), names),
        ledger=by_station(ledger, names),
        ledger_reasons=reasons,
        files=[asdict(file) for file in manifest.files],
        data_sha256=_data_sha256(manifest),
        annotations=[asdict(one) for one in annotations.said],
        annotations_head=annotations.head,
        annotations_wrong=annotations.complaints(),
        not_claimed=list(NOT_CLAIMED),
        not_claimed_short=list(NOT_CLAIMED_SHORT),
        to_sign=[dict(one) for one in TO_SIGN],
        reproduce=REPRODUCE,
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


def _not_made_safe(stations: list[StationReport]) -> Iterator[Reason]:
    """Yield a sentence for each tool that may still be hot: after a crash the operator has had no message."""
    for station in stations:
        for port in station.ports:
            if port.left_warns:
                yield Reason("fail", f"{station.name} port {port.port}: {port.left}.")


def _previous(manifest: Manifest) -> str:
    """Return the previous run with its fingerprint, or why there is none."""
    found = manifest.previous
    if found is None:
        return "not known"
    return f"{found.run} (fingerprint {short_head(found.sha256)})" if found.run and found.sha256 else found.text


def _metadata(manifest: Manifest) -> dict[str, object]:
    """Return the metadata of the run that people entered."""
    return {**replace(manifest.metadata, units=manifest.serials()).said()}


def _data_sha256(manifest: Manifest) -> str:
    lines = (f"{file.sha256}  {file.path}\n" for file in sorted(manifest.files, key=lambda file: file.path))
    return sha256("".join(lines).encode()).hexdigest()


def _duration_s(manifest: Manifest) -> float | None:
    if manifest.started is None or manifest.ended is None:
        return None
    return (datetime.fromisoformat(manifest.ended) - datetime.fromisoformat(manifest.started)).total_seconds()


def _rate(manifest: Manifest) -> str:
    """Return the requested rate, and the actual rate of each station where it is recorded."""
    if isinstance(manifest.rate, float):
        return f"{manifest.rate:g} Hz"
    known = {facts.name: facts for facts in manifest.stations if facts.asked_rate is not None}
    if not known:  # a record of release 1
        return str(manifest.rate or "not known")
    texts = {name: _rate_of(facts) for name, facts in known.items()}
    return next(iter(texts.values())) if len({*texts.values()}) == 1 else "; ".join(f"{name} {texts[name]}" for name in texts)


def _rate_of(facts: StationFacts) -> str:
    if isinstance(facts.asked_rate, float):
        return f"{facts.asked_rate:g} Hz"
    return str(facts.asked_rate) if facts.rate_hz is None else f"{facts.rate_hz:g} Hz ({facts.asked_rate})"
