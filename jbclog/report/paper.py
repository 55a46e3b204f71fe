"""The content of `report.pdf`, in the order of the page; `templates/report.typ` has its layout.

It comes from the same facts as the page. Rows too many for paper are in the tables, and a line
states how many.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Final

from jbclog.analysis.figures.ticks import duration_text
from jbclog.core.text import cleaned, shortened, stamp, together
from jbclog.report import joint_words
from jbclog.report.facts import Facts, FigureFacts, PortFacts, StationReport
from jbclog.report.joint_words import jointed, remark
from jbclog.report.page import ENDINGS, RESULT_SIGNS, SIGNS, place, when_passed
from jbclog.report.paper_parts import Part, bullets, drawing, paragraph, section
from jbclog.report.paper_tables import (
    ALARMS,
    ANNOTATIONS,
    COUNTERS,
    EVENTS,
    FIGURES,
    JOINTS,
    RULES,
    SAFE,
    SETTINGS,
    STATIONS,
    SUMMARY,
    UNITS,
    incomplete_readings,
    merge_repeated,
    model_text,
)
from jbclog.report.typeset import LACKING, LACKING_MEANS, drawable, drawable_in_figure, pdf_of

MOST_REASONS: Final = 6
MOST_FINDINGS: Final = 60
SHORT: Final = 300  # characters of a text: nearly all have fewer
# enough for 500 serials. The typesetter panics if it cuts a document's title after 65 535 bytes
# within a letter; it puts a break of three bytes after each letter of four or fewer
LONGEST: Final = 9_000
ALL_LONG: Final = 100_000  # characters of all longer texts together
UNKNOWN: Final = datetime(1970, 1, 1, tzinfo=UTC)
BOUNDS: Final = (
    "Bound: 95 % confidence bound of an estimated figure, corrected for autocorrelation; counts"
    " have none."
)
SOURCES: Final = (
    "Sources: A, the station's flag; B, samples with the alarm's delay and a deadband; C, any"
    " sample beyond the limit, which alone is no alarm. Began: between two readings."
)
FOUND: Final = f"{joint_words.NOTE} All joints are in tables/joints.csv and derived/joints.parquet."


def report_pdf(facts: Facts) -> bytes:
    """Return the document. The same run gives the same bytes: no creation time, no random names.

    Raises `RecordError`.
    """
    ended = facts.stop or facts.start
    return pdf_of(_data(facts), UNKNOWN if ended is None else datetime.fromisoformat(ended))


def _data(facts: Facts) -> dict[str, object]:
    """Return the input of the template: clean texts in letters of its fonts, and the SVG of each
    figure by its file.
    """
    shown = _Fitting().of(cleaned(_content(facts)))
    assert isinstance(shown, dict)
    drawings = {figure.file: drawable_in_figure(figure.wide) for figure in _figures(facts)}
    if LACKING in f"{shown}" or any(LACKING in drawn for drawn in drawings.values()):
        shown["sections"][-1]["parts"].append(paragraph(LACKING_MEANS, "quiet"))
    return {**shown, "drawings": drawings}


class _Fitting:
    """Limits texts for the typesetter, which takes 50 s for one of a million letters and 800 MB for
    a thousand of a thousand: to letters of its fonts, and to lengths that no recorder reaches. Page
    and tables have them whole.
    """

    def __init__(self) -> None:
        self._left = ALL_LONG

    def of(self, value: object) -> object:
        """Return the structure with each text as it is to be set."""
        if isinstance(value, str):
            return drawable(self._fitting(value))
        if isinstance(value, dict):
            return {key: self.of(one) for key, one in value.items()}
        return [self.of(one) for one in value] if isinstance(value, list) else value

    def _fitting(self, text: str) -> str:
        if len(text) <= SHORT:
            return text
        most = min(LONGEST, max(self._left, SHORT))
        self._left -= min(len(text), most)
        return shortened(text, most)


def _content(facts: Facts) -> dict[str, object]:
    """Return the content. `front`: sections of the first sheet; those that leave no space to sign
    follow on the next.
    """
    ended = facts.stop or facts.start
    dated = UNKNOWN if ended is None else datetime.fromisoformat(ended).astimezone(UTC)
    reasons = [
        [RESULT_SIGNS.get(one.result, ""), together(one.text)]
        for one in facts.verdict.reasons[:MOST_REASONS]
    ]
    left = len(facts.verdict.reasons) - len(reasons)
    incomplete = (
        None if facts.lost is None or facts.exit_status == "lost" else f"Incomplete: {facts.lost}"
    )
    notes = (incomplete, facts.clock_wrong, facts.verdict.by_rules)
    return {
        "title": f"{facts.verdict.word} · {facts.run}",
        "dated": [dated.year, dated.month, dated.day, dated.hour, dated.minute, dated.second],
        "foot": f"{facts.run} · fingerprint {facts.head} · {facts.verdict.word}",
        "run": facts.run,
        "word": facts.verdict.word,
        "sign": SIGNS.get(facts.verdict.word, ("", ""))[1],
        "reasons": [*reasons, *([["…", f"and {left} more, below"]] if left > 0 else [])],
        "notes": [text for text in notes if text is not None],
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
        ["Start, UTC", stamp(facts.start)],
        ["End, UTC", stamp(facts.stop)],
        ["Duration", f"{length}, {ENDINGS.get(facts.exit_status or '', 'end not known')}"],
    ]


def _sections(facts: Facts) -> Iterator[Part]:
    """Yield the sections after the first sheet, in the order of the page."""
    places = [(station, port) for station in facts.stations for port in station.ports]
    yield section("Stations", STATIONS.of(places))
    yield section("Joints", *_joints(facts))
    yield section("Alarms", *_alarms(facts))
    for station in facts.stations:
        yield section(f"{station.name}: {model_text(station)}", *_drawn(facts, station))
    yield section("Rules not passed", *_unkept(facts))
    graver = [event for event in facts.events if event["severity"] != "info"]
    yield section("Events", *EVENTS.first(merge_repeated(graver)))
    requested = [row for row in facts.settings if row["requested"] is not None]
    yield section("Requested settings", *SETTINGS.first(requested))
    moved = [row for row in facts.counters if row["difference"] != 0]
    yield section("Counters that changed or are not known", *COUNTERS.first(moved))
    yield section("Incomplete readings", *incomplete_readings(facts))
    yield section("Safe state at the end", SAFE.of(places))
    yield section("Annotations", *ANNOTATIONS.first(facts.annotations))
    yield section("What this record does not claim", bullets(facts.not_claimed))
    yield section("Provenance", *map(paragraph, _provenance(facts)))


def _provenance(facts: Facts) -> list[str]:
    return [
        f"Manifest SHA-256 {facts.manifest_sha256}",
        f"Data SHA-256 {facts.data_sha256}",
        f"Previous run on this line: {facts.previous}",
        f"Made by jbclog {facts.jbclog}.",
        f"Compare: jbclog check RUN --head {facts.head}",
    ]


# -- the verdict -----------------------------------------------------------------------------------


def _overview(facts: Facts) -> list[Part]:
    return [] if facts.overview is None else [section("Overview", drawing(facts.overview))]


def _rests_on(facts: Facts) -> list[Part]:
    """Return all rules if they are few, else one line for each limit."""
    rules, lines = facts.verdict.rules, facts.verdict.summary
    if not rules:
        return []
    table = SUMMARY.of(lines) if lines else RULES.of(rules)
    passed = sum(rule["result"] == "pass" for rule in rules)
    note = f"{passed} of {len(rules)} rules passed. {BOUNDS} {when_passed(rules)}"
    return [section("What the verdict rests on", table, paragraph(note, "quiet"))]


def _unkept(facts: Facts) -> list[Part]:
    """Return in full the rules that did not pass and that the summary has in a line."""
    rules = facts.verdict.rules if facts.verdict.summary else []
    return RULES.first([one for one in rules if one["result"] not in ("pass", "not applicable")])


def _drawn(facts: Facts, station: StationReport) -> list[Part]:
    """Return the figures of a station, the first of each port below its name."""
    parts: list[Part] = []
    for port in station.ports:
        figures = _of_port(facts, port)
        parts += [
            drawing(one, "" if n else f"{station.name}, port {port.port}")
            for n, one in enumerate(figures)
        ]
    return parts


def _figures(facts: Facts) -> list[FigureFacts]:
    ports = [
        figure
        for station in facts.stations
        for port in station.ports
        for figure in _of_port(facts, port)
    ]
    return ports if facts.overview is None else [facts.overview, *ports]


def _of_port(facts: Facts, port: PortFacts) -> list[FigureFacts]:
    """Return the figures of a port; with many ports only charts with signals."""
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
    """Return the joints by port and by unit; nothing if no tool makes any."""
    rows = jointed({"stations": [asdict(station) for station in facts.stations]})
    if not rows:
        return []
    return [
        paragraph(f"{FOUND} {' '.join(joint_words.found_with(rows))}", "quiet"),
        JOINTS.of(rows),
        bullets([f"{place(row)}: {remark(row)}" for row in rows]),
        *UNITS.first(facts.units),
    ]


def _alarms(facts: Facts) -> Iterator[Part]:
    """Yield the alarms, where their sources disagree, and the alarm KPIs."""
    alarms = facts.alarms
    for text in facts.annotations_wrong:
        yield paragraph(f"{text}. Annotations from there on are not verified.", "fail")
    if not alarms.incidents:
        yield paragraph("No alarm: no reading beyond a limit and no alarm flag.")
        return
    state = f"Acknowledged as of hash {facts.annotations_head[:24]} of annotations.jsonl."
    yield paragraph(
        f"{SOURCES} {state if facts.annotations else 'No alarm is acknowledged.'}", "quiet"
    )
    yield from ALARMS.first(sorted(alarms.incidents, key=lambda one: not one["is_alarm"]))
    yield from [bullets(alarms.findings[:MOST_FINDINGS])] if alarms.findings else []
    yield from FIGURES.first(alarms.figures)
