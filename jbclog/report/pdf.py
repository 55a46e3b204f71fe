"""`report.pdf`: the verdict and what it rests on, the figures, what happened, and places to sign, on A4.

Made of the same facts as the page; what is too long for paper is left to the tables and said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from jbclog.report import style
from jbclog.report.drawing import Stroke
from jbclog.report.facts import Facts, PortFacts, StationReport
from jbclog.report.page import ENDINGS, RESULT_SIGNS, SIGNS, kept_by, place
from jbclog.report.paper import INNER, SIDE, WIDTH, Cell, Paper, Type, lacks_letters, pdf_bytes
from jbclog.report.paper_figures import Plates
from jbclog.report.pdf_tables import alarm_tables, joint_tables
from jbclog.report.repeated_events import told_once
from jbclog.report.safety import short
from jbclog.report.scale import duration_text
from jbclog.report.text import bound_text, clean, clock, measured, stamp, together
from jbclog.report.text_metrics import LACKING_MEANS, width_in

COLOURS = {
    "ACCEPT": ("#0a6648", "#e7f4ee"),
    "ACCEPT WITH DEVIATIONS": ("#7a5600", "#fbf3df"),
    "REJECT": ("#a3260b", "#fbe9e4"),
    "INCONCLUSIVE": ("#47478f", "#ececf7"),
}
PLAIN = ("#4b5763", "#f0f2f4")
RESULT_COLOURS = {"fail": "#8f1f06", "missing": "#3b3b85", "deviation": "#6b4b00"}
MOST_REASONS, MOST_RULES, MOST_EVENTS = 6, 120, 120
COLUMNS = 4  # of what was said of the run
SUMMARY = ("Rule", ">Limit", ">Kept by", ">Worst", ">95 % bound", "Where", "Result")
STATIONS = (
    "Station",
    "Model",
    "Port",
    ">Readings",
    ">Longest gap",
    ">Idle error",
    ">Idle sd",
    ">Alarms",
    "Tip verified",
    "Safe state",
    "Tool",
)
EVENTS = ("UTC", "Not before", "Where", "Severity", "Kind", "In words")
RULES = ("Rule", "Where", ">Limit", ">Observed", ">95 % bound", "Result", "In words")
UNKNOWN = datetime(1970, 1, 1, tzinfo=UTC)
TEXT, SMALL, QUIET, HEAD = Type(8), Type(7), Type(7, colour=style.QUIET), Type(7, bold=True, colour=style.QUIET)

Row = Mapping[str, object]


def report_pdf(facts: Facts, plates: Plates) -> bytes:
    """The whole document. The same run gives the same bytes: no time of making, no random names."""
    paper = Paper()
    _front(paper, facts, plates)
    _summary(paper, facts)
    plates.set_on(paper)
    _back(paper, facts)
    if lacks_letters(paper.sheets):
        paper.say(LACKING_MEANS, QUIET)
    foot = clean(f"{facts.run} · head {facts.head} · {facts.verdict.word}")
    return pdf_bytes(paper.sheets, foot, clean(f"{facts.verdict.word} · {facts.run}"), _dated(facts))


def _dated(facts: Facts) -> datetime:
    """When the run ended, else when it began: the file bears the record's time, not that of its making."""
    told = facts.ended or facts.started
    return UNKNOWN if told is None else datetime.fromisoformat(told)


def _front(paper: Paper, facts: Facts, plates: Plates) -> None:
    """What a signer needs on the first sheet: with the run at a glance and all rules where they leave room to sign, else below."""
    for glance, rules in ((True, True), (False, True), (False, False)):
        front = Paper()
        _opening(front, facts)
        _parts(front, facts, plates, glance, rules)
        _signatures(front, facts)
        if len(front.sheets) == 1:
            break
    _parts(front, facts, plates, not glance, not rules)
    paper.sheets, paper.y = front.sheets, front.y


def _opening(paper: Paper, facts: Facts) -> None:
    paper.need(1.0)
    paper.put("jbclog process record", SIDE, QUIET)
    paper.put(clean(facts.run), WIDTH - SIDE, QUIET, right=True)
    paper.skip(0.2)
    _verdict(paper, facts)
    _head(paper, facts)


def _parts(paper: Paper, facts: Facts, plates: Plates, glance: bool, rules: bool) -> None:
    if glance and facts.overview is not None and plates.overview is not None:
        paper.heading("At a glance", plates.overview.height_in + 0.3)
        paper.say(facts.overview.caption, QUIET)
        paper.draw(plates.overview.draw(style.PRINT))
        paper.skip(0.05)
    if rules and facts.verdict.rules:
        _rests_on(paper, facts)


