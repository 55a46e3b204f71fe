"""The content of `report.pdf`, in the order of the page; `templates/report.typ` has its look.

It comes from the same facts as the page. Rows too many for paper are in the tables, and a line
states how many.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Final

from jbclog.analysis.figures.ticks import duration_text
from jbclog.core.text import cleaned
from jbclog.report import joint_words
from jbclog.report.alarms import WITNESSES
from jbclog.report.facts import Facts, FigureFacts, PortFacts, StationReport
from jbclog.report.joint_words import jointed, remark
from jbclog.report.page import ENDINGS, RESULT_SIGNS, SIGNS, place, when_passed
from jbclog.report.repeated_events import merge_repeated
from jbclog.report.safety import short
from jbclog.report.text import (
    RowView,
    bound_text,
    clock,
    interval,
    measured,
    number,
    stamp,
    together,
)
from jbclog.report.typeset import LACKING, LACKING_MEANS, drawable, pdf_of

MOST_REASONS: Final = 6
MOST_ROWS: Final = 120  # of rules, events, settings
MOST_INCIDENTS, MOST_UNITS = 60, 60
UNKNOWN: Final = datetime(1970, 1, 1, tzinfo=UTC)
BOUNDS: Final = (
    "Bound: 95 % confidence bound of an estimated figure, corrected for autocorrelation; counts"
    " have none."
)
SOURCES: Final = (
    "Sources: A, the station's flag; B, samples with the alarm's delay and a deadband; C, any"
    " sample beyond the limit, which alone is no alarm. Began: between two readings."
)
FOUND: Final = f"{joint_words.NOTE} All joints are in tables/joints.csv and joints.parquet."

# Heads of tables; ">" sets a column to the right.
SUMMARY = ("Rule", ">Limit", ">Passed", ">Worst", ">95 % bound", "Where", "Result")
RULES = ("Rule", "Where", ">Limit", ">Observed", ">95 % bound", "Result", "Description")
STATIONS = (
    *(
        "Station",
        "Model",
        "Port",
        ">Readings",
        ">Longest gap",
        ">Idle error",
        ">Idle sd",
        ">Alarms",
    ),
    *("Tip verified", "Safe state", "Tool"),
)
JOINTS = (
    *("Where", ">Joints", ">Back before next", ">Deficit", ">Median recovery", ">95 % recovery"),
    *(">Idle error", ">Depth", ">Dwell", ">Heat"),
)
BEFORE_IDLE = (
    ("recovered_before_next_percent", "%"),
    ("joint_deficit_c", "°C"),
    ("recovery_s", "s"),
    ("recovery_p95_s", "s"),
)
BEHIND_IDLE = (("joint_depth_c", "°C"), ("joint_dwell_s", "s"))
UNITS = (">Joints", ">Median recovery", ">Slowest", ">n", ">Not back before next", "Unit")
ALARMS = ("No.", "Where", "What", "Began, UTC", ">Lasted", ">Peak", "Source", "Acknowledged")
FIGURES = (
    "Station",
    "Source",
    ">Alarms",
    ">Most in 10 min",
    ">Floods",
    ">Fleeting",
    ">Stale",
    ">Apart",
    "Chattering",
)
EVENTS = ("UTC", "Not before", "Where", "Severity", "Kind", "Description")
SETTINGS = ("Where", "Setting", "Tool", ">Requested", ">Written", ">Read back", "Unit", "Outcome")
COUNTERS = ("Where", "Counter", ">At the start", ">At the end", ">Difference", "Unit", "")
SAFE = ("Where", "Outcome", ">Last temperature", "Meaning")
ANNOTATIONS = ("UTC", "Who", "Kind", "What and why")

Part = dict[str, object]


def report_pdf(facts: Facts) -> bytes:
    """Return the document. The same run gives the same bytes: no creation time, no random names.
    Raises `RecordError`.
    """
    ended = facts.ended or facts.started
    return pdf_of(_data(facts), UNKNOWN if ended is None else datetime.fromisoformat(ended))


def _data(facts: Facts) -> dict[str, object]:
    """Return the input of the template: clean texts in letters of its fonts, and the SVG of each
    figure by its file.
    """
    shown = _drawable(cleaned(_content(facts)))
    assert isinstance(shown, dict)
    drawings = {figure.file: drawable(figure.wide) for figure in _figures(facts)}
    if LACKING in f"{shown}{drawings}":
        shown["sections"][-1]["parts"].append(_text(LACKING_MEANS, "quiet"))
    return {**shown, "drawings": drawings}


def _drawable(value: object) -> object:
    if isinstance(value, str):
        return drawable(value)
    if isinstance(value, dict):
        return {key: _drawable(one) for key, one in value.items()}
    return [_drawable(one) for one in value] if isinstance(value, list) else value


def _content(facts: Facts) -> dict[str, object]:
    """Return the content. `front`: sections of the first sheet; those that leave no space to sign
    follow on the next.
    """
    ended = facts.ended or facts.started
    dated = UNKNOWN if ended is None else datetime.fromisoformat(ended).astimezone(UTC)
    reasons = [
        [RESULT_SIGNS.get(one.result, ""), together(one.text)]
        for one in facts.verdict.reasons[:MOST_REASONS]
    ]
    left = len(facts.verdict.reasons) - len(reasons)
    incomplete = (
        None if facts.lost is None or facts.exit_status == "lost" else f"Incomplete: {facts.lost}"
    )
    return {
        "title": f"{facts.verdict.word} · {facts.run}",
        "dated": [dated.year, dated.month, dated.day, dated.hour, dated.minute, dated.second],
        "foot": f"{facts.run} · fingerprint {facts.head} · {facts.verdict.word}",
        "run": facts.run,
        "word": facts.verdict.word,
        "sign": SIGNS.get(facts.verdict.word, ("", ""))[1],
        "reasons": [*reasons, *([["…", f"and {left} more, below"]] if left > 0 else [])],
        "notes": [text for text in (incomplete, facts.verdict.by_rules) if text is not None],
        "head": _head(facts),
        "claims": "; ".join(facts.not_claimed_short),
        "to_sign": facts.to_sign,
        "front": [*_overview(facts), *_rests_on(facts)],
        "sections": [one for one in _sections(facts) if one["parts"]],
    }


def _head(facts: Facts) -> list[list[str]]:
    """Return who, what and when."""
    recipes = [
        [f"Recipe {one['name']}", f"revision {one['revision']}, SHA-256 {str(one['sha256'])[:24]}…"]
        for one in facts.recipes
    ]
    metadata = [
        [str(name).replace("_", " ").capitalize(), str(value)]
        for name, value in facts.metadata.items()
    ]
    length = "not known" if facts.duration_s is None else duration_text(facts.duration_s)
    return [
        ["Line", str(facts.line.get("name", "not known"))],
        *recipes,
        *metadata,
        ["Start, UTC", stamp(facts.started)],
        ["End, UTC", stamp(facts.ended)],
        ["Duration", f"{length}, {ENDINGS.get(facts.exit_status or '', 'end not known')}"],
    ]


def _sections(facts: Facts) -> Iterator[Part]:
    """Yield the sections after the first sheet, in the order of the page."""
    yield _section(
        "Stations",
        _table(
            STATIONS, [_port(station, port) for station in facts.stations for port in station.ports]
        ),
    )
    yield _section("Joints", *_joints(facts))
    yield _section("Alarms", *_alarms(facts))
    for station in facts.stations:
        yield _section(f"{station.name}: {_model(station)}", *_drawn(facts, station))
    yield _section("Rules not passed", *_unkept(facts))
    graver = [
        _event(one)
        for one in merge_repeated([event for event in facts.events if event["severity"] != "info"])
    ]
    yield _section("Events", *_some(EVENTS, graver, MOST_ROWS, "tables/events.csv"))
    requested = [_setting(row) for row in facts.settings if row["requested"] is not None]
    yield _section(
        "Requested settings", *_some(SETTINGS, requested, MOST_ROWS, "tables/settings.csv")
    )
    moved = [_counter(row) for row in facts.counters if row["difference"] != 0]
    yield _section(
        "Counters that changed or are not known",
        *_some(COUNTERS, moved, MOST_ROWS, "tables/counters.csv"),
    )
    yield _section("Incomplete readings", *_lost(facts))
    yield _section(
        "Safe state at the end",
        _table(SAFE, [_left(one, port) for one in facts.stations for port in one.ports]),
    )
    annotations = [
        _row(
            [
                stamp(str(one["time"])),
                str(one["who"]),
                str(one["kind"]),
                f"{one['what']} ({one['why']})",
            ]
        )
        for one in facts.annotations
    ]
    yield _section("Annotations", *_some(ANNOTATIONS, annotations, len(annotations), ""))
    yield _section("What this record does not claim", _list(facts.not_claimed))
    yield _section("Provenance", *map(_text, _provenance(facts)))


def _provenance(facts: Facts) -> list[str]:
    return [
        f"Manifest SHA-256 {facts.manifest_sha256}",
        f"Data SHA-256 {facts.data_sha256}",
        f"Previous run on this line: {facts.previous}",
        f"Made by jbclog {facts.jbclog}. Reproduce: {facts.reproduce}",
        f"Compare: jbclog check RUN --head {facts.head}",
    ]


# -- the verdict -----------------------------------------------------------------------------------


def _overview(facts: Facts) -> list[Part]:
    return [] if facts.overview is None else [_section("Overview", _figure(facts.overview))]


def _rests_on(facts: Facts) -> list[Part]:
    """Return all rules where they are few, else one line for each limit."""
    rules, lines = facts.verdict.rules, facts.verdict.summary
    if not rules:
        return []
    table = (
        _table(SUMMARY, [_line(one) for one in lines])
        if lines
        else _table(RULES, [_rule(one) for one in rules])
    )
    passed = sum(rule["result"] == "pass" for rule in rules)
    note = f"{passed} of {len(rules)} rules passed. {BOUNDS} {when_passed(rules)}"
    return [_section("What the verdict rests on", table, _text(note, "quiet"))]


def _unkept(facts: Facts) -> list[Part]:
    """Return in full the rules that did not pass and that the summary has in a line."""
    unkept = [
        _rule(one) for one in facts.verdict.rules if one["result"] not in ("pass", "not applicable")
    ]
    return _some(RULES, unkept, MOST_ROWS, "tables/rules.csv") if facts.verdict.summary else []


def _line(line: RowView) -> Part:
    result, unit = str(line["result"]), str(line["unit"])
    words = [
        str(line["name"]).replace("_", " "),
        measured(line["limit"], unit),
        f"{line['kept']} of {line['of']}",
    ]
    words += [
        measured(line["worst"], unit),
        bound_text(line["bound"], unit),
        place(line),
        _result(result),
    ]
    return _row(words, result)


def _rule(rule: RowView) -> Part:
    result, unit = str(rule["result"]), str(rule["unit"])
    words = [
        str(rule["name"]).replace("_", " "),
        place(rule) or "run",
        measured(rule["limit"], unit),
    ]
    words += [
        measured(rule["observed"], unit),
        bound_text(rule.get("bound"), unit),
        _result(result),
        str(rule["text"]),
    ]
    return _row(words, result)


def _result(result: str) -> str:
    return f"{RESULT_SIGNS.get(result, '')} {result}"


# -- stations --------------------------------------------------------------------------------------


def _model(station: StationReport) -> str:
    accepted = f" (accepted as {station.family})" if station.model_accepted else ""
    return f"{station.model or 'model not known'}{accepted}"


def _port(station: StationReport, port: PortFacts) -> Part:
    words = [
        station.name,
        _model(station),
        str(port.port),
        measured(port.recorded.coverage_percent, "%"),
    ]
    words += [
        measured(port.recorded.longest_gap_s, "s"),
        measured(_round(port.tip.idle_error_c), "°C"),
    ]
    words += [
        measured(_round(port.tip.idle_sd_c), "°C"),
        _count(port),
        short(port.verification),
        port.left,
        port.tool or "–",
    ]
    return _row(words)


def _count(port: PortFacts) -> str:
    """Return the number of alarms; a dash where nothing was read, or nothing that has alarms."""
    counts = port.states is None and port.air is None and port.recorded.coverage_percent is not None
    return str(port.alarms) if counts or port.alarms else "–"


def _left(station: StationReport, port: PortFacts) -> Part:
    words = [
        f"{station.name} · port {port.port}",
        port.left,
        measured(_round(port.last_temperature_c), "°C"),
        port.left_means,
    ]
    return _row(words, "fail" if port.left_warns else "")


def _drawn(facts: Facts, station: StationReport) -> list[Part]:
    """Return the figures of a station, the first of each port below its name."""
    parts: list[Part] = []
    for port in station.ports:
        figures = _of_port(facts, port)
        parts += [
            _figure(one, "" if n else f"{station.name}, port {port.port}")
            for n, one in enumerate(figures)
        ]
    return parts


def _figures(facts: Facts) -> list[FigureFacts]:
    """Return every figure on paper."""
    ports = [
        figure
        for station in facts.stations
        for port in station.ports
        for figure in _of_port(facts, port)
    ]
    return ports if facts.overview is None else [facts.overview, *ports]


def _of_port(facts: Facts, port: PortFacts) -> list[FigureFacts]:
    """Return the figures of a port; in a crowd only charts on which something stands out."""
    joints = port.joints
    if (
        joints is None
        or joints.chart is None
        or not (joints.signals or joints.never_back or not facts.is_crowd)
    ):
        return port.figures
    return [*port.figures, joints.chart]


# -- joints and alarms -----------------------------------------------------------------------------


def _joints(facts: Facts) -> list[Part]:
    """Return the joints by port and by unit; nothing where no tool makes any."""
    rows = jointed({"stations": [asdict(station) for station in facts.stations]})
    if not rows:
        return []
    parts = [
        _text(f"{FOUND} {' '.join(joint_words.found_with(rows))}", "quiet"),
        _table(JOINTS, [_joint(row) for row in rows]),
    ]
    return [
        *parts,
        _list([f"{place(row)}: {remark(row)}" for row in rows]),
        *_some(UNITS, [_unit(row) for row in facts.units], MOST_UNITS, "tables/units.csv"),
    ]


def _joint(row: RowView) -> Part:
    joints = row["joints"]
    assert isinstance(joints, Mapping)
    figures = joints["figures"]
    words = [
        place(row),
        joint_words.count(row),
        *(measured(figures[name]["value"], unit) for name, unit in BEFORE_IDLE),
    ]
    words += [
        joint_words.idle(row),
        *(measured(figures[name]["value"], unit) for name, unit in BEHIND_IDLE),
        joint_words.heat(row),
    ]
    return _row(words)


def _unit(row: RowView) -> Part:
    seconds = [measured(row[name], "s") for name in ("recovery_p50_s", "recovery_slowest_s")]
    unit = str(row["unit"] or "none or not known")
    return _row(
        [
            number(row["joints"]),
            *seconds,
            number(row["recovery_n"]),
            number(row["not_recovered"]),
            unit,
        ]
    )


def _alarms(facts: Facts) -> Iterator[Part]:
    """Yield the alarms, where their sources disagree, and the alarm figures."""
    alarms = facts.alarms
    for text in facts.annotations_wrong:
        yield _text(f"{text}. Annotations from there on are not verified.", "fail")
    if not alarms.incidents:
        yield _text("No alarm: no reading beyond a limit and no alarm flag.")
        return
    state = f"Acknowledged as of hash {facts.annotations_head[:24]} of annotations.jsonl."
    yield _text(f"{SOURCES} {state if facts.annotations else 'No alarm is acknowledged.'}", "quiet")
    ordered = [_alarm(one) for one in sorted(alarms.incidents, key=lambda one: not one["is_alarm"])]
    yield from _some(ALARMS, ordered, MOST_INCIDENTS, "tables/alarms.csv")
    yield from [_list(alarms.findings[:MOST_INCIDENTS])] if alarms.findings else []
    yield from _some(FIGURES, [_flood(one) for one in alarms.figures], len(alarms.figures), "")


def _alarm(one: RowView) -> Part:
    limit = (
        ""
        if one["limit_c"] is None
        else f", {'above' if one['side'] == 'high' else 'below'} {measured(one['limit_c'], '°C')}"
    )
    lasted = "–" if one["seconds"] is None else f"{number(one['seconds'], 1)} s"
    words = [
        str(one["number"]),
        place(one),
        f"{one['side']}{limit}",
        interval(one, "onset_earliest", "onset"),
        lasted,
    ]
    words += [measured(one["peak_c"], "°C"), str(one["witnesses"]), _acknowledged(one)]
    return _row(words, "fail" if one["waiting"] else "" if one["is_alarm"] else "quiet")


def _acknowledged(one: RowView) -> str:
    if one["acknowledged_by"] is not None:
        return (
            f"{one['acknowledged_by']}, {stamp(str(one['acknowledged_at']))}:"
            f" {one['acknowledged_why']}"
        )
    return "not acknowledged" if one["waiting"] else "–"


def _flood(one: RowView) -> Part:
    apart, chattering, floods = one["apart"], one["chattering"], one["floods"]
    assert isinstance(apart, Mapping)
    assert isinstance(chattering, Mapping)
    assert isinstance(floods, list)
    between = "–" if apart["value"] is None else duration_text(float(apart["value"]))
    words = [
        str(one["station"]),
        f"{one['detector']} {WITNESSES[str(one['detector'])]}",
        str(one["count"]),
    ]
    words += [
        str(one["most_in_10_min"]),
        str(len(floods)),
        str(one["fleeting"]),
        str(one["stale"]),
        between,
    ]
    return _row(
        [
            *words,
            ", ".join(f"{name} ({count} in a minute)" for name, count in chattering.items()) or "–",
        ]
    )


# -- what was read, set and counted ----------------------------------------------------------------


def _event(event: RowView) -> Part:
    times = [
        clock(_or_none(event["time"]), with_day=True),
        clock(_or_none(event["earliest"]), with_day=True),
    ]
    often = (
        f" {event['times']} times until {clock(_or_none(event['until']), with_day=True)}."
        if "times" in event
        else ""
    )
    words = [
        *times,
        place(event) or "run",
        str(event["severity"]),
        str(event["kind"]),
        f"{event['text']}{often}",
    ]
    return _row(words, "grave" if event["severity"] in ("error", "critical") else "")


def _setting(row: RowView) -> Part:
    numbers = [number(row[name]) for name in ("requested", "written", "readback")]
    outcome = str(row["outcome"]) if row["nak"] is None else f"{row['outcome']} (N {row['nak']})"
    look = "fail" if row["outcome"] in ("mismatch", "refused", "unconfirmed") else ""
    return _row(
        [
            place(row),
            str(row["setting"]).replace("_", " "),
            str(row["tool"] or ""),
            *numbers,
            str(row["unit"]),
            outcome,
        ],
        look,
    )


def _counter(row: RowView) -> Part:
    numbers = [number(row[name], 1) for name in ("first", "last", "difference")]
    return _row(
        [
            place(row),
            str(row["counter"]).replace("_", " "),
            *numbers,
            str(row["unit"]),
            str(row["note"]),
        ]
    )


def _lost(facts: Facts) -> list[Part]:
    """Return due = read + each reason, for signals that lack a reading."""
    reasons = facts.ledger_reasons
    head = (
        "Where",
        "Reading",
        ">Due",
        ">Read",
        *(f">{reason.replace('_', ' ')}" for reason in reasons),
    )
    rows = []
    for row in facts.ledger:
        why = row["reasons"]
        assert isinstance(why, Mapping)
        counts = [
            number(row["due"]),
            number(row["ok"]),
            *(number(why[one]) if one in why else "" for one in reasons),
        ]
        if row["due"] != row["ok"]:
            rows.append(_row([place(row), str(row["signal"]).replace("_", " "), *counts]))
    return _some(head, rows, MOST_ROWS, "tables/ledger.csv")


# -- parts of a section ----------------------------------------------------------------------------


def _section(title: str, *parts: Part) -> Part:
    return {"title": title, "parts": list(parts)}


def _text(text: str, look: str = "") -> Part:
    return {"kind": "text", "text": together(text), "look": look}


def _list(items: Sequence[str]) -> Part:
    return {"kind": "list", "items": [together(item) for item in items]}


def _figure(figure: FigureFacts, heading: str | None = None) -> Part:
    """Return a figure. `heading`: that of the first figure of a port, empty for its others, None
    for a figure of the whole run.
    """
    return {
        "kind": "figure",
        "file": figure.file,
        "caption": figure.caption,
        "alt": figure.alt,
        "heading": heading,
    }


def _table(head: Sequence[str], rows: Sequence[Part]) -> Part:
    columns = [{"title": title.removeprefix(">"), "right": title.startswith(">")} for title in head]
    return {"kind": "table", "columns": columns, "rows": list(rows)}


def _some(head: Sequence[str], rows: Sequence[Part], most: int, file: str) -> list[Part]:
    """Return the first rows as a table, and where the others are; nothing without rows."""
    more = [_text(f"{len(rows) - most} more are in {file}.", "quiet")] if len(rows) > most else []
    return [_table(head, rows[:most]), *more] if rows else []


def _row(words: Sequence[str], look: str = "") -> Part:
    """Return the cells of a row; `look` names a colour of the template, such as the result of a
    rule.
    """
    return {
        "look": look,
        "cells": [together(word).replace(" port ", " port\u00a0") for word in words],
    }


def _round(value: float | None) -> float | None:
    return None if value is None else round(value, 2)


def _or_none(value: object) -> str | None:
    return None if value is None else str(value)
