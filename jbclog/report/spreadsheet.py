"""The report's tables as CSV, for spreadsheets: `tables/rules.csv` and its neighbours.

Numbers have a decimal point, unknown values are empty. A text that a spreadsheet would evaluate as
a formula has an apostrophe before it; numbers stay numbers (`jbclog.core.text`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from jbclog.analysis.derived_schemas import METRICS_SCHEMA
from jbclog.core.text import csv_text
from jbclog.report.alarms import COLUMNS as ALARMS
from jbclog.report.joints import COLUMNS as JOINTS
from jbclog.report.joints import Joints
from jbclog.report.tables import EVENT_COLUMNS, SETTING_COLUMNS
from jbclog.report.text import RowView, items, mapping, row_views

TABLES: Final[Mapping[str, Sequence[str]]] = {
    "rules": (
        "name",
        "station",
        "port",
        "limit_value",
        "observed",
        "bound_low",
        "bound_high",
        "uom",
        "n",
        "n_effective",
        "result",
        "text",
    ),
    "ports": (
        *("station", "family", "model", "software", "port", "tool_name", "outcome", "left"),
        *("due", "readings", "coverage_percent", "longest_gap_s", "late_p99_ms"),
        *("setpoint_c", "alarm_high_c", "alarm_low_c", "least_c", "greatest_c"),
        *(
            "idle_n",
            "idle_n_effective",
            "idle_error_c",
            "idle_error_low_c",
            "idle_error_high_c",
            "idle_sd_c",
            "idle_sd_high_c",
        ),
        *(
            "alarms",
            "doubtful_alarms",
            "greatest_permille",
            "energy_permille_s",
            "energy_wh",
            "energy_j",
        ),
    ),
    "events": EVENT_COLUMNS,
    "settings": SETTING_COLUMNS,
    "counters": (
        "station",
        "port",
        "counter",
        "uom",
        "first",
        "last",
        "difference",
        "readings",
        "note",
    ),
    "ledger": ("station", "port", "signal", "due", "ok"),
    "alarms": ALARMS,
    "joints": JOINTS,
    "metrics": tuple(METRICS_SCHEMA.names[1:]),
    "units": (
        "unit",
        "joints_found",
        "recovery_n",
        "recovery_p50_s",
        "recovery_slowest_s",
        "not_recovered",
    ),
}
"""Columns by table; the ledger has one more for each reason that occurs."""


def csv_tables(document: Mapping[str, object], joints: Joints) -> dict[str, bytes]:
    """Return table name -> CSV, from the facts as plain data and the joints."""
    rows: dict[str, Iterable[RowView]] = {
        name: row_views(document.get(name))
        for name in ("events", "settings", "counters", "metrics", "units")
    }
    incidents = row_views(mapping(document.get("alarms")).get("incidents"))
    rows["alarms"] = [row for incident in incidents for row in row_views(incident["episodes"])]
    reasons = [str(reason) for reason in items(document["ledger_reasons"])]
    rows["ledger"] = [{**row, **mapping(row["reasons"])} for row in row_views(document["ledger"])]
    rows["rules"] = [_rule(row) for row in row_views(mapping(document["verdict"])["rules"])]
    rows["ports"] = [
        _port(station, port)
        for station in row_views(document["stations"])
        for port in row_views(station["ports"])
    ]
    return {
        name: (
            joints.csv()
            if name == "joints"
            else csv_text([*columns, *(reasons if name == "ledger" else [])], rows[name]).encode()
        )
        for name, columns in TABLES.items()
    }


def _rule(row: RowView) -> RowView:
    bound = mapping(row.get("bound"))
    return {
        **row,
        "bound_low": bound.get("low"),
        "bound_high": bound.get("high"),
        "n": bound.get("n"),
        "n_effective": bound.get("n_effective"),
    }


def _port(station: RowView, port: RowView) -> RowView:
    recorded, tip, power = (mapping(port[name]) for name in ("recorded", "tip", "power"))
    mean, spread = mapping(tip["idle_error_bound"]), mapping(tip["idle_sd_bound"])
    worth = {"idle_n": mean.get("n"), "idle_n_effective": mean.get("n_effective")}
    bounds = {
        "idle_error_low_c": mean.get("low"),
        "idle_error_high_c": mean.get("high"),
        "idle_sd_high_c": spread.get("high"),
    }
    return {
        **station,
        "station": station["name"],
        **port,
        **recorded,
        **tip,
        **power,
        **worth,
        **bounds,
    }