def _verdict(paper: Paper, facts: Facts) -> None:
    """The word, as large as it can be, above its reasons."""
    colour, tint = COLOURS.get(facts.verdict.word, PLAIN)
    word = f"{SIGNS.get(facts.verdict.word, ('', ''))[1]} {clean(facts.verdict.word)}"
    points = min(46.0, 46.0 * (INNER - 0.6) / width_in(word, 46.0, bold=True))
    reasons = facts.verdict.reasons[:MOST_REASONS]
    left = len(facts.verdict.reasons) - len(reasons)
    said = [(RESULT_SIGNS.get(one.result, ""), clean(one.text)) for one in reasons] + [("…", f"and {left} more, below")] * (
        left > 0
    )
    inside, type_ = Paper([*paper.sheets], paper.y), Type(9)
    inside.skip(0.16)
    inside.put(word, SIDE + 0.3, Type(points, bold=True, colour=colour))
    inside.skip(points * 1.2 / 72 + 0.04)
    for mark, text in said:
        inside.put(mark, SIDE + 0.3, replace(type_, colour=colour))
        inside.say(text, type_, SIDE + 0.5, INNER - 0.65)
    if facts.verdict.by_rules is not None:
        inside.say(clean(facts.verdict.by_rules), QUIET, SIDE + 0.3, INNER - 0.45)
    height = inside.y - paper.y + 0.12
    paper.block(SIDE, 0.14, height, colour)
    paper.block(SIDE, INNER, height, tint, Stroke(colour, 1.2))
    paper.skip(height + 0.16)


def _head(paper: Paper, facts: Facts) -> None:
    """Who, what and when, in columns."""
    recipes = [
        (f"Recipe {one['name']}", f"revision {one['revision']}, SHA-256 {str(one['sha256'])[:24]}…") for one in facts.recipes
    ]
    said = [(str(name).replace("_", " ").capitalize(), str(value)) for name, value in facts.metadata.items()]
    ended = ENDINGS.get(facts.exit_status or "", "end not known")
    length = "not known" if facts.duration_s is None else duration_text(facts.duration_s)
    pairs = [
        ("Line", str(facts.line.get("name", "not known"))),
        *recipes,
        *said,
        ("Start, UTC", stamp(facts.started)),
        ("End, UTC", stamp(facts.ended)),
        ("Duration", f"{length}, {ended}"),
    ]
    quarter = INNER / COLUMNS
    for first in range(0, len(pairs), COLUMNS):
        paper.need(0.34)
        deepest = paper.y
        for column, (name, value) in enumerate(pairs[first : first + COLUMNS]):
            own = Paper([paper.sheet], paper.y)
            own.say(clean(name), QUIET, SIDE + column * quarter, quarter - 0.12)
            own.say(clean(value), TEXT, SIDE + column * quarter, quarter - 0.12)
            deepest = max(deepest, own.y)
        paper.y = deepest + 0.05


def _rests_on(paper: Paper, facts: Facts) -> None:
    """All rules where they are few, else one line for each limit."""
    rules, lines = facts.verdict.rules, facts.verdict.summary
    paper.heading("What the verdict rests on")
    if lines:
        paper.table(
            _titles(["Rule", ">Limit", ">Kept by", ">Worst", ">95 % bound", "Where", "Result"]), [_line(one) for one in lines]
        )
    else:
        paper.table(
            _titles(["Rule", "Where", ">Limit", ">Observed", ">95 % bound", "Result", "In words"]), [_rule(one) for one in rules]
        )
    kept = sum(rule["result"] == "pass" for rule in rules)
    paper.skip(0.04)
    paper.say(f"{kept} of {len(rules)} rules kept. {BOUNDS} {clean(kept_by(rules))}", QUIET)


BOUNDS = "Bound: how well an estimated figure is known, with 95 % confidence, corrected for autocorrelation; counts need none."


def _unkept(paper: Paper, rules: Sequence[Row]) -> None:
    """In full what a summary has in a line."""
    unkept = [rule for rule in rules if rule["result"] not in ("pass", "not applicable")]
    if not unkept:
        return
    paper.heading("Every rule that was not kept")
    paper.table(_titles(RULES), [_rule(one) for one in unkept[:MOST_RULES]])
    if len(unkept) > MOST_RULES:
        paper.say(f"{len(unkept) - MOST_RULES} more are in tables/rules.csv.", QUIET)


def _line(line: Row) -> list[Cell]:
    result, unit = str(line["result"]), str(line["unit"])
    words = [str(line["name"]).replace("_", " "), measured(line["limit"], unit), f"{line['kept']} of {line['of']}"]
    words += [measured(line["worst"], unit), bound_text(line["bound"], unit), place(line), _told(result)]
    return _cells(words, result, (1, 2, 3, 4))


def _told(result: str) -> str:
    return f"{RESULT_SIGNS.get(result, '')} {result}"


def _cells(words: Sequence[str], result: str, right: Sequence[int]) -> list[Cell]:
    """A row in the colour of its result, bold where it was not kept; sentences are never bold."""
    colour, bold = RESULT_COLOURS.get(result, style.INK), result in ("fail", "missing")
    kept = [clean(together(word)).replace(" port ", " port\u00a0") for word in words]
    return [Cell(word, Type(7, bold and not word.endswith("."), colour), right=column in right) for column, word in enumerate(kept)]


