"""The page and its twin in JSON: what they say, that they open offline, and that nothing from
outside can act in them.
"""

from __future__ import annotations

import base64
import gc
import hashlib
import json
import re
from hashlib import sha256
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np
import pytest

from jbclog.core.errors import RecordError
from jbclog.core.rows import CounterRow, EventRow, SettingRow, Severity
from jbclog.core.text import clean
from jbclog.record.chains import short_head
from jbclog.record.check import check
from jbclog.record.manifest import LineFile, Lost, Metadata, read_manifest, write_manifest
from jbclog.report import write as writing
from jbclog.report.joints import Joints
from jbclog.report.page import PLAIN_IN_ADDRESS, SCRIPTS, data_uri
from jbclog.report.verdict import without_urls
from jbclog.report.write import write_report
from support import once
from support.readers.run_files import differing_files
from support.records.sealed_run import (
    RECIPE,
    alarm,
    limit,
    lose,
    micros,
    samples,
    seal,
    station,
    table,
)
from support.records.small_run import begin, make_run

ELEMENTS = {
    *(
        "html",
        "head",
        "meta",
        "title",
        "style",
        "body",
        "main",
        "section",
        "footer",
        "div",
        "p",
        "span",
        "b",
        "small",
        "a",
        "code",
    ),
    *("h1", "h2", "h3", "ul", "li", "dl", "dt", "dd", "table", "thead", "tbody", "tr", "th", "td"),
    *("figure", "figcaption", "img", "script"),
}
ATTRIBUTES = {
    "lang",
    "charset",
    "name",
    "content",
    "http-equiv",
    "class",
    "id",
    "href",
    "src",
    "alt",
}
BESIDE = (
    "tables/joints.csv",
    "tables/metrics.csv",
    "derived/joints.parquet",
)  # files of the report itself
ATTRIBUTES |= {"data-what", "data-zoom"}
OURS = [(files("jbclog.report").joinpath(*path)).read_bytes().decode() for path in SCRIPTS]


class Page(HTMLParser):
    """A page as a browser has it: its elements, and its text."""

    def __init__(self, html: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.scripts: list[str] = []
        self._in_script = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._in_script = tag == "script"
        self.scripts += [""] * self._in_script

    def handle_data(self, data: str) -> None:
        if self.elements and self.elements[-1][0] == "script" and self._in_script:
            self.scripts[-1] += data
        else:
            self.words.append(data)

    def handle_endtag(self, tag: str) -> None:
        self._in_script = False

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))


def report(folder: Path) -> tuple[Page, dict[str, Any]]:
    assert write_report(folder) == folder / "report.html"
    return read(folder)


def read(folder: Path) -> tuple[Page, dict[str, Any]]:
    return Page((folder / "report.html").read_text("utf-8")), json.loads(
        (folder / "report.json").read_text("utf-8")
    )


