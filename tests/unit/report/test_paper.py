"""The report as PDF: its sheets, that no line runs over an edge, and that the same run gives the
same bytes anywhere.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from datetime import datetime
from importlib.resources import files
from pathlib import Path

import pikepdf
import pypdfium2
import pytest
from fontTools.ttLib import TTFont

from jbclog.analysis.figures import style
from jbclog.core.text import clean
from jbclog.record.annotations import append
from jbclog.record.manifest import Metadata
from jbclog.report.typeset import FONTS, LACKING, LACKING_MEANS, MARKS, drawable, drawable_in_figure
from jbclog.report.write import write_report
from support.readers.pdf_read import faults, page_texts
from support.records.sealed_run import alarm, limit, samples, seal, station, table
from support.records.small_run import make_run

MAKE = "import sys; from jbclog.report.write import write_report; write_report(sys.argv[1])"
MADE = ("report.html", "report.pdf", "report.json", "figures", "tables")
PLACES = (
    {"TZ": "Pacific/Auckland", "LC_ALL": "C", "PYTHONHASHSEED": "1", "SOURCE_DATE_EPOCH": "7"},
    {
        "TZ": "America/St_Johns",
        "LC_ALL": "C.UTF-8",
        "PYTHONHASHSEED": "2",
        "MPLBACKEND": "svg",
        "LANGUAGE": "de",
    },
)


def digests(folder: Path) -> dict[str, str]:
    files = [
        path
        for path in folder.rglob("*")
        if path.is_file() and path.relative_to(folder).parts[0] in MADE
    ]
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }


@pytest.mark.campaign
def test_the_same_run_gives_the_same_bytes_in_other_places(tmp_path: Path) -> None:
    run, found = make_run(tmp_path / "runs", 45), []
    for number, place in enumerate(PLACES):
        elsewhere = tmp_path / f"place-{number}"
        elsewhere.mkdir()
        (elsewhere / "matplotlibrc").write_text(
            "font.size: 30\nlines.linewidth: 9\npdf.compression: 0\n"
        )
        told = run if number else os.path.relpath(run, elsewhere)
        subprocess.run(
            [sys.executable, "-c", MAKE, str(told)],
            check=True,
            cwd=elsewhere,
            env={**os.environ, **place},
        )
        found.append(digests(run))
    assert found[0] == found[1]
    assert {"report.html", "report.pdf", "report.json"} < set(found[0])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded one, with its report."""
    folder = make_run(tmp_path_factory.mktemp("runs"), 30)
    write_report(folder)
    return folder


