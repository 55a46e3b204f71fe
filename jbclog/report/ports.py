"""The stations of a report and their ports: readings, temperatures, power, and their figures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from jbclog.analysis.figures.canvas import svg_text
from jbclog.analysis.figures.curves import Readings, Span, blocks
from jbclog.analysis.figures.from_samples import (
    BOTH,
    CLOGGED,
    CONTROL,
    FLOW,
    OUT_OF_RANGE,
    PREPARING,
    SHORTAGE,
    SOLDER,
    SUCTION,
    TEMPERATURE,
)
from jbclog.analysis.figures.marks import Happening, limits_of, marks_of
from jbclog.analysis.figures.port import Scale, draw, scale_of
from jbclog.analysis.figures.style import NARROW, WIDE, Format
from jbclog.analysis.figures.trace import Air, Limit, MarkKind, Trace
from jbclog.analysis.run import Run
from jbclog.analysis.run_joints import spans_of
from jbclog.analysis.verdict import PortMeasure
from jbclog.analysis.verdict.clock_steps import steps_of
from jbclog.core.clock import utc_of, utc_text
from jbclog.core.rows import StationFacts, TipCheck
from jbclog.core.text import clean
from jbclog.record.manifest import Ledger
from jbclog.report.captions import caption, closer, closer_caption, description
from jbclog.report.facts import (
    AirFacts,
    FigureFacts,
    PortFacts,
    PowerFacts,
    RecordedFacts,
    StatesFacts,
    StationReport,
    TipFacts,
)
from jbclog.report.joints import Joints, joint_facts
from jbclog.report.overview import Overview
from jbclog.report.port_samples import PortSamples, samples_of_stations
from jbclog.report.repeated import (
    PortRows,
    due_readings,
    of_port,
    of_station,
    ports_of,
    verification,
)
from jbclog.report.zoom import zoom_of

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")  # docs/reference/configuration.md
MOST_GAPS = 50
ENERGIES = ("energy_permille_s", "energy_recorded_permille_s", "energy_j")


@dataclass(slots=True)
class Context:
    """The data that all ports of a run share."""

    t0_utc_us: int
    happenings: list[Happening]
    settings: pd.DataFrame
    measures: Mapping[tuple[str, int], PortMeasure]
    ledger: Ledger
    cut_off: bool
    overview: Overview
    has_overview: bool  # of a single port there is none
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
    """Return one port from its rows, which are taken out of `samples` and freed; the files of its
    figures begin with `file`.
    """
    rows = samples.pop(port)
    late_us = rows.late_us(0.99)  # before the trace: it takes as much memory
    drawn = replace(
        rows.trace(),
        limits=limits_of(context.settings, facts.name, port, context.t0_utc_us),
        marks=marks_of(context.happenings, facts.name, port),
        joints=spans_of(context.joints.of_port(facts.name, port)),
    )
    measure = context.measures.get((facts.name, port))
    recorded = _recorded(
        rows.rows, late_us, drawn, measure, due_readings(context.ledger, facts, port)
    )
    seen = PortRows(rows.rows, _last(drawn.temperature), rows.last_status)
    pa.default_memory_pool().release_unused()
    if seen.number and context.has_overview:
        context.overview.add(
            clean(f"{facts.name} · {port}"), drawn, recorded.coverage_percent, _cold(drawn, measure)
        )
    has_tip = not drawn.states and drawn.air is None
    found = PortFacts(
        recorded=recorded,
        tip=_tip(drawn, measure),
        power=_power(drawn, context.joints.metrics_of(facts.name, port)),
        states=_states_facts(drawn.states) if drawn.states else None,
        air=None if drawn.air is None else _air_facts(drawn.air),
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
    pa.default_memory_pool().release_unused()
    if has_tip:
        found.joints = joint_facts(context.joints, facts.name, port, file, crowded=context.crowded)
    return found


def _cold(drawn: Trace, measure: PortMeasure | None) -> str | None:
    """Return in a word or two how a tool with a setpoint never reached it."""
    if (
        measure is None
        or measure.heat.arrived_s is not None
        or not np.any(~np.isnan(drawn.setting))
    ):
        return None
    return "not reached" if measure.heat.stretches else "not at work"


def _states_facts(lanes: Mapping[str, list[Span]]) -> StatesFacts:
    """Return for how many seconds each unwanted state held; None where it was never read."""
    return StatesFacts(
        shortage_s=_held_s(lanes[SOLDER], SHORTAGE, BOTH),
        clogged_s=_held_s(lanes[SOLDER], CLOGGED, BOTH),
        preparing_s=_held_s(lanes[CONTROL], PREPARING),
        out_of_range_s=_held_s(lanes[TEMPERATURE], OUT_OF_RANGE),
    )


def _held_s(spans: list[Span], *words: str) -> float | None:
    return float(np.sum([span.seconds for span in spans if span.word in words])) if spans else None


def _air_facts(air: Air) -> AirFacts:
    """Return the figures of hot air."""
    known, flow = air.external[~np.isnan(air.external)], air.lanes.get(FLOW, [])
    return AirFacts(
        flow_permille=float(flow[-1].word.removesuffix(" ‰")) if flow else None,
        external_least_c=float(known.min()) if len(known) else None,
        external_greatest_c=float(known.max()) if len(known) else None,
        suctions=len(air.lanes.get(SUCTION, [])),
    )


def _recorded(
    rows: int, late_us: float | None, drawn: Trace, measure: PortMeasure | None, due: int
) -> RecordedFacts:
    readings = 0 if measure is None else measure.readings
    return RecordedFacts(
        rows=rows,
        due=due,
        readings=readings,
        coverage_percent=100 * readings / due if due else None,
        longest_gap_s=None if measure is None else measure.gap_s,
        late_p99_ms=None if late_us is None else late_us / 1000,
        gaps=[_gap(gap, drawn.grid.t0_utc_us) for gap in drawn.longest_gaps[:MOST_GAPS]],
    )


def _gap(gap: Span, t0_utc_us: int) -> dict[str, object]:
    start = utc_text(utc_of(t0_utc_us + round(gap.start * 1e6)))
    return {"from": start, "seconds": round(gap.seconds, 6), "why": gap.word}


def _tip(drawn: Trace, measure: PortMeasure | None) -> TipFacts:
    bounds = None if measure is None else measure.idle.bounds
    return TipFacts(
        set_c=_last(drawn.setting),
        alarm_high_c=_limit(drawn.limits, "high"),
        alarm_low_c=_limit(drawn.limits, "low"),
        least_c=_extreme(drawn.temperature, np.min),
        greatest_c=_extreme(drawn.temperature, np.max),
        idle_error_c=None if measure is None else measure.idle.mean_c,
        idle_sd_c=None if measure is None else measure.idle.sd_c,
        idle_error_bound=None if bounds is None else bounds[0],
        idle_sd_bound=None if bounds is None else bounds[1],
    )


def _power(drawn: Trace, metrics: Mapping[str, Mapping[str, object]]) -> PowerFacts:
    """Return the power figures; energies are those of the metrics."""
    whole, recorded, joules = (metrics.get(name, {}).get("value") for name in ENERGIES)
    why = metrics.get(ENERGIES[0], {}).get("why")
    highest = _extreme(drawn.power, np.max)
    return PowerFacts(
        highest,
        _float(whole),
        _float(recorded),
        _float(joules),
        None if not isinstance(joules, float) else joules / 3600,
        None if why is None or highest is None else str(why),
    )


def _float(value: object) -> float | None:
    return value if isinstance(value, float) else None


def _extreme(values: Readings, which: Callable[[Readings], np.floating[Any]]) -> float | None:
    """Return the least or greatest of the values that are known, without a copy of all."""
    parts = (values[rows] for rows in blocks(len(values)))
    found = [float(which(known)) for part in parts if len(known := part[~np.isnan(part)])]
    return float(which(np.array(found, dtype=np.float64))) if found else None


def _last(values: Readings) -> float | None:
    """Return the last value that is known."""
    for rows in reversed([*blocks(len(values))]):
        known = np.flatnonzero(~np.isnan(values[rows]))
        if len(known):
            return float(values[rows][known[-1]])
    return None


def _limit(limits: Sequence[Limit], side: str) -> float | None:
    return next((_last(np.array(limit.celsius)) for limit in limits if limit.side == side), None)


def _figures(file: str, place: str, drawn: Trace, context: Context) -> list[FigureFacts]:
    """Return the figure of the whole run and, where that is long, one of a minute of it."""
    figures = [
        _figure(
            f"figures/{file}.svg", caption(drawn), description(place, drawn), drawn, context.crowded
        )
    ]
    pa.default_memory_pool().release_unused()
    figures[0].zoom = zoom_of(drawn, context.zoom)
    pa.default_memory_pool().release_unused()
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
