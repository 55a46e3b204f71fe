"""The stations of a report: what each is and how its run ended."""

from __future__ import annotations

import re

from jbclog.core.rows import StationFacts
from jbclog.report.facts import StationReport
from jbclog.report.port_samples import PortSamples
from jbclog.report.ports import Context, port_facts
from jbclog.report.repeated import of_station, ports_of

NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,63}")  # docs/reference/configuration.md


def station_report(
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
