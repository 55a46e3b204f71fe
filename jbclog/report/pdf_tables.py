"""Tables of `report.pdf` about alarms and joints, from the facts as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from jbclog.report import joint_words, style
from jbclog.report.alarms import WITNESSES
from jbclog.report.facts import Facts
from jbclog.report.joint_words import jointed, remark
from jbclog.report.page import place
from jbclog.report.paper import Cell, Paper, Type
from jbclog.report.scale import duration_text
from jbclog.report.text import clean, interval, measured, number, stamp, together

TEXT, QUIET, HEAD = Type(7), Type(7, colour=style.QUIET), Type(7, bold=True, colour=style.QUIET)
BAD = Type(7, bold=True, colour="#8f1f06")
MOST_INCIDENTS, MOST_UNITS = 60, 60
ALARMS = ("No.", "Where", "What", "Began, UTC", ">Lasted", ">Peak", "Source", "Acknowledged")
FIGURES = ("Station", "Witness", ">Alarms", ">Most in 10 min", ">Floods", ">Fleeting", ">Stale", ">Apart", "Chattering")
JOINTS = (
    *("Where", ">Joints", ">Back before next", ">Deficit", ">Median recovery", ">95 % recovery"),
    *(">Idle error", ">Depth", ">Dwell", ">Heat"),
)
BEFORE_IDLE = (("recovered_before_next_percent", "%"), ("joint_deficit_c", "°C"), ("recovery_s", "s"), ("recovery_p95_s", "s"))
BEHIND_IDLE = (("joint_depth_c", "°C"), ("joint_dwell_s", "s"))
UNITS = (">Joints", ">Median recovery", ">Slowest", ">n", ">Not back before next", "Unit")
WITNESSED = (
    "A the station's flag, B our samples with the alarm's delay and a dead band, C every sample beyond the limit, which alone is "
    "no alarm. Began: between two readings."
)
FOUND = f"{joint_words.NOTE} All joints are in tables/joints.csv and joints.parquet."

Row = Mapping[str, object]


def alarm_tables(paper: Paper, facts: Facts) -> None:
    """Episodes, on what the witnesses do not agree, and the figures."""
    alarms = facts.alarms
    paper.heading("Alarms")
    for text in facts.annotations_wrong:
        paper.say(f"{clean(text)}. What was said since is not vouched for.", BAD)
    if not alarms.incidents:
        paper.say("No temperature that was read is beyond a limit, and no flag counts.", Type(8))
        return
    paper.say(f"{WITNESSED} {_as_of(facts)}", QUIET)
    ordered = sorted(alarms.incidents, key=lambda one: not one["is_alarm"])
    paper.table(_titles(ALARMS), [_alarm(one) for one in ordered[:MOST_INCIDENTS]])
    _more(paper, len(ordered) - MOST_INCIDENTS, "tables/alarms.csv")
    for text in alarms.findings[:MOST_INCIDENTS]:
        paper.say(f"•  {clean(together(text))}", TEXT)
    if alarms.figures:
        paper.skip(0.08)
        paper.table(_titles(FIGURES), [_figures(one) for one in alarms.figures])


def _as_of(facts: Facts) -> str:
    if not facts.annotations:
        return "Nothing was acknowledged."
    return f"Acknowledged as of head {facts.annotations_head[:24]} of annotations.jsonl."


def _alarm(one: Row) -> list[Cell]:
    limit = "" if one["limit_c"] is None else f", {'above' if one['side'] == 'high' else 'below'} {measured(one['limit_c'], '°C')}"
    lasted = "–" if one["seconds"] is None else f"{number(one['seconds'], 1)} s"
    words = [str(one["number"]), place(one), f"{one['side']}{limit}", interval(one, "onset_earliest", "onset"), lasted]
    words += [measured(one["peak_c"], "°C"), str(one["witnesses"]), _acknowledged(one)]
    return _cells(words, (4, 5), BAD if one["waiting"] else TEXT if one["is_alarm"] else QUIET)


def _acknowledged(one: Row) -> str:
    if one["acknowledged_by"] is not None:
        return f"{one['acknowledged_by']}, {stamp(str(one['acknowledged_at']))}: {one['acknowledged_why']}"
    return "not acknowledged" if one["waiting"] else "–"


def _figures(one: Row) -> list[Cell]:
    apart, chattering, floods = one["apart"], one["chattering"], one["floods"]
    assert isinstance(apart, Mapping)
    assert isinstance(chattering, Mapping)
    assert isinstance(floods, list)
    between = "–" if apart["value"] is None else duration_text(float(apart["value"]))
    words = [str(one["station"]), f"{one['detector']} {WITNESSES[str(one['detector'])]}", str(one["count"])]
    words += [str(one["most_in_10_min"]), str(len(floods)), str(one["fleeting"]), str(one["stale"]), between]
    return _cells([*words, ", ".join(f"{name} ({count} in a minute)" for name, count in chattering.items()) or "–"], range(2, 8))


def joint_tables(paper: Paper, facts: Facts) -> None:
    """The joints by port and by unit; nothing where no tool makes any."""
    rows = jointed({"stations": [asdict(station) for station in facts.stations]})
    if not rows:
        return
    paper.heading("Joints")
    paper.say(clean(together(f"{FOUND} {' '.join(joint_words.found_with(rows))}")), QUIET)
    paper.table(_titles(JOINTS), [_joints(row) for row in rows])
    paper.skip(0.04)
    for row in rows:
        paper.say(f"•  {clean(together(f'{place(row)}: {remark(row)}'))}", TEXT)
    if facts.units:
        paper.skip(0.08)
        paper.table(_titles(UNITS), [_unit(row) for row in facts.units[:MOST_UNITS]])
        _more(paper, len(facts.units) - MOST_UNITS, "tables/units.csv")


def _joints(row: Row) -> list[Cell]:
    joints = row["joints"]
    assert isinstance(joints, Mapping)
    told = joints["figures"]
    words = [place(row), joint_words.count(row), *(measured(told[name]["value"], unit) for name, unit in BEFORE_IDLE)]
    words += [joint_words.idle(row), *(measured(told[name]["value"], unit) for name, unit in BEHIND_IDLE), joint_words.heat(row)]
    return _cells(words, range(1, len(words)))


def _unit(row: Row) -> list[Cell]:
    seconds = [measured(row[name], "s") for name in ("recovery_p50_s", "recovery_slowest_s")]
    unit = str(row["unit"] or "none on the bench, or not known")
    return _cells([number(row["joints"]), *seconds, number(row["recovery_n"]), number(row["not_recovered"]), unit], range(5))


def _more(paper: Paper, count: int, where: str) -> None:
    if count > 0:
        paper.say(f"{count} more are in {where}.", QUIET)


def _cells(words: Sequence[str], right: Sequence[int], type_: Type = TEXT) -> list[Cell]:
    return [Cell(clean(together(word)), type_, right=column in right) for column, word in enumerate(words)]


def _titles(words: Sequence[str]) -> list[Cell]:
    return [Cell(word.removeprefix(">"), HEAD, right=word.startswith(">")) for word in words]
