"""The tables of `report.pdf`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from jbclog.analysis.figures.ticks import duration_text
from jbclog.analysis.verdict.rules import SEVERE
from jbclog.core.text import number, stamp
from jbclog.report import joint_words
from jbclog.report.alarms import WITNESSES
from jbclog.report.facts import Facts, PortFacts, StationReport
from jbclog.report.page import RESULT_SIGNS, place
from jbclog.report.paper_parts import Part, Table, cells
from jbclog.report.safety import short
from jbclog.report.text import RowView, bound_text, clock, interval, measured

FEWER_ROWS: Final = 60  # rows of the tables of alarms and units

StationPort = tuple[StationReport, PortFacts]

# -- the verdict -----------------------------------------------------------------------------------


def _summary_row(line: RowView) -> Part:
    result, uom = str(line["result"]), str(line["uom"])
    words = [
        _spaced(line["name"]),
        measured(line["limit_value"], uom),
        f"{line['kept']} of {line['of']}",
        measured(line["worst"], uom),
        bound_text(line["bound"], uom),
        place(line),
        _result(result),
    ]
    return cells(words, result)


SUMMARY = Table(
    ("Rule", ">Limit", ">Passed", ">Worst", ">95 % bound", "Where", "Result"), _summary_row
)


def _rule_row(rule: RowView) -> Part:
    result, uom = str(rule["result"]), str(rule["uom"])
    words = [
        _spaced(rule["name"]),
        place(rule) or "run",
        measured(rule["limit_value"], uom),
        measured(rule["observed"], uom),
        bound_text(rule.get("bound"), uom),
        _result(result),
        str(rule["text"]),
    ]
    return cells(words, result)


RULES = Table(
    ("Rule", "Where", ">Limit", ">Observed", ">95 % bound", "Result", "Description"),
    _rule_row,
    "tables/rules.csv",
)


def _result(result: str) -> str:
    return f"{RESULT_SIGNS.get(result, '')} {result}"


# -- stations --------------------------------------------------------------------------------------


def _port_row(of: StationPort) -> Part:
    station, port = of
    words = [
        station.name,
        model_text(station),
        str(port.port),
        measured(port.recorded.coverage_percent, "%"),
        measured(port.recorded.longest_gap_s, "s"),
        _celsius(port.tip.idle_error_c),
        _celsius(port.tip.idle_sd_c),
        _count(port),
        short(port.verification),
        port.left,
        port.tool_name or "–",
    ]
    return cells(words)


STATIONS = Table(
    (
        *("Station", "Model", "Port", ">Readings", ">Longest gap", ">Idle error", ">Idle sd"),
        *(">Alarms", "Tip verified", "Safe state", "Tool"),
    ),
    _port_row,
)


def model_text(station: StationReport) -> str:
    accepted = f" (accepted as {station.family})" if station.model_accepted else ""
    return f"{station.model or 'model not known'}{accepted}"


def _count(port: PortFacts) -> str:
    """Return the number of alarms; a dash if nothing was read, or the station has no alarms."""
    counts = port.states is None and port.air is None and port.recorded.coverage_percent is not None
    return str(port.alarms) if counts or port.alarms else "–"


def _safe_row(of: StationPort) -> Part:
    station, port = of
    words = [
        f"{station.name} · port {port.port}",
        port.left,
        _celsius(port.last_temperature_c),
        port.left_means,
    ]
    return cells(words, "fail" if port.left_warns else "")


SAFE = Table(("Where", "Outcome", ">Last temperature", "Meaning"), _safe_row)


def _celsius(value: float | None) -> str:
    return measured(None if value is None else round(value, 2), "°C")


# -- joints ----------------------------------------------------------------------------------------

BEFORE_IDLE = (
    ("recovered_before_next_percent", "%"),
    ("joint_deficit_c", "°C"),
    ("recovery_s", "s"),
    ("recovery_p95_s", "s"),
)
BEHIND_IDLE = (("joint_depth_c", "°C"), ("joint_dwell_s", "s"))


def _joint_row(row: RowView) -> Part:
    joints = row["joints"]
    assert isinstance(joints, Mapping)
    figures = joints["figures"]
    words = [
        place(row),
        joint_words.count(row),
        *(measured(figures[name]["value"], unit) for name, unit in BEFORE_IDLE),
        joint_words.idle(row),
        *(measured(figures[name]["value"], unit) for name, unit in BEHIND_IDLE),
        joint_words.heat(row),
    ]
    return cells(words)


JOINTS = Table(
    (
        *("Where", ">Joints", ">Back before next", ">Deficit", ">Median recovery"),
        *(">95 % recovery", ">Idle error", ">Depth", ">Dwell", ">Heat"),
    ),
    _joint_row,
)


def _unit_row(row: RowView) -> Part:
    words = [
        number(row["joints_found"]),
        *(measured(row[name], "s") for name in ("recovery_p50_s", "recovery_slowest_s")),
        *(number(row[name]) for name in ("recovery_n", "not_recovered")),
        str(row["unit"] or "none or not known"),
    ]
    return cells(words)


UNITS = Table(
    (">Joints found", ">Median recovery", ">Slowest", ">n", ">Not back before next", "Unit"),
    _unit_row,
    "tables/units.csv",
    FEWER_ROWS,
)


# -- alarms ----------------------------------------------------------------------------------------


def _lasted(one: RowView) -> str:
    if one["seconds"] is None:
        return "–"
    if one["seconds_least"] is None:
        return f"{number(one['seconds'], 1)} s"
    return f"{number(one['seconds_least'], 1)} to {number(one['seconds_most'], 1)} s"


def _alarm_row(one: RowView) -> Part:
    beyond = "above" if one["side"] == "high" else "below"
    limit = "" if one["limit_c"] is None else f", {beyond} {measured(one['limit_c'], '°C')}"
    words = [
        str(one["number"]),
        place(one),
        f"{one['side']}{limit}",
        interval(one, "start_earliest", "start"),
        _lasted(one),
        measured(one["peak_c"], "°C"),
        str(one["witnesses"]),
        _acknowledged(one),
    ]
    return cells(words, "fail" if one["waiting"] else "" if one["is_alarm"] else "quiet")


ALARMS = Table(
    ("No.", "Where", "What", "Began, UTC", ">Lasted", ">Peak", "Source", "Acknowledged"),
    _alarm_row,
    "tables/alarms.csv",
    FEWER_ROWS,
)


def _acknowledged(one: RowView) -> str:
    if one["acknowledged_by"] is not None:
        return (
            f"{one['acknowledged_by']}, {stamp(str(one['acknowledged_at']))}:"
            f" {one['acknowledged_why']}"
        )
    return "not acknowledged" if one["waiting"] else "–"


def _flood_row(one: RowView) -> Part:
    apart, chattering, floods = one["apart"], one["chattering"], one["floods"]
    assert isinstance(apart, Mapping)
    assert isinstance(chattering, Mapping)
    assert isinstance(floods, list)
    words = [
        str(one["station"]),
        f"{one['detector']} {WITNESSES[str(one['detector'])]}",
        str(one["count"]),
        str(one["most_in_10_min"]),
        str(len(floods)),
        str(one["fleeting"]),
        str(one["stale"]),
        "–" if apart["value"] is None else duration_text(float(apart["value"])),
        ", ".join(f"{name} ({count} in a minute)" for name, count in chattering.items()) or "–",
    ]
    return cells(words)


FIGURES = Table(
    (
        *("Station", "Source", ">Alarms", ">Most in 10 min", ">Floods", ">Fleeting", ">Stale"),
        *(">Apart", "Chattering"),
    ),
    _flood_row,
)


# -- what was read, set and counted ----------------------------------------------------------------


OFTEN: Final = 3  # repetitions from which on they are merged


def merge_repeated(events: Sequence[RowView]) -> list[RowView]:
    """Return the events in order; of repeated warnings only the first, with `times` and `until`."""
    alike: dict[tuple[object, ...], list[RowView]] = {}
    for event in events:
        alike.setdefault(_kind(event), []).append(event)
    out: list[RowView] = []
    for event in events:
        these = alike[_kind(event)]
        if event["severity"] in SEVERE or len(these) < OFTEN:
            out.append(event)
        elif event is these[0]:
            out.append({**event, "times": len(these), "until": these[-1]["time"]})
    return out


def _kind(event: RowView) -> tuple[object, ...]:
    return event["station"], event["port"], event["kind"], event["severity"], event["text"]


def _event_row(event: RowView) -> Part:
    often = (
        f" {event['times']} times until {_day_time(event['until'])}." if "times" in event else ""
    )
    words = [
        _day_time(event["time"]),
        _day_time(event["earliest"]),
        place(event) or "run",
        str(event["severity"]),
        str(event["kind"]),
        f"{event['text']}{often}",
    ]
    return cells(words, "grave" if event["severity"] in SEVERE else "")


EVENTS = Table(
    ("UTC", "Not before", "Where", "Severity", "Kind", "Description"),
    _event_row,
    "tables/events.csv",
)


def _setting_row(row: RowView) -> Part:
    words = [
        place(row),
        _spaced(row["setting"]),
        str(row["tool_name"] or ""),
        *(number(row[name]) for name in ("requested", "written", "readback")),
        str(row["uom"]),
        str(row["outcome"]) if row["nak"] is None else f"{row['outcome']} (N {row['nak']})",
    ]
    is_wrong = row["outcome"] in ("mismatch", "refused", "unconfirmed")
    return cells(words, "fail" if is_wrong else "")


SETTINGS = Table(
    ("Where", "Setting", "Tool", ">Requested", ">Written", ">Read back", "Unit", "Outcome"),
    _setting_row,
    "tables/settings.csv",
)


def _counter_row(row: RowView) -> Part:
    words = [
        place(row),
        _spaced(row["counter"]),
        *(number(row[name], 1) for name in ("first", "last", "difference")),
        str(row["uom"]),
        str(row["note"]),
    ]
    return cells(words)


COUNTERS = Table(
    ("Where", "Counter", ">At the start", ">At the end", ">Difference", "Unit", ""),
    _counter_row,
    "tables/counters.csv",
)


def incomplete_readings(facts: Facts) -> list[Part]:
    """Return due = read + each reason, for signals that lack a reading."""
    reasons = facts.ledger_reasons

    def row(one: RowView) -> Part:
        why = one["reasons"]
        assert isinstance(why, Mapping)
        counts = (number(why[reason]) if reason in why else "" for reason in reasons)
        where = (place(one), _spaced(one["signal"]))
        return cells([*where, number(one["due"]), number(one["ok"]), *counts])

    heads = ("Where", "Reading", ">Due", ">Read", *(f">{_spaced(reason)}" for reason in reasons))
    lacking = [one for one in facts.ledger if one["due"] != one["ok"]]
    return Table(heads, row, "tables/ledger.csv").first(lacking)


def _annotation_row(one: RowView) -> Part:
    words = [
        stamp(str(one["time"])),
        str(one["who"]),
        str(one["kind"]),
        f"{one['what']} ({one['why']})",
    ]
    return cells(words)


ANNOTATIONS = Table(("UTC", "Who", "Kind", "What and why"), _annotation_row)


def _spaced(name: object) -> str:
    return str(name).replace("_", " ")


def _day_time(time: object) -> str:
    return clock(None if time is None else str(time), with_day=True)
