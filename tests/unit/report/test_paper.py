"""The report as PDF: its sheets, that no line runs over an edge, and that the same run gives the same bytes anywhere."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import zlib
from datetime import UTC, datetime
from pathlib import Path

import pytest
from drawn import boxes, texts
from make_run import make_run
from sealed_run import alarm, limit, samples, seal, station, table

from jbclog.record.annotations import append
from jbclog.record.manifest import Metadata
from jbclog.report import style
from jbclog.report.paper import HEIGHT, WIDTH, Cell, Paper, Type, pdf_bytes, wrapped
from jbclog.report.text_metrics import LACKING, drawable, width_in
from jbclog.report.write import write_report

MAKE = "import sys; from jbclog.report.write import write_report; write_report(sys.argv[1])"
MADE = ("report.html", "report.pdf", "report.json", "figures", "tables")
PLACES = (
    {"TZ": "Pacific/Auckland", "LC_ALL": "C", "PYTHONHASHSEED": "1", "SOURCE_DATE_EPOCH": "7"},
    {"TZ": "America/St_Johns", "LC_ALL": "C.UTF-8", "PYTHONHASHSEED": "2", "MPLBACKEND": "svg", "LANGUAGE": "de"},
)


def digests(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file() and path.relative_to(folder).parts[0] in MADE]
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.campaign
def test_the_same_run_gives_the_same_bytes_in_other_places(tmp_path: Path) -> None:
    run, found = make_run(tmp_path / "runs", 45), []
    for number, place in enumerate(PLACES):
        elsewhere = tmp_path / f"place-{number}"
        elsewhere.mkdir()
        (elsewhere / "matplotlibrc").write_text("font.size: 30\nlines.linewidth: 9\npdf.compression: 0\n")
        told = run if number else os.path.relpath(run, elsewhere)
        subprocess.run([sys.executable, "-c", MAKE, str(told)], check=True, cwd=elsewhere, env={**os.environ, **place})
        found.append(digests(run))
    assert found[0] == found[1]
    assert {"report.html", "report.pdf", "report.json"} < set(found[0])


def test_it_holds_no_time_of_making_and_no_name_of_a_machine(tmp_path: Path) -> None:
    run = make_run(tmp_path, 30)
    write_report(run)
    data = (run / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF-")
    ended = json.loads((run / "report.json").read_text("utf-8"))["ended"]
    assert re.findall(rb"/CreationDate \(([^)]*)\)", data) == [f"D:{re.sub(r'[-:T]', '', ended)[:14]}Z".encode()]
    assert not re.search(rb"/(ModDate|Producer|Author)", data)
    assert b"/JavaScript" not in data
    assert str(tmp_path).encode() not in data


def test_what_was_said_since_is_in_the_report(tmp_path: Path) -> None:
    run = seal(tmp_path, [station(rows=300)], table(samples(300)), [alarm(12)], [limit("high", "380")])
    append(run, who="A. Rossi", what="SN-12 scrapped", why="cracked joint", utc_s=1_790_000_500.0)
    write_report(run)
    facts = json.loads((run / "report.json").read_text("utf-8"))
    assert [(one["who"], one["what"], one["why"]) for one in facts["annotations"]] == [
        ("A. Rossi", "SN-12 scrapped", "cracked joint")
    ]
    assert "SN-12 scrapped" in (run / "report.html").read_text("utf-8")


def test_the_data_s_hash_is_that_of_the_list_of_files(tmp_path: Path) -> None:
    run = make_run(tmp_path, 30)
    write_report(run)
    facts = json.loads((run / "report.json").read_text("utf-8"))
    parts = sorted(path for name in ("samples", "events", "settings", "counters") for path in (run / name).glob("*.parquet"))
    lines = {path.relative_to(run).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in parts}
    lines = {file["path"]: lines.get(file["path"], file["sha256"]) for file in facts["files"]}
    text = "".join(f"{lines[path]}  {path}\n" for path in sorted(lines))
    assert facts["data_sha256"] == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("text", ["a word and another " * 20, "x" * 400, "", "μ °C ‰ → ✓ " * 30])
def test_no_line_is_wider_than_its_room(text: str) -> None:
    type_ = Type(8)
    lines = wrapped(text, type_, 2.0)
    assert all(width_in(line, 8, bold=False) <= 2.0 for line in lines)
    assert re.sub(r"\s", "", "".join(lines)) == re.sub(r"\s", "", text)


def test_a_long_table_goes_over_sheets_with_its_head_on_each() -> None:
    type_ = Type(7)
    paper = Paper()
    rows = [[Cell(f"row {n}", type_), Cell("1.5 °C", type_, right=True), Cell("a sentence " * 12, type_)] for n in range(120)]
    paper.heading("Rules")
    paper.table([Cell("Rule", type_), Cell("Limit", type_, right=True), Cell("In words", type_)], rows)
    sheets = [texts(sheet) for sheet in paper.sheets]
    assert len(sheets) > 2
    assert all(sheet.count("In words") == 1 for sheet in sheets)
    assert [word for sheet in sheets for word in sheet if word.startswith("row ")] == [f"row {n}" for n in range(120)]
    placed = [box for sheet in paper.sheets for box in boxes(sheet)]
    assert max(box.bottom for box in placed) < 72 * (HEIGHT - 0.45)  # nothing runs into the foot
    assert max(box.right for box in placed) < 72 * (WIDTH - 0.59)
    assert b"/Count %d\n" % len(sheets) in pdf_bytes(paper.sheets, "foot", "title", datetime(2026, 9, 21, tzinfo=UTC))


def test_sheets_are_a4_and_letters_are_in_the_file(tmp_path: Path) -> None:
    run = seal(tmp_path, [station(rows=300)], table(samples(300)))
    write_report(run)
    data = (run / "report.pdf").read_bytes()
    (width, height) = map(float, re.findall(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+)", data)[0])
    assert (width / 72 * 25.4, height / 72 * 25.4) == pytest.approx((210, 297), abs=0.2)
    assert b"FontFile2" in data
    streams = [zlib.decompress(part) for part in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.S) if part[:1] == b"x"]
    assert streams


def test_the_colours_of_a_figure_differ_in_grey() -> None:
    def grey(colour: str) -> float:
        red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
        return 0.299 * red + 0.587 * green + 0.114 * blue

    assert abs(grey(style.TEMPERATURE) - grey(style.TEMPERATURE_BAND)) > 60
    assert abs(grey(style.POWER) - grey(style.POWER_BAND)) > 60
    assert abs(grey(style.ALARM) - grey(style.NO_DATA_TINT)) > 60


def test_letters_that_the_font_lacks_are_told_and_not_lost_in_silence(tmp_path: Path) -> None:
    assert drawable("王 ΔT ✓") == f"{LACKING} ΔT ✓"
    run = seal(tmp_path, [station(rows=300)], table(samples(300)), metadata=Metadata("王小明", "4711", "µ-board"))
    write_report(run)  # a warning would be an error here
    assert "王小明" in (run / "report.html").read_text("utf-8")


@pytest.mark.parametrize("stations", [1, 12])
def test_who_signs_has_the_verdict_its_rules_and_the_places_on_the_first_sheet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stations: int
) -> None:
    seen: list[list[str]] = []
    monkeypatch.setattr("jbclog.report.paper.pdf_file", lambda sheets, *_: seen.extend(map(texts, sheets)) or b"%PDF-")
    names = [f"dde-{number}" for number in range(1, stations + 1)]
    columns = [samples(300, name, port, 5.0, seed) for seed, name in enumerate(names) for port in (1, 2)]
    facts = [station(name, (1, 2), 300, 5.0) for name in names]
    rules = [limit(side, text, station_name=name) for name in names for side, text in (("high", "380"), ("low", "300"))]
    write_report(seal(tmp_path, facts, table(*columns), [alarm(12, "dde-1")], rules))
    assert {"What the verdict rests on", "Reviewed", "Approved", "Signature"} <= set(seen[0])
    assert sum(sheet.count("At a glance") for sheet in seen) == 1
    assert sum(sheet.count("What the verdict rests on") for sheet in seen) == 1
    assert sum(sheet.count("Reviewed") for sheet in seen) == 1
    assert ("At a glance" in seen[0]) == (stations == 1)
