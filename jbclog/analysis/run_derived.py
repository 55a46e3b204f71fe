"""All tables that are derived from a run (`derived_schemas`), from a pass over its samples for each
kind.
"""

from __future__ import annotations

from dataclasses import replace

import pyarrow as pa

from jbclog.analysis.derived_files import metrics_table
from jbclog.analysis.derived_schemas import ACCOUNTING_SCHEMA, OTHER, REASONS, TIPS_SCHEMA
from jbclog.analysis.run_alarms import Alarms
from jbclog.analysis.run_gaps import gap_rows
from jbclog.analysis.run_metrics import Measures
from jbclog.analysis.run_tables import RunTables
from jbclog.analysis.run_units import units_of
from jbclog.record.ledger import COUNTER_COLUMNS, SAMPLE_COLUMNS, ledger_in
from jbclog.record.manifest import Manifest


def derived_tables(run: RunTables, measures: Measures, alarms: Alarms) -> dict[str, pa.Table]:
    """Return every derived table by its name, from what was already computed of the run. Raises
    `RecordError`.
    """
    manifest = run.manifest
    gaps = gap_rows(run)
    return {
        "joints": measures.joints,
        "alarms": alarms.table(),
        "units": units_of(run, measures, alarms, gaps),
        "tips": tips_of(manifest),
        "metrics": metrics_table(measures.metrics, manifest.run),
        "accounting": accounting_of(manifest),
        "gaps": gaps,
    }


def tips_of(manifest: Manifest) -> pa.Table:
    """Return a row for each port whose tip was named at the start of the run."""
    rows: list[dict[str, object]] = []
    for facts in manifest.stations:
        for port in facts.ports:
            tip = manifest.metadata.tip(facts.name, port)
            if tip is not None:
                rows.append({"run": manifest.run, "station": facts.name, "port": port, "tip": tip})
    return pa.Table.from_pylist(rows, TIPS_SCHEMA)


def accounting_of(manifest: Manifest) -> pa.Table:
    """Return a row for each signal: readings due, obtained, and missing for each reason."""
    rows: list[dict[str, object]] = []
    for station, ports in manifest.ledger.items():
        for port, signals in ports.items():
            for signal, counts in signals.items():
                row: dict[str, object] = {
                    "run": manifest.run,
                    "station": station,
                    "port": int(port) if port.isdigit() else None,
                    "signal": signal,
                }
                rows.append(row | _counted(counts))
    return pa.Table.from_pylist(rows, ACCOUNTING_SCHEMA)


def manifest_now(run: RunTables) -> Manifest:
    """Return the manifest; that of a run that is not sealed with the stations that are known by now
    and, as accounting, that of the rows that are committed. Raises `RecordError`.
    """
    manifest, stations = run.manifest, run.stations
    if manifest.is_sealed:
        return manifest
    samples = run.groups("samples", SAMPLE_COLUMNS)
    ledger = ledger_in(samples, run.groups("counters", COUNTER_COLUMNS), stations)
    return replace(manifest, stations=stations, ledger=ledger)


def _counted(counts: dict[str, int]) -> dict[str, int]:
    """Return due, obtained and each reason; refusals by any number are one reason."""
    counted = {"due": counts["due"], "obtained": counts["ok"], **dict.fromkeys(REASONS, 0)}
    for word, count in counts.items():
        if word in ("due", "ok"):
            continue
        reason = "nak" if word.startswith("nak") else word
        counted[reason if reason in REASONS else OTHER] += count
    return counted
