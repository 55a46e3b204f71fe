"""The stations of a report: what each is and how its run ended."""

from __future__ import annotations

import re

import pandas as pd

from jbclog.core.rows import StationFacts
from jbclog.report.facts import StationReport
from jbclog.report.ports import Context, port_facts

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")  # docs/reference/configuration.md
CUT_OFF = "cut off"
BROKE_OFF = "The record ends while this station was still active."


def station_report(facts: StationFacts, number: int, samples: pd.DataFrame, context: Context) -> StationReport:
    """Return station `number` of the run, from its part of the manifest and all of its rows."""
    stem = facts.name if NAME.fullmatch(facts.name) else f"station-{number}"  # the name in a manifest can be any text
    seen = {int(port) for port in samples["port"].unique()}
    ports = sorted({*facts.ports, *seen})
    broke_off = context.cut_off and facts.outcome == "running"
    turnaround = facts.turnaround_us.get("median")
    return StationReport(
        name=facts.name,
        family=facts.family,
        model=facts.model,
        model_accepted=facts.model_accepted,
        software=facts.software,
        url=facts.url,
        address=facts.address,
        wire=f"{facts.baudrate} {facts.format}",
        turnaround_ms=None if turnaround is None else turnaround / 1000,
        period_s=facts.period_s,
        recipe=facts.recipe,
        rated_power_w=facts.rated_power_w,
        not_supported=sorted(facts.not_supported),
        outcome=CUT_OFF if broke_off else facts.outcome,
        reason=facts.reason or (BROKE_OFF if broke_off else ""),
        outages=facts.outages,
        skipped_ticks=facts.skipped,
        garbage_bytes=facts.garbage_bytes,
        ports=[port_facts(facts, port, f"{stem}-{port}", _of_port(samples, port, seen), context) for port in ports],
    )


def _of_port(samples: pd.DataFrame, port: int, seen: set[int]) -> pd.DataFrame:
    """Return the rows of one port, without a copy where there are no others."""
    return samples if seen == {port} else samples[samples["port"] == port]
