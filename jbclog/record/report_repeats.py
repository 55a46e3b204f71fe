"""Compare the facts that `report.json` repeats of a run with its manifest and annotations.

Somebody who rewrites `report.json` can also rewrite the line that vouches for it; its facts must
then still agree with the manifest, which a fingerprint kept elsewhere proves. Only `report
--verify` derives the rest again (joints, metrics, figures, the text of page and paper).
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from datetime import datetime
from hashlib import sha256
from itertools import islice
from typing import Any, Final

from jbclog.core.rows import StationFacts
from jbclog.core.states import StationOutcome
from jbclog.core.text import cleaned
from jbclog.record.annotations import Annotations
from jbclog.record.chains import is_head
from jbclog.record.manifest import Manifest

MOST: Final = 20  # differences that are listed
SAME: Final = (
    "run",
    "state",
    "exit_status",
    "exit_code",
    "started",
    "ended",
    "guard",
    "line",
    "recipes",
    "host",
    "files",
)
SAME_OF_STATION: Final = (
    *(
        "name",
        "family",
        "model",
        "model_accepted",
        "software",
        "url",
        "address",
        "period_s",
        "recipe",
        "rated_power_w",
    ),
    *("not_supported", "outcome", "reason", "outages", "garbage_bytes"),
)
MAIN: Final = "temperature_c"
WITH_THE_RUN: Final = "with the run"
Found = tuple[str, object, object]
"""A difference: its place, the report's value, the record's value."""


def differences(
    report: Mapping[str, Any], manifest: Manifest, said: Annotations, own: str
) -> Iterator[str]:
    """Yield a sentence for each difference. `own`: the manifest's fingerprint."""
    found = (one for one in _all(report, manifest, said, own) if one[1] != _plain(one[2]))
    for place, says, is_so in islice(found, MOST):
        yield f"{place}: {_short(says)}, the manifest says {_short(_plain(is_so))}"


def _all(
    report: Mapping[str, Any], manifest: Manifest, said: Annotations, own: str
) -> Iterator[Found]:
    """Yield each fact that a report repeats; skip those that it does not have."""
    whole = asdict(manifest) | {"files": [file.in_report() for file in manifest.files]}
    yield from _same(report, {key: whole[key] for key in SAME} | {"line": whole["line"] or {}}, "")
    yield from _same(report, {"lost": None if manifest.lost is None else manifest.lost.text}, "")
    if "head" in report:
        yield "head", is_head(str(report["head"]), own) or report["head"], True
    if manifest.started is not None and manifest.ended is not None:
        span = datetime.fromisoformat(manifest.ended) - datetime.fromisoformat(manifest.started)
        yield from _same(report, {"duration_s": span.total_seconds()}, "")
    sums = "".join(
        f"{one.sha256}  {one.path}\n" for one in sorted(manifest.files, key=lambda one: one.path)
    )
    yield from _same(report, {"data_sha256": sha256(sums.encode()).hexdigest()}, "")
    yield from _of_people(report, manifest, said, own)
    yield from _of_verdict(report.get("verdict"), manifest)
    yield from _of_ledger(report.get("ledger"), manifest)
    yield from _of_stations(report.get("stations"), manifest)


def _same(of: Mapping[str, Any], known: Mapping[str, object], place: str) -> Iterator[Found]:
    return ((f"{place}{key}", of[key], value) for key, value in known.items() if key in of)


def _of_people(
    report: Mapping[str, Any], manifest: Manifest, said: Annotations, own: str
) -> Iterator[Found]:
    given = report.get("metadata")
    if isinstance(given, dict):
        known = manifest.metadata
        for name in ("operator", "order", "product"):
            yield f"metadata, {name}", given.get(name), getattr(known, name) or None
    given = report.get("annotations")
    number = said.links.get(str(report.get("annotations_head", own)))  # None is a finding already
    if isinstance(given, list) and number is not None:
        yield "annotations", given, [asdict(one) for one in said.said[:number]]


