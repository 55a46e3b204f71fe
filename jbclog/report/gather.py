"""Gathers the facts of a report from a sealed run."""

from __future__ import annotations

from dataclasses import asdict

import pyarrow as pa

from jbclog.analysis.figures.canvas import styled, svg_text
from jbclog.analysis.figures.marks import happenings, limits_of
from jbclog.analysis.figures.style import NARROW, WIDE
from jbclog.analysis.rejudge import is_cut_off
from jbclog.analysis.run import Run
from jbclog.analysis.run_alarms import Alarms
from jbclog.analysis.verdict.samples import KeptMeasures, Measuring
from jbclog.report.alarms import alarm_facts
from jbclog.report.facts import CROWD, Facts, FigureFacts, VerdictFacts
from jbclog.report.joints import Joints, unit_rows
from jbclog.report.overview import Overview
from jbclog.report.ports import Context, station_reports
from jbclog.report.record_facts import of_run
from jbclog.report.verdict import add_reasons, verdict_facts
from jbclog.report.zoom import share


def gather(run: Run, joints: Joints, alarms: Alarms) -> Facts:
    """Return the facts of the report of `run`. Raises `RecordError`."""
    manifest = run.manifest
    overview = Overview(manifest.t0_utc_us)
    measuring = KeptMeasures()
    verdict = verdict_facts(run.folder, manifest, measuring)
    pa.default_memory_pool().release_unused()
    context = _context(run, joints, overview, verdict, measuring)
    with styled():  # once, because each figure would set it twice
        stations, shown = list(station_reports(run, context)), _overview(overview)
    add_reasons(verdict, [asdict(station) for station in stations], cut_off=is_cut_off(manifest))
    return Facts(
        verdict=verdict,
        overview=shown,
        stations=stations,
        alarms=alarm_facts(alarms),
        units=unit_rows(joints),
        metrics=joints.metrics,
        **of_run(run),
    )


def _context(
    run: Run, joints: Joints, overview: Overview, verdict: VerdictFacts, measuring: Measuring
) -> Context:
    manifest = run.manifest
    by_name = {facts.name: facts for facts in manifest.stations}
    ports = sum(len(facts.ports) for facts in manifest.stations)
    return Context(
        happenings=happenings(run.events(), manifest.t0_utc_us),
        limits=limits_of(run.settings(), manifest.t0_utc_us),
        measures=measuring(run.folder, by_name, {}),
        ledger=manifest.ledger,
        cut_off=is_cut_off(manifest),
        overview=overview,
        has_overview=True,
        joints=joints,
        checks={(one.station, one.port): one for one in manifest.verifications},
        rules=verdict.rules,
        crowded=ports > CROWD,
        zoom=share(ports),
    )


def _overview(overview: Overview) -> FigureFacts | None:
    if not overview.is_worth_it:
        return None
    text, (wide, narrow) = (
        overview.caption,
        (svg_text(overview.draw(form)) for form in (WIDE, NARROW)),
    )
    return FigureFacts("figures/overview.svg", text, f"Overview of the run. {text}", wide, narrow)
