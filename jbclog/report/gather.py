"""Collect the facts of a report from a sealed run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from math import inf

import pyarrow as pa

from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.marks import happenings
from jbclog.analysis.figures.style import NARROW, WIDE
from jbclog.analysis.figures.trace import Grid
from jbclog.analysis.joints.port_reader import at_once
from jbclog.analysis.port_split import by_port, gathered
from jbclog.analysis.rejudge import is_cut_off, own_version
from jbclog.analysis.run import Run
from jbclog.analysis.verdict.clock_steps import Step, steps_of
from jbclog.analysis.verdict.samples import KeptMeasures, Measuring
from jbclog.core.rows import StationFacts
from jbclog.report.alarms import alarm_facts
from jbclog.report.facts import CROWD, Facts, FigureFacts, StationReport, VerdictFacts
from jbclog.report.joints import Joints, unit_rows
from jbclog.report.overview import Overview
from jbclog.report.port_samples import PortSamples, columns_of
from jbclog.report.ports import Context, port_facts
from jbclog.report.repeated import of_run, of_station, ports_of
from jbclog.report.verdict import add_reasons, verdict_facts
from jbclog.report.zoom import share

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")  # docs/reference/configuration.md
GROUPS_KEPT = 32  # of row groups, until what they took is given back
MOST_ROWS = 8_000_000  # of several stations at once in memory, some 19 bytes each


def gather(run: Run, joints: Joints) -> Facts:
    """Return the facts of the report of `run`. Raises `RecordError`."""
    manifest = run.manifest
    overview = Overview(manifest.t0_utc_us)
    measuring = KeptMeasures()
    verdict = verdict_facts(run.folder, manifest, measuring)
    pa.default_memory_pool().release_unused()
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
    steps = tuple(steps_of(folder))
    by_name = {facts.name: facts for facts in manifest.stations}
    ports = sum(len(facts.ports) for facts in manifest.stations)
    context = Context(
        t0_utc_us=manifest.t0_utc_us,
        happenings=happenings(run.events(), manifest.t0_utc_us),
        settings=run.settings(),
        measures=measuring(folder, by_name, {}, own_version(manifest)),
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
    for number, (facts, samples) in enumerate(_samples(run, steps), 1):
        context.has_overview = len(manifest.stations) > 1 or len(samples) > 1
        yield _station(facts, number, samples, context)


def _station(
    facts: StationFacts, number: int, samples: dict[int, PortSamples], context: Context
) -> StationReport:
    """Return station `number` of the run, from its part of the manifest and the rows of each port,
    which are freed.
    """
    # the name in a manifest can be any text
    stem = facts.name if NAME.fullmatch(facts.name) else f"station-{number}"
    ports = [
        port_facts(facts, port, f"{stem}-{port}", samples, context)
        for port in ports_of(facts, sorted(samples))
    ]
    return StationReport(ports=ports, **of_station(facts, cut_off=context.cut_off))


def _samples(
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


def _overview(overview: Overview) -> FigureFacts | None:
    if not overview.is_worth_it:
        return None
    text, (wide, narrow) = (
        overview.caption,
        (svg_text(overview.draw(form)) for form in (WIDE, NARROW)),
    )
    return FigureFacts("figures/overview.svg", text, f"Overview of the run. {text}", wide, narrow)