def _of_verdict(verdict: object, manifest: Manifest) -> Iterator[Found]:
    if manifest.verdict is None:
        return
    if not isinstance(verdict, dict):
        if verdict is not None:
            yield "verdict", verdict, manifest.verdict
        return
    if "word" in verdict:
        yield "verdict", verdict["word"], manifest.verdict
    yield from _same(verdict, {"version": manifest.rules}, "verdict, ")
    rules = verdict.get("rules")
    if manifest.exit_status == "lost" or not isinstance(rules, list):
        return  # judged again for the report
    sealed = [one for one in manifest.verdict_rules if isinstance(one, dict)]
    yield "verdict, decided", verdict.get("decided", WITH_THE_RUN), WITH_THE_RUN
    yield "verdict, number of rules", len(rules), len(sealed)
    for ours, theirs in zip(sealed, rules, strict=False):
        name = f"rule {ours.get('name')} of {ours.get('station')} port {ours.get('port')}, "
        yield from _same(theirs if isinstance(theirs, dict) else {}, ours, name)


def _of_ledger(rows: object, manifest: Manifest) -> Iterator[Found]:
    if not isinstance(rows, list):
        return
    known = {
        (station, int(port) if port.isdecimal() else None, signal): counts
        for station, ports in manifest.ledger.items()
        for port, signals in ports.items()
        for signal, counts in signals.items()
    }
    yield "ledger, number of rows", len(rows), len(known)
    by_text = {str(_plain(list(place))): counts for place, counts in known.items()}
    for row in (row for row in rows if isinstance(row, dict)):
        place = [row.get("station"), row.get("port"), row.get("signal")]
        counts = by_text.get(str(place), {})
        lost = {
            name: count for name, count in counts.items() if name not in ("due", "ok") and count
        }
        where = f"ledger, {place[0]} port {place[1]}: {place[2]}, "
        yield from _same(
            row, {"due": counts.get("due", 0), "ok": counts.get("ok", 0), "reasons": lost}, where
        )


def _of_stations(stations: object, manifest: Manifest) -> Iterator[Found]:
    if not isinstance(stations, list):
        return
    yield "number of stations", len(stations), len(manifest.stations)
    for facts, station in zip(manifest.stations, stations, strict=False):
        if not isinstance(station, dict):
            yield "stations", station, facts.name
            continue
        known = {key: getattr(facts, key) for key in SAME_OF_STATION} | {
            "skipped_ticks": facts.skipped
        }
        known["not_supported"] = sorted(facts.not_supported)
        if manifest.exit_status == "lost" and facts.outcome == StationOutcome.RUNNING:
            del known["outcome"], known["reason"]  # in other words
        yield from _same(station, known, f"{facts.name}, ")
        ports = station.get("ports")
        for port in (
            port for port in (ports if isinstance(ports, list) else []) if isinstance(port, dict)
        ):
            yield from _of_port(port, facts, manifest)


def _of_port(port: Mapping[str, Any], facts: StationFacts, manifest: Manifest) -> Iterator[Found]:
    number = port.get("port")
    place = f"{facts.name} port {number}, "
    if not isinstance(number, int):
        yield f"{facts.name}, port", number, "a number"
        return
    known: dict[str, object] = {"tool": facts.tools.get(number), "touched": number in facts.touched}
    known["safe_state"] = facts.safe_state.get(number)
    if number in facts.last_temperature_c:
        known["last_temperature_c"] = facts.last_temperature_c[number]
    yield from _same(port, known, place)
    recorded, counts = (
        port.get("recorded"),
        manifest.ledger.get(facts.name, {}).get(str(number), {}).get(MAIN),
    )
    if isinstance(recorded, dict) and counts is not None:
        due, ok = counts.get("due", 0), counts.get("ok", 0)
        coverage = {"due": due, "readings": ok, "coverage_percent": 100 * ok / due if due else None}
        yield from _same(recorded, coverage, place)


def _plain(value: object) -> object:
    """Return a value as `report.json` has it: cleaned, and through JSON."""
    found: object = json.loads(json.dumps(cleaned(value)))
    return found


def _short(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False) if isinstance(value, dict | list) else str(value)
    return text if len(text) <= 80 else f"{text[:79]}…"