def _rule(rule: Row) -> list[Cell]:
    result, unit = str(rule["result"]), str(rule["unit"])
    words = [
        str(rule["name"]).replace("_", " "),
        place(rule) or "run",
        measured(rule["limit"], unit),
        measured(rule["observed"], unit),
    ]
    return _cells([*words, bound_text(rule.get("bound"), unit), _told(result), str(rule["text"])], result, (2, 3, 4))


def _model(station: StationReport) -> str:
    return f"{station.model or 'not known'}{f' (accepted as {station.family})' if station.model_accepted else ''}"


def _stations(stations: Sequence[StationReport]) -> tuple[list[Cell], list[list[Cell]]]:
    titles = _titles(STATIONS)
    rows = [
        [station.name, _model(station), str(port.port), measured(port.recorded.coverage_percent, "%"),
         measured(port.recorded.longest_gap_s, "s"), measured(_round(port.tip.idle_error_c), "°C"),
         measured(_round(port.tip.idle_sd_c), "°C"), _alarms(port), short(port.verification), port.left, port.tool or "–"]
        for station in stations for port in station.ports
    ]  # fmt: skip
    return titles, [[Cell(clean(word), SMALL, right=3 <= column <= 7) for column, word in enumerate(row)] for row in rows]


def _alarms(port: PortFacts) -> str:
    """How many; none are claimed where nothing was read, or nothing that has alarms."""
    counts = port.states is None and port.air is None and port.recorded.coverage_percent is not None
    return str(port.alarms) if counts or port.alarms else "–"


def _summary(paper: Paper, facts: Facts) -> None:
    """All stations in tables, before their figures."""
    paper.heading("Stations")
    paper.table(*_stations(facts.stations))
    joint_tables(paper, facts)
    alarm_tables(paper, facts)


def _back(paper: Paper, facts: Facts) -> None:
    if facts.verdict.summary:
        _unkept(paper, facts.verdict.rules)
    graver = told_once([event for event in facts.events if event["severity"] != "info"])
    if graver:
        paper.heading("What happened")
        paper.table(_titles(EVENTS), [_event(one) for one in graver[:MOST_EVENTS]])
        if len(graver) > MOST_EVENTS:
            paper.say(f"{len(graver) - MOST_EVENTS} more are in tables/events.csv.", QUIET)
    if facts.annotations:
        paper.heading("Said since")
        rows = [
            [stamp(str(one["time"])), str(one["who"]), str(one["kind"]), f"{one['what']} ({one['why']})"]
            for one in facts.annotations
        ]
        paper.table(_titles(["UTC", "Who", "Kind", "What and why"]), [[Cell(clean(word), SMALL) for word in row] for row in rows])
    paper.heading("What this record does not claim")
    for claim in facts.not_claimed:
        paper.say(f"•  {claim}", TEXT)
    paper.heading("Provenance")
    said = [f"Manifest SHA-256 {facts.manifest_sha256}", f"Data SHA-256 {facts.data_sha256}"]
    said += [f"Run before on this line: {facts.previous}", f"Made by jbclog {facts.jbclog}. Reproduce: {facts.reproduce}"]
    for text in (*said, f"Compare: jbclog check RUN --head {facts.head}"):
        paper.say(clean(text), TEXT)


def _event(event: Row) -> list[Cell]:
    type_ = Type(7, colour=RESULT_COLOURS["fail"] if event["severity"] in ("error", "critical") else style.INK)
    times = [clock(_text(event["time"]), with_day=True), clock(_text(event["earliest"]), with_day=True)]
    often = f" {event['times']} times until {clock(_text(event['until']), with_day=True)}." if "times" in event else ""
    words = [*times, place(event) or "run", str(event["severity"]), str(event["kind"]), f"{event['text']}{often}"]
    return [Cell(clean(word), type_) for word in words]


def _signatures(paper: Paper, facts: Facts) -> None:
    """Two places to sign: who, with which meaning, when."""
    half, claims = INNER / 2 - 0.15, f"Not claimed: {'; '.join(facts.not_claimed_short)}."
    paper.need(1.75)
    paper.skip(0.12)
    paper.say(claims, TEXT)
    paper.skip(0.1)
    for column, meaning in enumerate(facts.to_sign):
        own = Paper([paper.sheet], paper.y)
        x = SIDE + column * (half + 0.3)
        own.put(meaning["role"], x, Type(9, bold=True))
        own.skip(Type(9).line_in)
        own.say(meaning["meaning"], QUIET, x, half)
        for label in ("Name", "Date", "Signature"):
            own.skip(0.22)
            own.rule(style.NO_DATA, 0.6, x + 0.65, x + half)
            own.put(label, x, QUIET, down=-0.1)
    paper.skip(1.25)


def _titles(words: Sequence[str]) -> list[Cell]:
    """The head of a table; ``>`` sets a column to the right."""
    return [Cell(word.removeprefix(">"), HEAD, right=word.startswith(">")) for word in words]


def _round(value: float | None) -> float | None:
    return None if value is None else round(value, 2)


def _text(value: object) -> str | None:
    return None if value is None else str(value)