def sealed(tmp_path: Path, rows: int = 600, **manifest: object) -> Path:
    return seal(tmp_path, [station(rows=rows)], table(samples(rows)), **manifest)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With its report."""
    folder = make_run(tmp_path_factory.mktemp("runs"), 45)
    write_report(folder)
    return folder


@pytest.fixture(scope="module")
def shown(recorded: Path) -> tuple[Page, dict[str, Any]]:
    return read(recorded)


def test_a_recorded_run_is_told_with_its_verdict_first(shown: tuple[Page, dict[str, Any]]) -> None:
    page, data = shown
    assert data["verdict"]["word"] == "REJECT"
    assert data["verdict"]["decided"] == "with the run"
    heading = page.text.index("REJECT", page.text.index("process record"))
    assert (
        heading
        < page.text.index("Stations")
        < page.text.index("Events")
        < page.text.index("What this record does not claim")
    )
    for word in (
        "dde-1",
        "ale-1",
        "M. Weber",
        "4711",
        "controller <B>",
        "SN-001",
        "sn100c-tht",
        "revision 7",
        "T245/T470",
        "1.01 ms",
    ):
        assert word in page.text, word
    assert "disconnected 3.1 s" in page.text
    assert [len(one["ports"]) for one in sorted(data["stations"], key=lambda one: one["name"])] == [
        1,
        2,
    ]


def test_both_name_the_manifest_that_they_were_made_from_and_change_nothing(
    recorded: Path, shown: tuple[Page, dict[str, Any]]
) -> None:
    before, (page, data) = (recorded / "manifest.json").read_bytes(), shown
    digest = hashlib.sha256(before).hexdigest()
    assert data["manifest_sha256"] == digest
    assert digest in page.text
    assert data["head"] == short_head(digest)
    assert f"jbclog check RUN --head {data['head']}" in page.text
    assert "Previous run on this line: not known" in page.text
    assert check(recorded) == []
    for file in data["files"]:
        assert file["sha256"] in page.text


def test_the_same_run_gives_the_same_bytes_and_a_changed_report_is_found(recorded: Path) -> None:
    first = {path: path.read_bytes() for path in recorded.rglob("*") if path.is_file()}
    once.forget()
    write_report(recorded)
    # the manifest's, too
    assert first == {path: path.read_bytes() for path in recorded.rglob("*") if path.is_file()}
    assert differing_files(recorded) == []
    (recorded / "report.html").write_text(
        first[recorded / "report.html"].decode().replace("REJECT", "ACCEPT")
    )
    (recorded / "figures" / "dde-1-1.svg").unlink()
    assert differing_files(recorded) == ["figures/dde-1-1.svg", "report.html"]
    for path in (recorded / "report.html", recorded / "figures" / "dde-1-1.svg"):
        path.write_bytes(first[path])


def test_a_drawing_is_escaped_as_letter_by_letter() -> None:
    svg = '<svg a="1">\n  <text>100 % &amp;\u2212350 °C #7 \\ ` {} 王</text>\n</svg>'
    plain = " ".join(svg.split())
    escaped = "".join(quote(letter, safe=PLAIN_IN_ADDRESS) for letter in plain)
    assert data_uri(svg) == f"data:image/svg+xml,{escaped}"
    assert unquote(escaped) == plain
    assert not {*'<>"#&`\\'} & {*escaped}


def test_the_page_needs_nothing_but_itself(shown: tuple[Page, dict[str, Any]]) -> None:
    page, _ = shown
    # uPlot and ours, in the page
    assert [attrs for tag, attrs in page.elements if tag == "script"] == [{}, {}]
    assert not [
        tag
        for tag, _ in page.elements
        if tag in ("link", "iframe", "object", "embed", "form", "base", "svg")
    ]
    sources = [attrs.get("src") for tag, attrs in page.elements if tag == "img"]
    # of three ports, their joints and the run at a glance, each in two sizes
    assert len(sources) == 14
    assert all(
        source is not None and source.startswith("data:image/svg+xml,") for source in sources
    )
    style = "".join(page.words)
    assert "@import" not in style
    assert "url(" not in style
    policy = [
        attrs["content"]
        for tag, attrs in page.elements
        if attrs.get("http-equiv") == "Content-Security-Policy"
    ]
    assert policy
    assert "default-src 'none'" in str(policy[0])
    assert page.scripts == OURS
    hashes = [
        f"'sha256-{base64.b64encode(sha256(script.encode()).digest()).decode()}'"
        for script in page.scripts
    ]
    assert f"script-src {' '.join(hashes)};" in str(policy[0])
    for script in page.scripts:
        assert not [
            word
            for word in ("fetch", "XMLHttp", "import", "eval", "innerHTML", "Worker", "WebSocket")
            if word in script
        ]
    assert "http" not in page.scripts[1]
    assert page.scripts[0].count("http") == 1  # where it comes from, in its first line
    assert all(attrs.get("alt") for tag, attrs in page.elements if tag == "img")


def test_a_model_that_the_line_file_accepts_is_told_as_such(tmp_path: Path) -> None:
    facts = station(rows=600)
    facts.model, facts.model_accepted = "DIE", True
    page, told = report(seal(tmp_path, [facts], table(samples(600))))
    assert "DIE, family dde (model name accepted by the line file)" in " ".join(page.text.split())
    assert (told["stations"][0]["model"], told["stations"][0]["model_accepted"]) == ("DIE", True)


MARKUP = (
    "<script>alert(1)</script>",
    '"><img src=x onerror=alert(1)>',
    "'\"><svg/onload=alert(1)>",
    "</style></title><b>",
    "{{ 7 * 7 }}{% raw %}",
    "$\\frac{1}{0}$",
    "\x1b[31mred\x00\u202eexe.txt\u2066",
)
# an address and a path are that from their beginning on
HOSTILE = (" ".join(MARKUP), "javascript:alert(1)", "../../../etc/passwd")


@pytest.mark.parametrize("text", HOSTILE)
def test_text_from_outside_is_shown_and_cannot_act(tmp_path: Path, text: str) -> None:
    facts = station(name=text, rows=600)
    facts.url = facts.model = facts.software = facts.recipe = facts.reason = facts.family = text
    facts.tool_names, facts.not_supported, facts.safe_state = {1: text}, [text], {1: text}
    folder = seal(
        tmp_path,
        [facts],
        table(samples(600, name=text)),
        [
            alarm(12, text, text=text),
            EventRow(micros(1), text, Severity.INFO, text, text, 1, raw=text),
        ],
        [
            SettingRow(micros(0), text, 1, text, text, text, text, text, text, None, "confirmed"),
            limit("high", text, station_name=text),
        ],
        [CounterRow(micros(0), text, 1, text, None, text, text)],
        line=LineFile(text, text, text),
        metadata=Metadata(text, text, text, [text], {text: text}),
        host={text: text},
        verdict="REJECT",
        verdict_rules=[
            {
                "name": text,
                "station": text,
                "port": 1,
                "text": text,
                "result": text,
                "limit_value": text,
                "observed": text,
            }
        ],
        exit_status=text,
        lost=Lost(1.0, text),
    )
    outside = {path for path in tmp_path.rglob("*") if path.is_file()}
    page, _ = report(folder)
    assert {tag for tag, _ in page.elements} <= ELEMENTS
    assert [attrs for tag, attrs in page.elements if tag == "script"] == [{}, {}]
    assert page.scripts == OURS
    assert {name for _, attrs in page.elements for name in attrs} <= ATTRIBUTES
    assert all(
        str(attrs["href"]).startswith("#") or attrs["href"] in BESIDE
        for _, attrs in page.elements
        if "href" in attrs
    )
    html, data = (
        (folder / "report.html").read_text("utf-8"),
        (folder / "report.json").read_text("utf-8"),
    )
    for shown in (html, data):
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]", shown)
    # as it is, not worked out: {{ 7 * 7 }} stays what it is
    assert clean(text) in " ".join(page.words)
    made = {path for path in tmp_path.rglob("*") if path.is_file()} - outside
    assert all(path.is_relative_to(folder) for path in made)
    for figure in (folder / "figures").iterdir():
        assert "alert" not in figure.read_text()


def test_a_run_without_limits_is_not_judged(tmp_path: Path) -> None:
    page, data = report(sealed(tmp_path, recipe=RECIPE.split("[acceptance]")[0]))
    assert data["verdict"]["word"] == "NOT JUDGED"
    assert data["verdict"]["rules"] == []
    assert "state no limits" in page.text


def test_a_run_that_ended_without_a_verdict_is_judged_by_its_recipes(tmp_path: Path) -> None:
    rows = samples(3600, joints_until_s=40.0)
    page, data = report(seal(tmp_path, [station(rows=3600)], table(rows)))
    assert [attrs["class"] for tag, attrs in page.elements if tag == "img"] == [
        "wide",
        "narrow",
    ] * 3  # paper's and a phone's; of joints and of their course
    assert (data["verdict"]["word"], data["verdict"]["decided"]) == ("ACCEPT", "by this report")
    assert "All limits passed." in page.text


def test_a_lost_run_is_never_accepted_and_says_what_is_missing(tmp_path: Path) -> None:
    folder = sealed(
        tmp_path,
        exit_status="lost",
        exit_code=4,
        lost=Lost(1.0, "At most 1 s of every station is missing."),
        stop=None,
    )
    page, data = report(folder)
    assert data["verdict"]["word"] == "INCONCLUSIVE"
    assert "At most 1 s of every station is missing." in page.text
    assert data["duration_s"] is None
    assert "not known" in page.text


def recovered(tmp_path: Path, **manifest: object) -> Path:
    """A run whose recorder was killed: its tool at work, no outcome, as `recover` leaves it."""
    facts = station(rows=600)
    facts.outcome, facts.safe_state, facts.last_temperature_c = "running", {}, {}
    facts.first_tick = facts.last_tick = None
    told = {
        "exit_status": "lost",
        "exit_code": 4,
        "verdict": "INCONCLUSIVE",
        "lost": Lost(1.0, "At most the last 1 s is missing."),
    }
    return seal(tmp_path, [facts], table(samples(600)), **{**told, **manifest})  # type: ignore[arg-type]


def test_a_recovered_run_claims_nothing_that_nobody_saw(tmp_path: Path) -> None:
    page, data = report(recovered(tmp_path))
    assert (data["verdict"]["word"], data["verdict"]["decided"]) == ("INCONCLUSIVE", "by recovery")
    first, second = (reason["text"] for reason in data["verdict"]["reasons"][:2])
    assert first.startswith(
        "The recording was cut off before the run was judged. At most the last 1 s is missing."
    )
    assert second == "dde-1 port 1: not made safe: last seen 345 °C, working."
    assert "All limits passed." not in page.text
    assert "not touched" not in page.text
    assert (data["stations"][0]["outcome"], data["stations"][0]["ports"][0]["left_warns"]) == (
        "cut off",
        True,
    )
    assert "running" not in page.text.split("What this record does not claim")[0]
    assert {rule["name"]: rule["result"] for rule in data["verdict"]["rules"]}[
        "record"
    ] == "missing"


def test_a_recovered_run_that_lost_a_part_since_is_not_told(tmp_path: Path) -> None:
    folder = recovered(tmp_path)
    (folder / "samples" / "part-0000.parquet").unlink()
    with pytest.raises(RecordError, match="is missing"):
        write_report(folder)


def test_a_recovered_run_without_limits_says_so_and_that_it_was_cut_off(tmp_path: Path) -> None:
    page, data = report(
        recovered(tmp_path, recipe=RECIPE.split("[acceptance]")[0], verdict="NOT JUDGED")
    )
    assert data["verdict"]["word"] == "NOT JUDGED"
    assert "The recording was cut off" in page.text
    assert "state no limits" in page.text


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Gone: /dev/ttyUSB0: it was hung up.", "Gone: it was hung up."),
        ("No usable answer on /dev/ttyUSB0 at 19200 8N1.", "No usable answer at 19200 8N1."),
        ("It is /dev/ttyUSB01.", "It is /dev/ttyUSB01."),
        ("A and/or B.", "A and/or B."),
    ],
)
def test_the_verdict_names_stations_and_not_their_devices(text: str, shown: str) -> None:
    assert without_urls(text, ["/dev/ttyUSB0", "dde-1"]) == shown


def test_lateness_is_said_of_the_port_that_is_asked_first(tmp_path: Path) -> None:
    facts = station(ports=(1, 2), rows=600)
    page, _ = report(seal(tmp_path, [facts], table(samples(600), samples(600, port=2))))
    assert page.text.count("Late, 99 % of ticks") == 1


def test_without_its_recipe_a_run_is_inconclusive(tmp_path: Path) -> None:
    folder = sealed(tmp_path)
    (folder / "recipes" / "tht.toml").write_text("not a recipe")
    _, data = report(folder)
    assert data["verdict"]["word"] == "INCONCLUSIVE"
    assert data["verdict"]["rules"][0]["name"] == "recipe"


def test_a_station_that_never_answered_is_there_with_its_reason(tmp_path: Path) -> None:
    gone = station("dde-2", ports=())
    gone.outcome, gone.reason, gone.model = "gone", "dde-2: no answer within 3 s", None
    folder = seal(tmp_path, [station(rows=600), gone], table(samples(600)))
    page, data = report(folder)
    assert data["verdict"]["word"] == "INCONCLUSIVE"
    assert data["stations"][1]["ports"] == []
    assert "Gone: No answer within 3 s. " in page.text
    assert "No data from this station." in page.text


def test_a_run_in_which_nobody_answered(tmp_path: Path) -> None:
    silent = station(ports=(1,))
    silent.outcome, silent.touched, silent.safe_state = "refused", [], {}
    page, data = report(seal(tmp_path, [silent], table()))
    assert data["verdict"]["word"] == "INCONCLUSIVE"
    assert "No data from this port." in page.text
    assert "No events." in page.text
    assert "No counter was read." in page.text
    assert data["stations"][0]["ports"][0]["recorded"]["coverage_percent"] is None


@pytest.mark.parametrize("rows", [1, 2])
def test_a_run_of_a_tick_or_two(tmp_path: Path, rows: int) -> None:
    _, data = report(sealed(tmp_path, rows))
    assert data["stations"][0]["ports"][0]["recorded"]["rows"] == rows
    assert data["stations"][0]["ports"][0]["tip"]["idle_error_c"] is None


def test_what_was_not_read_is_not_a_number(tmp_path: Path) -> None:
    columns = samples(600)
    lose(columns, slice(0, 600))
    page, data = report(seal(tmp_path, [station(rows=600)], table(columns)))
    port = data["stations"][0]["ports"][0]
    assert port["recorded"]["coverage_percent"] == 0
    assert port["recorded"]["gaps"][0]["reasons"] == "disconnected"
    assert {port["tip"][name] for name in port["tip"]} == {None}
    assert {port["power"][name] for name in port["power"]} == {None}
    assert "nan" not in page.text.lower().split()
    assert data["verdict"]["word"] == "REJECT"


def test_figures_of_a_port_come_from_its_rows(tmp_path: Path) -> None:
    columns = samples(600)
    columns["temperature_c"][300] = 444
    facts = station(rows=600)
    facts.rated_power_w = 130.0
    folder = seal(
        tmp_path, [facts], table(columns), [alarm(26)], [limit("high", "380"), limit("low", "300")]
    )
    page, data = report(folder)
    port = data["stations"][0]["ports"][0]
    assert (port["tip"]["least_c"], port["tip"]["greatest_c"], port["tip"]["setpoint_c"]) == (
        25,
        444,
        350,
    )
    assert (port["tip"]["alarm_high_c"], port["tip"]["alarm_low_c"]) == (380, 300)
    assert (port["recorded"]["readings"], port["recorded"]["due"], port["alarms"]) == (600, 600, 1)
    energy = float(np.trapezoid(columns["power_permille"], dx=0.1))
    assert port["power"]["energy_permille_s"] == pytest.approx(energy)
    assert port["power"]["energy_wh"] == pytest.approx(energy / 1000 * 130 / 3600)
    assert "25 to 444 °C" in page.text
    assert (folder / port["figures"][0]["file"]).is_file()


def test_at_full_speed_there_is_no_grid_and_still_a_report(tmp_path: Path) -> None:
    facts = station(rows=600)
    facts.period_s = None
    columns = samples(600)
    columns["late_us"][:] = np.nan
    _, data = report(seal(tmp_path, [facts], table(columns), rate="max"))
    assert data["rate"] == "max"
    assert data["stations"][0]["ports"][0]["recorded"]["late_p99_ms"] is None


def test_the_collector_looks_rarely_during_a_report_and_as_before_behind_it(
    recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, during = gc.get_threshold(), list[tuple[int, int, int]]()

    def found(*_: object) -> Joints:
        during.append(gc.get_threshold())
        raise RecordError("ends here")

    monkeypatch.setattr(writing, "joints_of", found)
    with pytest.raises(RecordError, match="ends here"):
        writing.report_files(recorded)
    assert during == [writing.COLLECTED]
    assert before != writing.COLLECTED
    assert gc.get_threshold() == before


def test_a_run_that_is_still_open_has_no_report(tmp_path: Path) -> None:
    folder, _ = begin(tmp_path, 10)
    with pytest.raises(RecordError, match="recover"):
        write_report(folder)
    with pytest.raises(RecordError):
        write_report(tmp_path / "nothing")


def test_a_folder_that_cannot_be_written_is_said_so(tmp_path: Path) -> None:
    folder = sealed(tmp_path)
    (folder / "figures").write_text("in the way")
    with pytest.raises(RecordError, match="cannot be written"):
        write_report(folder)


def test_the_verdict_of_the_manifest_is_not_judged_again(tmp_path: Path) -> None:
    folder = sealed(tmp_path)
    manifest = read_manifest(folder)
    manifest.verdict, manifest.verdict_rules = "INCONCLUSIVE", []
    write_manifest(folder, manifest)
    _, data = report(folder)
    assert (data["verdict"]["word"], data["verdict"]["decided"]) == ("INCONCLUSIVE", "with the run")


@pytest.mark.parametrize(
    ("rates", "said"),
    [
        ((("auto", 5.0), ("auto", 10.0)), "dde-1 5 Hz (auto); dde-2 10 Hz (auto)"),
        ((("auto", 5.0), ("auto", 5.0)), "5 Hz (auto)"),
        (((10.0, 10.0),), "10 Hz"),
    ],
)
def test_the_rate_is_what_was_asked_for_and_what_came_of_it(
    tmp_path: Path, rates: tuple[tuple[float | str, float | None], ...], said: str
) -> None:
    names = [f"dde-{number}" for number in range(1, len(rates) + 1)]
    stations = [station(name, rows=50) for name in names]
    for facts, (asked, taken) in zip(stations, rates, strict=True):
        facts.asked_rate, facts.rate_hz = asked, taken
    _, data = report(
        seal(tmp_path, stations, table(*(samples(50, name) for name in names)), rate=None)
    )
    assert data["rate"] == said
