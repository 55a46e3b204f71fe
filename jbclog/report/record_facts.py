"""Fields of a report that repeat its record: manifest, annotations and the tables of events,
settings and counters.

Values computed from the samples (joints, metrics, figures, alarms) are not here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from hashlib import sha256
from typing import Any, NamedTuple

from jbclog import __version__
from jbclog.analysis.figures.from_samples import has_air
from jbclog.analysis.run import Run
from jbclog.analysis.verdict import RULES, judged_signals
from jbclog.core.rows import StationFacts, TipCheck
from jbclog.core.states import StationOutcome
from jbclog.record.annotations import read as read_annotations
from jbclog.record.chains import short_head
from jbclog.record.clock_steps import start_doubt
from jbclog.record.manifest import Ledger, Manifest, manifest_sha256
from jbclog.report.facts import NOT_CLAIMED, NOT_CLAIMED_SHORT, SCHEMA, TO_SIGN
from jbclog.report.safety import end_state, verification_facts
from jbclog.report.tables import (
    COUNTER_COLUMNS,
    by_station,
    counter_rows,
    event_rows,
    ledger_rows,
    setting_rows,
)

CUT_OFF = "cut off"
BROKE_OFF = "The record ends while this station was still active."


class PortRows(NamedTuple):
    """The number of a port's rows in `samples`, and its last temperature and status there."""

    number: int = 0
    temperature_c: float | None = None
    status: str | None = None


def of_run(run: Run) -> dict[str, Any]:
    """Return these fields of `Facts`, all but `verdict` and `stations`. Raises `RecordError`."""
    manifest, head, said = run.manifest, manifest_sha256(run.folder), read_annotations(run.folder)
    stated = {"schema": SCHEMA, "rules": RULES, "jbclog": __version__}
    lists = {
        "not_claimed": [*NOT_CLAIMED],
        "not_claimed_short": [*NOT_CLAIMED_SHORT],
        "to_sign": [dict(one) for one in TO_SIGN],
    }
    heads = {"manifest_sha256": head, "head": short_head(head), "previous": _previous(manifest)}
    annotations = {
        "annotations": [asdict(one) for one in said.said],
        "annotations_head": said.head,
        "annotations_wrong": said.complaints(),
    }
    return {**stated, **lists, **heads, **annotations, **_of_manifest(manifest), **_of_tables(run)}


def _of_manifest(manifest: Manifest) -> dict[str, Any]:
    return {
        "run": manifest.run,
        "state": manifest.state,
        "exit_status": manifest.exit_status,
        "exit_code": manifest.exit_code,
        "lost": None if manifest.lost is None else manifest.lost.text,
        "start": manifest.start,
        "stop": manifest.stop,
        "duration_s": _duration_s(manifest),
        "clock_wrong": start_doubt(manifest.start, manifest.clock_steps or ()),
        "rate": _rate(manifest),
        "guard": manifest.guard,
        "line": {} if manifest.line is None else asdict(manifest.line),
        "recipes": [asdict(recipe) for recipe in manifest.recipes],
        "metadata": {**replace(manifest.metadata, units=manifest.serials()).said()},
        "host": dict(manifest.host),
        "files": [file.in_report() for file in manifest.files],
        "data_sha256": _data_sha256(manifest),
    }


def _of_tables(run: Run) -> dict[str, Any]:
    names = [facts.name for facts in run.manifest.stations]
    events, settings = event_rows(run.events()), setting_rows(run.settings())
    counters = counter_rows(run.groups("counters", [*COUNTER_COLUMNS]), run.folder)
    ledger, reasons = ledger_rows(run.manifest.ledger)
    return {
        "events": events[0],
        "events_left": events[1],
        "settings": by_station(settings[0], names),
        "settings_left": settings[1],
        "counters": by_station(counters, names),
        "ledger": by_station(ledger, names),
        "ledger_reasons": reasons,
    }


