"""Compares the fields of `report.json` that repeat the record with the record (`repeated`), leaf by
leaf.

Sentences depend on the version that made them, so this is for reports of this jbclog; of other
makers' only the manifest's fields are compared (`record/report_repeats.py`). Values computed from
the samples are left to `verify.py`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Final

from jbclog.analysis.rejudge import is_cut_off
from jbclog.analysis.run import Run, open_run
from jbclog.analysis.verdict import measure
from jbclog.core.errors import unexpected_error_text
from jbclog.core.files import Kind
from jbclog.core.json_files import read_json
from jbclog.core.rows import StationFacts
from jbclog.core.text import cleaned
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import REPORT
from jbclog.report.facts import Facts, PortFacts, RecordedFacts, StationReport
from jbclog.report.maker import impossible, maker_of
from jbclog.report.repeated import (
    PortRows,
    due_readings,
    of_port,
    of_run,
    of_station,
    ports_of,
    verification,
)
from jbclog.report.verdict import add_reasons, verdict_facts

MOST: Final = 20  # differences listed
ABSENT: Final = "nothing"
COMPUTED: Final = object()
"""Marks a value that the report computes: any value will do, but it must exist."""
# who made it, and hashes that `check` compares with the files
CLAIMED: Final = ("paper_by", "drawn_by", "written")
OF_ANNOTATIONS: Final = ("annotations", "annotations_head", "annotations_wrong")

Ports = Mapping[tuple[str, int], PortRows]
Found = tuple[str, object, object]
"""A difference: its place, the report's value, the record's value."""


def compare_report(folder: Path) -> tuple[list[str], list[str]]:
    """Return the differences of a sealed run's report from its record, and why some of it was not
    compared; nothing without a report.

    Raises `RecordError`.
    """
    report = report_in(folder)
    if report is None:
        return [], []
    run = open_run(folder)
    maker = maker_of(report)
    if maker is None:
        return ["names no maker"], []
    wrong = [*impossible(maker)]
    if wrong or maker.is_this:
        return wrong or [*differences(run, report)], []
    found = [*differences(run, report)] if maker.has_these_words else []
    return found, [
        f"made by {maker}: compared with the manifest only; `jbclog report {folder}` makes it again"
    ]


def report_in(folder: Path) -> dict[str, Any] | None:
    """Return `report.json`; None if it cannot be read as one."""
    try:
        found = read_json(folder / REPORT, Kind.REPORT)
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def differences(run: Run, report: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each leaf that differs from the record of the sealed `run`.

    Raises `RecordError`.
    """
    try:
        found = [*islice(_differing_leaves(report, _expected(run, report), ""), MOST)]
    except (TypeError, ValueError, AttributeError, LookupError, RecursionError) as error:
        yield f"cannot be compared further: {unexpected_error_text(error)}"
        return
    yield from (
        f"{place}: {_short(says)}, the record gives {_short(is_so)}" for place, says, is_so in found
    )


def _expected(run: Run, report: Mapping[str, Any]) -> dict[str, object]:
    """Return the report as the record gives it, with `COMPUTED` for what needs the samples."""
    known = of_run(run)
    # older than the last annotation: the chain is compared
    if report.get("annotations_head") != known["annotations_head"]:
        known |= dict.fromkeys(OF_ANNOTATIONS, COMPUTED)
    verdict = verdict_facts(run.folder, run.manifest, measure)
    add_reasons(verdict, report["stations"], cut_off=is_cut_off(run.manifest))
    ports = _ports(run)
    checks = {(one.station, one.port): one for one in run.manifest.verifications}

    def of_one(facts: StationFacts) -> dict[str, object]:
        found = ports_of(facts, [port for name, port in ports if name == facts.name])
        each = [
            _port(run, facts, port, ports.get((facts.name, port), PortRows()))
            | {
                "verification": verification(
                    facts, port, checks.get((facts.name, port)), verdict.rules
                )
            }
            for port in found
        ]
        return of_station(facts, cut_off=is_cut_off(run.manifest)) | {"ports": each}

    stations = [_all_of(StationReport) | of_one(facts) for facts in run.manifest.stations]
    others = dict.fromkeys(CLAIMED, COMPUTED) | (
        {"vouched_in": ANNOTATIONS} if "vouched_in" in report else {}
    )
    return _all_of(Facts) | known | {"verdict": verdict, "stations": stations} | others


def _port(run: Run, facts: StationFacts, port: int, rows: PortRows) -> dict[str, object]:
    recorded = {"rows": rows.number, "due": due_readings(run.manifest.ledger, facts, port)}
    known = of_port(facts, port, rows, cut_off=is_cut_off(run.manifest))
    return _all_of(PortFacts) | known | {"recorded": _all_of(RecordedFacts) | recorded}


def _all_of(kind: type[Any]) -> dict[str, object]:
    return {one.name: COMPUTED for one in fields(kind)}


def _ports(run: Run) -> Ports:
    """Return the rows of each port, from one pass over the samples."""
    found: dict[tuple[str, int], PortRows] = {}
    for group in run.groups("samples", ["station", "port", "temperature_c", "status"]):
        last = [("temperature_c", "last"), ("status", "last")]
        by_port = group.group_by(["station", "port"], use_threads=False).aggregate(
            [([], "count_all"), *last]
        )
        for row in by_port.to_pylist():
            place = (row["station"], row["port"])
            found[place] = _joined(found.get(place, PortRows()), row)
    return found


def _joined(before: PortRows, row: Mapping[str, Any]) -> PortRows:
    celsius, status = row["temperature_c_last"], row["status_last"]
    return PortRows(
        before.number + row["count_all"],
        before.temperature_c if celsius is None else float(celsius),
        before.status if status is None else status,
    )


def _differing_leaves(says: object, is_so: object, place: str) -> Iterator[Found]:
    """Yield each leaf that differs; a list of another length, a missing or an extra key is a
    leaf.
    """
    if is_so is COMPUTED:
        return
    is_so = asdict(is_so) if is_dataclass(is_so) and not isinstance(is_so, type) else is_so
    if isinstance(is_so, Mapping) and isinstance(says, Mapping):
        plain = {str(cleaned(str(key))): value for key, value in is_so.items()}
        for key in {**plain, **says}:
            yield from _differing_leaves(
                says.get(key, ABSENT),
                plain.get(key, ABSENT),
                f"{place}, {key}" if place else str(key),
            )
    elif isinstance(is_so, list | tuple) and isinstance(says, list) and len(is_so) == len(says):
        for number, (one, other) in enumerate(zip(says, is_so, strict=True), 1):
            yield from _differing_leaves(one, other, f"{place}, {_named(other, number)}")
    elif (plain_one := cleaned(is_so)) != says or isinstance(plain_one, bool) != isinstance(
        says, bool
    ):
        yield place, says, plain_one


def _named(value: object, number: int) -> str:
    """Return the name of an entry, its port, or its position in the list."""
    of = value if isinstance(value, Mapping) else {}
    return (
        str(of["name"])
        if "name" in of
        else f"port {of['port']}"
        if "left_means" in of
        else f"entry {number}"
    )


def _short(value: object) -> str:
    text = (
        json.dumps(value, ensure_ascii=False, default=str)
        if isinstance(value, dict | list)
        else str(value)
    )
    return text if len(text) <= 80 else f"{text[:79]}…"