def test_it_holds_no_time_of_making_and_no_name_of_a_machine(run: Path) -> None:
    data = (run / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    stop = json.loads((run / "report.json").read_text("utf-8"))["stop"]
    stamp = re.sub(r"[-:T]", "", stop)[:14]
    with pikepdf.open(run / "report.pdf") as pdf, pdf.open_metadata() as meta:
        assert {str(pdf.docinfo[name])[:16] for name in ("/CreationDate", "/ModDate")} == {
            f"D:{stamp}"
        }
        assert "/Author" not in pdf.docinfo
        dates = {
            datetime.fromisoformat(str(meta[f"xmp:{name}"])).timestamp()
            for name in ("CreateDate", "ModifyDate")
        }
    assert dates == {int(datetime.fromisoformat(stop).timestamp())}
    assert str(run.parent).encode() not in data


def test_what_was_said_since_is_in_the_report(tmp_path: Path) -> None:
    run = seal(
        tmp_path, [station(rows=300)], table(samples(300)), [alarm(12)], [limit("high", "380")]
    )
    append(run, who="A. Rossi", what="SN-12 scrapped", why="cracked joint", utc_s=1_790_000_500.0)
    write_report(run)
    facts = json.loads((run / "report.json").read_text("utf-8"))
    assert [(one["who"], one["what"], one["why"]) for one in facts["annotations"]] == [
        ("A. Rossi", "SN-12 scrapped", "cracked joint")
    ]
    assert "SN-12 scrapped" in (run / "report.html").read_text("utf-8")


def test_the_data_s_hash_is_that_of_the_list_of_files(run: Path) -> None:
    facts = json.loads((run / "report.json").read_text("utf-8"))
    parts = sorted(
        path
        for name in ("samples", "events", "settings", "counters")
        for path in (run / name).glob("*.parquet")
    )
    lines = {
        path.relative_to(run).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in parts
    }
    lines = {file["path"]: lines.get(file["path"], file["sha256"]) for file in facts["files"]}
    text = "".join(f"{lines[path]}  {path}\n" for path in sorted(lines))
    assert facts["data_sha256"] == hashlib.sha256(text.encode()).hexdigest()


def test_it_is_pdf_a_2a_for_a_reader_that_is_not_typst(run: Path) -> None:
    data = (run / "report.pdf").read_bytes()
    assert faults(data) == []
    with pikepdf.open(run / "report.pdf") as pdf:
        assert {
            (round(float(page.mediabox[2])), round(float(page.mediabox[3]))) for page in pdf.pages
        } == {(595, 842)}
        fonts = {
            str(one.BaseFont)
            for one in pdf.objects
            if isinstance(one, pikepdf.Dictionary) and "/BaseFont" in one
        }
    assert {font.split("+")[1] for font in fonts} == {"DejaVuSans", "DejaVuSans-Bold"}


def test_pages_are_numbered_and_parts_come_in_the_order_of_the_page(run: Path) -> None:
    sheets = page_texts((run / "report.pdf").read_bytes())
    assert [re.findall(r"page (\d+) of (\d+)", sheet) for sheet in sheets] == [
        [(str(number), str(len(sheets)))] for number in range(1, len(sheets) + 1)
    ]
    order = ["jbclog process record", "What the verdict rests on", "Reviewed", "Contents"]
    whole = "\n".join(sheets)
    places = [whole.index(text) for text in order]
    assert places == sorted(places)
    listed = re.findall(r"^(.+?) ?\.[ .]*\d+$", whole[places[-1] :], re.M)
    with pikepdf.open(run / "report.pdf") as pdf, pdf.open_outline() as outline:
        titles = [one.title for one in outline.root]
    assert [one for one in listed if one in titles] == titles
    html = (run / "report.html").read_text("utf-8")
    on_page = re.findall(r"<h2>([^<]+?) ?<", html)
    both = [one for one in on_page if one in titles]
    assert len(both) >= 6
    assert [one for one in titles if one in both] == both


def test_text_from_outside_is_shown_and_never_evaluated(tmp_path: Path) -> None:
    said = Metadata(
        '#read("/etc/passwd")',
        "= a heading",
        "$ x^2 $ *bold* <label> @ref",
        ("\\#panic()", "{nb} // no"),
    )
    run = seal(tmp_path, [station(rows=300)], table(samples(300)), metadata=said)
    write_report(run)
    data = (run / "report.pdf").read_bytes()
    front = page_texts(data)[0]
    for text in (
        '#read("/etc/passwd")',
        "= a heading",
        "$ x^2 $ *bold* <label> @ref",
        "\\#panic()",
        "{nb} // no",
    ):
        assert text in front.replace("\n", " "), front
    with pikepdf.open(run / "report.pdf") as pdf, pdf.open_outline() as outline:
        assert "a heading" not in {one.title for one in outline.root}
    assert "root:" not in front


def test_a_figure_has_the_words_of_a_record_without_what_no_document_can_hold(
    tmp_path: Path,
) -> None:
    """A status is a word of a list, but that of a part that somebody else made."""
    columns = samples(300)
    columns["status"][100:200] = "a\x01\u202eb"
    run = seal(tmp_path, [station(rows=300)], table(columns))
    write_report(run)
    drawn = "".join(path.read_text("utf-8") for path in (run / "figures").glob("*.svg"))
    assert "a\ufffd\ufffdb" in drawn
    assert not {"\x01", "\u202e"} & set(drawn)


def test_a_name_without_a_blank_stays_on_the_sheet(tmp_path: Path) -> None:
    run = seal(
        tmp_path, [station(rows=300)], table(samples(300)), metadata=Metadata("W" * 200, "x" * 80)
    )
    write_report(run)
    document = pypdfium2.PdfDocument((run / "report.pdf").read_bytes())
    words = document[0].get_textpage()
    right = max(words.get_charbox(number)[2] for number in range(words.count_chars()))
    assert right <= 595.3 - 0.59 * 72
    assert words.get_text_range().count("W") >= 200
    document.close()


def test_a_long_table_goes_over_sheets_with_its_head_on_each(tmp_path: Path) -> None:
    alarms = [alarm(second) for second in range(10, 290, 2)]
    run = seal(
        tmp_path,
        [station(rows=300, hz=1.0)],
        table(samples(300, hz=1.0)),
        alarms,
        [limit("high", "380")],
    )
    write_report(run)
    sheets = page_texts((run / "report.pdf").read_bytes())
    there = [sheet for sheet in sheets if re.search("Severity", sheet)]
    assert len(there) >= 2
    assert all(sheet.count("Not before") == 1 for sheet in there)
    found = [
        int(one)
        for sheet in there
        for one in re.findall(r"^\d\d-\d\d 14:\d\d:(\d\d)\.", sheet, re.M)
    ]
    assert len(found) == 120
    assert f"{len(alarms) - 120} more are in tables/events.csv." in " ".join(sheets)


def test_the_fonts_are_those_that_their_source_names() -> None:
    folder = Path(str(files("jbclog.report") / "vendor" / "dejavu"))
    stated = json.loads((folder / "source.json").read_text("utf-8"))["sha256"]
    assert {
        name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in stated
    } == stated


def test_every_letter_that_is_kept_can_be_set(tmp_path: Path) -> None:
    known = []
    for name in FONTS:
        with TTFont(str(files("jbclog.report") / "vendor" / "dejavu" / name), lazy=True) as font:
            known.append({chr(code) for code in font.getBestCmap()})
    letters = {letter for letter in known[0] & known[1] if clean(letter) == letter}
    assert len(letters) > 5000
    assert {*map(chr, range(0x20, 0x7F))} <= letters  # what is not looked up
    assert drawable(" ".join(letters)) == " ".join(letters)
    assert {
        letter
        for letter in map(chr, range(0x20, 0x3000))
        if drawable(letter) == letter and letter > "\x7f"
    } <= letters
    run = seal(
        tmp_path,
        [station(rows=300)],
        table(samples(300)),
        metadata=Metadata(" ".join(sorted(letters))),
    )
    write_report(run)
    assert faults((run / "report.pdf").read_bytes()) == []


def test_the_colours_of_a_figure_differ_in_grey() -> None:
    def grey(colour: str) -> float:
        red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
        return 0.299 * red + 0.587 * green + 0.114 * blue

    assert abs(grey(style.TEMPERATURE) - grey(style.TEMPERATURE_BAND)) > 60
    assert abs(grey(style.POWER) - grey(style.POWER_BAND)) > 60
    assert abs(grey(style.ALARM) - grey(style.NO_DATA_TINT)) > 60


class Drawn(str):
    """The drawing of a figure, which is long: to look up each of its letters takes 0.1 s for a
    million.
    """

    __slots__ = ()

    def translate(self, _table: object) -> str:
        raise AssertionError("no letter of it is lacking")


def test_a_drawing_whose_letters_the_font_has_is_not_translated() -> None:
    svg = "<text>10 µs – 350 °C, ±2</text>"
    assert drawable(Drawn(svg)) == svg


MARK = "\u0301"  # combines with the letter before it


def test_letters_that_the_font_lacks_are_told_and_not_lost_in_silence(tmp_path: Path) -> None:
    assert drawable("王 ΔT ✓") == f"{LACKING} ΔT ✓"
    assert drawable("a\0\x1b\ud800b\n") == f"a{3 * LACKING}b\n"
    assert drawable(f"a{MARKS * MARK}b") == f"a{MARKS * MARK}b"
    assert drawable(f"a{(MARKS + 1) * MARK}b{MARK}") == f"a{LACKING}b{MARK}"
    assert drawable_in_figure(f"<text>a{MARK} q{MARK}</text>") == f"<text>\u00e1 q{LACKING}</text>"
    run = seal(
        tmp_path,
        [station(rows=300)],
        table(samples(300)),
        metadata=Metadata("王小明", "4711", "µ-board"),
    )
    write_report(run)
    assert "王小明" in (run / "report.html").read_text("utf-8")
    whole = " ".join(page_texts((run / "report.pdf").read_bytes()))
    assert 3 * LACKING in whole
    assert LACKING_MEANS in " ".join(whole.split())


@pytest.mark.parametrize("stations", [1, 12])
def test_who_signs_has_the_verdict_its_rules_and_the_places_on_the_first_sheet(
    tmp_path: Path, stations: int
) -> None:
    names = [f"dde-{number}" for number in range(1, stations + 1)]
    columns = [samples(300, name, port, 5.0) for name in names for port in (1, 2)]
    facts = [station(name, (1, 2), 300, 5.0) for name in names]
    rules = [
        limit(side, text, station_name=name)
        for name in names
        for side, text in (("high", "380"), ("low", "300"))
    ]
    run = seal(tmp_path, facts, table(*columns), [alarm(12, "dde-1")], rules)
    write_report(run)
    sheets = page_texts((run / "report.pdf").read_bytes())
    for text in ("REJECT", "What the verdict rests on", "Reviewed", "Approved", "Signature"):
        assert text in sheets[0], text
    # without the lines of the contents
    own = [re.sub(r"(?m)^.*(\. ){3}.*$", "", sheet) for sheet in sheets]
    assert sum(sheet.count("Overview\n") for sheet in own) == 1
    assert sum(sheet.count("What the verdict rests on\n") for sheet in own) == 1
    assert sum(sheet.count("Reviewed") for sheet in own) == 1
    assert ("Overview" in own[0]) == (stations == 1)