def of_station(facts: StationFacts, *, cut_off: bool) -> dict[str, Any]:
    """Return the fields of `StationReport` without its ports."""
    broke_off = cut_off and facts.outcome == StationOutcome.RUNNING
    turnaround = facts.turnaround_us.get("median")
    return {
        "name": facts.name,
        "family": facts.family,
        "model": facts.model,
        "model_accepted": facts.model_accepted,
        "software": facts.software,
        "url": facts.url,
        "address": facts.address,
        "wire": f"{facts.baudrate} {facts.format}",
        "turnaround_ms": None if turnaround is None else turnaround / 1000,
        "period_s": facts.period_s,
        "recipe": facts.recipe,
        "rated_power_w": facts.rated_power_w,
        "not_supported": sorted(facts.not_supported),
        "outcome": CUT_OFF if broke_off else facts.outcome,
        "reason": facts.reason or (BROKE_OFF if broke_off else ""),
        "outages": facts.outages,
        "skipped_ticks": facts.skipped,
        "garbage_bytes": facts.garbage_bytes,
    }


def of_port(facts: StationFacts, port: int, rows: PortRows, *, cut_off: bool) -> dict[str, Any]:
    """Return the fields of `PortFacts` that repeat the manifest and the last readings, and the
    state in which the run left the port.
    """
    celsius = facts.last_temperature_c.get(port, rows.temperature_c)
    how = end_state(facts, port, celsius, rows.status, cut_off)
    return {
        "port": port,
        "tool_name": facts.tool_names.get(port),
        "touched": port in facts.touched,
        "safe_state": facts.safe_state.get(port),
        "last_temperature_c": celsius,
        "last_status": rows.status,
        "left": how.word,
        "left_means": how.meaning,
        "left_warns": how.warn,
    }


def verification(
    facts: StationFacts, port: int, check: TipCheck | None, rules: Sequence[Mapping[str, object]]
) -> dict[str, object] | None:
    """Return the tip verification that was valid when the run began; None for a tool without a
    tip.
    """
    has_tip = "temperature_c" in judged_signals(facts) and not has_air(facts)
    return (
        verification_facts(check, rules, facts.name, port) if has_tip or check is not None else None
    )


def due_readings(ledger: Ledger, facts: StationFacts, port: int) -> int:
    """Return how many readings of the judged signals were due at a port."""
    counts = ledger.get(facts.name, {}).get(str(port), {})
    return sum(counts.get(signal, {}).get("due", 0) for signal in judged_signals(facts))


def ports_of(facts: StationFacts, seen: Sequence[int]) -> list[int]:
    """Return the ports of a station: those of the manifest, and those with rows."""
    return sorted({*facts.ports, *seen})


def _previous(manifest: Manifest) -> str:
    """Return the previous run with its fingerprint, or why there is none."""
    found = manifest.previous
    if found is None:
        return "not known"
    return (
        f"{found.run} (fingerprint {short_head(found.sha256)})"
        if found.run and found.sha256
        else found.text
    )


def _data_sha256(manifest: Manifest) -> str:
    lines = (
        f"{file.sha256}  {file.path}\n"
        for file in sorted(manifest.files, key=lambda file: file.path)
    )
    return sha256("".join(lines).encode()).hexdigest()


def _duration_s(manifest: Manifest) -> float | None:
    if manifest.start is None or manifest.stop is None:
        return None
    return (
        datetime.fromisoformat(manifest.stop) - datetime.fromisoformat(manifest.start)
    ).total_seconds()


def _rate(manifest: Manifest) -> str:
    """Return the requested rate, and the actual rate of each station if recorded."""
    if isinstance(manifest.rate, float):
        return f"{manifest.rate:g} Hz"
    known = {facts.name: facts for facts in manifest.stations if facts.asked_rate is not None}
    if not known:  # a run of 0.1.0
        return str(manifest.rate or "not known")
    texts = {name: _rate_of(facts) for name, facts in known.items()}
    return (
        next(iter(texts.values()))
        if len({*texts.values()}) == 1
        else "; ".join(f"{name} {texts[name]}" for name in texts)
    )


def _rate_of(facts: StationFacts) -> str:
    if isinstance(facts.asked_rate, float):
        return f"{facts.asked_rate:g} Hz"
    return (
        str(facts.asked_rate)
        if facts.rate_hz is None
        else f"{facts.rate_hz:g} Hz ({facts.asked_rate})"
    )
