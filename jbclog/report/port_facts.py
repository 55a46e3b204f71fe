"""The facts of a port: its readings, temperatures, power and states, from its trace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from jbclog.analysis.figures.curves import Readings, Span, blocks, extreme
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
from jbclog.analysis.figures.trace import Air, Limit, Trace
from jbclog.analysis.gaps import Gap
from jbclog.analysis.verdict import PortMeasure
from jbclog.core.clock import utc_of, utc_text
from jbclog.report.facts import AirFacts, PowerFacts, RecordedFacts, StatesFacts, TipFacts

MOST_GAPS: Final = 50
ENERGIES: Final = ("energy_permille_s", "energy_recorded_permille_s", "energy_j")


def coldness(drawn: Trace, measure: PortMeasure | None) -> str | None:
    """Return in a word or two how a tool with a setpoint never reached it."""
    if (
        measure is None
        or measure.heat.arrived_s is not None
        or not np.any(~np.isnan(drawn.setting))
    ):
        return None
    return "not reached" if measure.heat.stretches else "not at work"


def states_facts(lanes: Mapping[str, list[Span]]) -> StatesFacts:
    """Return the seconds of each unwanted state; None if it was never read."""
    return StatesFacts(
        shortage_s=_held_s(lanes[SOLDER], SHORTAGE, BOTH),
        clogged_s=_held_s(lanes[SOLDER], CLOGGED, BOTH),
        preparing_s=_held_s(lanes[CONTROL], PREPARING),
        out_of_range_s=_held_s(lanes[TEMPERATURE], OUT_OF_RANGE),
    )


def _held_s(spans: list[Span], *words: str) -> float | None:
    return float(np.sum([span.seconds for span in spans if span.word in words])) if spans else None


def air_facts(air: Air) -> AirFacts:
    """Return the figures of hot air."""
    known, flow = air.external[~np.isnan(air.external)], air.lanes.get(FLOW, [])
    return AirFacts(
        flow_permille=float(flow[-1].word.removesuffix(" ‰")) if flow else None,
        external_least_c=float(known.min()) if len(known) else None,
        external_greatest_c=float(known.max()) if len(known) else None,
        suctions=len(air.lanes.get(SUCTION, [])),
    )


def recorded_facts(
    rows: int, late_us: float | None, measure: PortMeasure | None, due: int
) -> RecordedFacts:
    readings = 0 if measure is None else measure.readings
    gaps = [] if measure is None else longest(measure.gaps)
    return RecordedFacts(
        rows=rows,
        due=due,
        readings=readings,
        coverage_percent=100 * readings / due if due else None,
        longest_gap_s=None if measure is None else measure.gap_s,
        late_p99_ms=None if late_us is None else late_us / 1000,
        gaps=[_gap(gap) for gap in gaps],
    )


def longest(gaps: Iterable[Gap]) -> list[Gap]:
    """Return the longest gaps, the longest first; gaps of one length in order."""
    return sorted(gaps, key=lambda gap: (-gap.seconds, gap.start_us))[:MOST_GAPS]


def _gap(gap: Gap) -> dict[str, object]:
    return {
        "start": utc_text(utc_of(gap.start_us)),
        "stop": utc_text(utc_of(gap.stop_us)),
        "seconds": gap.seconds,
        "missing": gap.missing,
        "reasons": gap.reasons_text,
        "at_least": gap.at_least,
    }


def tip_facts(drawn: Trace, measure: PortMeasure | None) -> TipFacts:
    bounds = None if measure is None else measure.idle.bounds()
    if isinstance(bounds, str):
        bounds = None
    return TipFacts(
        setpoint_c=last_known(drawn.setting),
        alarm_high_c=_limit(drawn.limits, "high"),
        alarm_low_c=_limit(drawn.limits, "low"),
        least_c=extreme(drawn.temperature, np.min),
        greatest_c=extreme(drawn.temperature, np.max),
        idle_error_c=None if measure is None else measure.idle.mean_c,
        idle_sd_c=None if measure is None else measure.idle.sd_c,
        idle_error_bound=None if bounds is None else bounds.mean,
        idle_sd_bound=None if bounds is None else bounds.sd,
    )


def power_facts(drawn: Trace, metrics: Mapping[str, Mapping[str, object]]) -> PowerFacts:
    """Return the power figures; energies are those of the metrics."""
    whole, recorded, joules = (metrics.get(name, {}).get("value") for name in ENERGIES)
    why = metrics.get(ENERGIES[0], {}).get("why")
    highest = extreme(drawn.power, np.max)
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


def last_known(values: Readings) -> float | None:
    """Return the last value that is known."""
    for rows in reversed([*blocks(len(values))]):
        known = np.flatnonzero(~np.isnan(values[rows]))
        if len(known):
            return float(values[rows][known[-1]])
    return None


def _limit(limits: Sequence[Limit], side: str) -> float | None:
    return next(
        (last_known(np.array(limit.celsius)) for limit in limits if limit.side == side), None
    )
