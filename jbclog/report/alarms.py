"""The alarms of a report: incidents with their episodes by source, acknowledgements, and alarm
KPIs.

They come from the same functions as `jbclog alarms` (`analysis/run_alarms.py`); acknowledgements
are in annotations.jsonl.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from jbclog.analysis.derived_schemas import ALARMS_SCHEMA
from jbclog.analysis.run_alarms import Alarms
from jbclog.report.text import Row

WITNESSES: Final = {"A": "flag", "B": "samples", "C": "excursion"}
COLUMNS: Final = tuple(ALARMS_SCHEMA.names[1:])  # columns of tables/alarms.csv, all but `run`
AFTERWARDS: Final = "C"


@dataclass(slots=True)
class AlarmFacts:
    """Incidents with their episodes, the KPIs of each station by source, and where the sources
    disagree.

    `waiting`: number of alarms (of the station or of samples) that are not acknowledged;
    `excursions`: incidents that only the samples show afterwards, which are not alarms.
    """

    incidents: list[Row]
    figures: list[Row]
    findings: list[str]
    waiting: int
    excursions: int


def alarm_facts(found: Alarms) -> AlarmFacts:
    """Return the alarms of a sealed run."""
    incidents = _incidents(found)
    return AlarmFacts(
        incidents=incidents,
        figures=[
            row for row in found.figure_rows() if row["count"] and row["detector"] != AFTERWARDS
        ],
        findings=found.findings(),
        waiting=sum(row["waiting"] is True for row in incidents),
        excursions=sum(not row["is_alarm"] for row in incidents),
    )


def _incidents(found: Alarms) -> list[Row]:
    rows: dict[object, list[Row]] = {}
    for row in found.rows():
        rows.setdefault(row["incident"], []).append(row)
    return [
        _incident(rows[one.number], one.name, waiting=found.is_waiting(one))
        for one in found.incidents
    ]


def _incident(episodes: Sequence[Row], name: str, *, waiting: bool) -> Row:
    """Return an incident, described by the episode that names it."""
    chosen = next(row for row in episodes if row["episode"] == name)
    shown = (
        "station",
        "port",
        "side",
        "start_earliest",
        "start",
        "stop_earliest",
        "stop",
        "stop_reason",
        "seconds",
        "seconds_least",
        "seconds_most",
        "finding",
    )
    acknowledged = ("acknowledged_by", "acknowledged_at", "acknowledged_why")
    return {
        "number": chosen["incident"],
        "name": name,
        **{key: chosen[key] for key in (*shown, *acknowledged)},
        "limit_c": next((row["limit_c"] for row in episodes if row["limit_c"] is not None), None),
        "peak_c": next(
            (row["peak_c"] for row in (chosen, *episodes) if row["peak_c"] is not None), None
        ),
        "state": _state(episodes),
        "is_alarm": any(row["main"] for row in episodes),
        "waiting": waiting,
        "witnesses": chosen["witnesses"],
        "episodes": [dict(row) for row in episodes],
    }


def _state(episodes: Sequence[Row]) -> str:
    states = {str(row["state"]) for row in episodes}
    return next((state for state in ("active", "uncertain") if state in states), "cleared")
